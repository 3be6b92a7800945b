"""Operators' own phrases as rules of the grammar: `core.phrases` says how they are written."""

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from rpaug.core import phrases, registry
from rpaug.core.interfaces import Operator
from rpaug.core.phrases import Group, Part, Slot
from rpaug.language import slots
from rpaug.language.grammar import SLOTS, Rule, Said, done
from rpaug.language.grounding import thing, things
from rpaug.language.messages import Meant, Mention
from rpaug.language.renderer import cameras

VALUES: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "color": (SLOTS["color"], slots.color),
    "share": (SLOTS["share"], slots.share),
    "count": (SLOTS["number"], slots.count),
    "number": (SLOTS["number"], lambda words: slots.tidy(slots.number(words))),
    "length": (SLOTS["length"], slots.length),
    "angle": (SLOTS["angle"], slots.angle),
}
"""For each kind of slot that needs nothing but its words: the pattern it fits, and its value."""


@cache
def rules() -> tuple[Rule, ...]:
    """A rule for each phrase of the operators that do not ship: those that do have modules of rules in this folder."""
    return tuple(
        rule(name, registry.operator(name), text)
        for name in registry.operator_names()
        if not registry.shipped(name)
        for text in registry.operator(name).phrases
    )


def rule(op: str, operator: type[Operator], text: str) -> Rule:
    """The rule of one phrase. Raises RpaugError for one that is not well-formed."""
    found: list[Slot] = []
    pattern = _pattern(phrases.parse(text, operator), found)

    def make(stated: Said) -> Meant:
        values: list[tuple[str, Any]] = []
        each, mention = "", None
        every: list[Any] = []  # things of the field `each`: an edit for each of them
        value: Any
        for number, slot in enumerate(found):
            words = stated.get(name := f"slot{number}")
            if words is None:
                continue
            if slot.kind == "camera":
                value, mention = cameras(Said({"camera": words}, stated.wish))
            elif slot.kind == "target" and slot.field in operator.needs.targets:
                each, every, value = slot.field, things(stated, name), None
                mention = Mention(kind="target", target=every[0]) if len(every) == 1 else None
            elif slot.kind in ("target", "targets"):
                value = (thing if slot.kind == "target" else things)(stated, name)
            else:
                value = words if slot.choices else VALUES[slot.kind][1](words)
            values.append((slot.field, value))
        edit = {"op": op, **phrases.fields(values)}
        edits = [{**edit, each: one} for one in every] or [edit]
        return done(*edits, mention=mention)

    return Rule((re.compile(pattern),), make)


def _pattern(part: Part, found: list[Slot]) -> str:
    """The pattern of a part with the space before it; slots are numbered as they are found."""
    if isinstance(part, str):
        return rf"(?:^| ){re.escape(part)}"
    if isinstance(part, Group):
        every = ("".join(_pattern(one, found) for one in parts) for parts in part.alternatives)
        return f"(?:{'|'.join(every)}){'' if part.needed else '?'}"
    name = f"slot{len(found)}"
    found.append(part)
    if part.choices:
        pattern = slots.any_of(part.choices)
    elif part.kind in ("target", "targets"):
        pattern = SLOTS["thing"]
    else:
        pattern = SLOTS["camera"] if part.kind == "camera" else VALUES[part.kind][0]
    return rf"(?:^| )(?P<{name}>{pattern})"


def examples(name: str) -> list[str]:
    """What may be said to ask for an operator: its phrases, filled in."""
    operator = registry.operator(name)
    return [phrases.example(phrases.parse(text, operator)) for text in operator.phrases]
