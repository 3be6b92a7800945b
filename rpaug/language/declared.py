"""What an edit is about, by what its operator declares."""

import re
from typing import Any

from rpaug.core import registry
from rpaug.language.messages import Entry
from rpaug.scene.targets import relations
from rpaug.scene.targets.targets import Target


def targets(edit: Entry) -> list[Any]:
    """The things that an edit names as those it changes."""
    return _values(edit, registry.operator(edit["op"]).needs.targets)


def anchors(edit: Entry) -> list[Any]:
    """The things that an edit names to say where."""
    return _values(edit, registry.operator(edit["op"]).needs.anchors)


def own_role(op: str) -> str | None:
    """The role of what an operator is about if nothing is named: the table for `table_color`."""
    operator = registry.operator(op)
    own = [getattr(operator, name, None) for name in operator.needs.targets]
    return next((one.role for one in own if isinstance(one, Target)), None)


def _values(edit: Entry, names: tuple[str, ...]) -> list[Any]:
    given = [edit[name] for name in names if edit.get(name) is not None]
    return [
        one for value in given for one in (value if isinstance(value, list | tuple) else [value])
    ]


def phrases(value: str | dict[str, Any]) -> list[str]:
    """The phrases inside a target, the innermost anchors first: each is looked for by itself."""
    text = value if isinstance(value, str) else value.get("text")
    if text is None:
        return []
    words, ends, at = text.split(), [], 0
    while at < len(words):
        size = relations.relation_at(words, at)[1]
        at += size or 1
        ends += [at] if size else []
    anchors = [re.sub(r"^(?:the|a|an) ", "", " ".join(words[end:])) for end in reversed(ends)]
    return [anchor for anchor in anchors if anchor and " and " not in anchor]
