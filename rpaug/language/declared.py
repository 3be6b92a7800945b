"""What an edit is about, by what its operator declares."""

from typing import Any

from rpaug.core import registry
from rpaug.language.messages import Entry
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
