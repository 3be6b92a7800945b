"""Phrases by which an operator is asked for: words, [what may be left out], (one|or|another), and {field:kind} slots.

"darken the scene [to {factor:share}]" fits "darken the scene to 40%" and sets `factor` to 0.4. A slot's kind is one of
`EXAMPLES` or a choice of words (`{material:rubber|sand}`). It may be left out where the field is called as its kind is,
or is one of the operator's targets or anchors. A field with two slots takes a list of both.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rpaug.core.errors import RpaugError
from rpaug.core.interfaces import Operator

EXAMPLES: Mapping[str, tuple[str, Any]] = {
    "target": ("the red block", "red block"),
    "targets": ("the bowl and the cup", ["bowl", "cup"]),
    "camera": ("the front camera", "front"),
    "color": ("blue", "blue"),
    "share": ("50%", 0.5),
    "count": ("2", 2),
    "number": ("1.5", 1.5),
    "length": ("5 cm", 0.05),
    "angle": ("10 degrees", 0.1745),
}
"""For each kind of slot, words that may fill it, and what a recipe's field becomes by them."""
TOKEN = re.compile(r"\s*(\{(?P<slot>[^{}]*)\}|(?P<mark>[\[\]()|])|(?P<word>[^\s\[\](){}|]+))")


@dataclass(frozen=True)
class Slot:
    """Where words give a field its value. `choices` are the words of a choice, none for a kind of `EXAMPLES`."""

    field: str
    kind: str

    @property
    def choices(self) -> tuple[str, ...]:
        return () if self.kind in EXAMPLES else tuple(self.kind.split("|"))

    @property
    def example(self) -> tuple[str, Any]:
        """Words that fill the slot, and the value they stand for."""
        return EXAMPLES[self.kind] if not self.choices else (self.choices[0], self.choices[0])


@dataclass(frozen=True)
class Group:
    """Alternatives, each a sequence of parts; `needed` unless all of them may be left out."""

    alternatives: tuple[tuple["Part", ...], ...]
    needed: bool = True


Part = str | Slot | Group


def parse(text: str, operator: type[Operator]) -> Group:
    """The parts of a phrase. Raises RpaugError saying what is wrong with it."""
    tokens, at = [], 0
    while at < len(text.rstrip()):
        token = TOKEN.match(text, at)
        if token is None:
            raise RpaugError(f"phrase {text!r}: a brace is left open at {text[at:]!r}")
        tokens.append(token)
        at = token.end()
    rest = iter(tokens)
    made = _group(rest, "", text, operator)
    if not any(made.alternatives):
        raise RpaugError(f"phrase {text!r} has no words")
    return made


def _group(rest: Iterator[re.Match[str]], end: str, text: str, operator: type[Operator]) -> Group:
    """Everything up to the mark that ends the group."""
    every: list[list[Part]] = [[]]
    for token in rest:
        mark = token["mark"]
        if token["slot"] is not None:
            every[-1].append(_slot(token["slot"], text, operator))
        elif token["word"]:
            every[-1].append(token["word"].lower())
        elif mark == "|":
            every.append([])
        elif mark in ("[", "("):
            every[-1].append(_group(rest, "]" if mark == "[" else ")", text, operator))
        elif mark == end:
            return Group(tuple(map(tuple, every)), end != "]")
        else:
            raise RpaugError(f"phrase {text!r}: {mark!r} closes nothing")
    if end:
        raise RpaugError(f"phrase {text!r}: {end!r} is missing")
    return Group(tuple(map(tuple, every)))


def _slot(given: str, text: str, operator: type[Operator]) -> Slot:
    name, _, kind = (part.strip() for part in given.partition(":"))
    named = name in (*operator.needs.targets, *operator.needs.anchors)
    kind = kind or (name if name in EXAMPLES else "target" if named else "")
    if name not in getattr(operator, "__dataclass_fields__", {}):
        raise RpaugError(f"phrase {text!r}: {operator.__name__} has no field {name!r}")
    if kind not in EXAMPLES and "|" not in kind:
        known = ", ".join(EXAMPLES)
        raise RpaugError(
            f"phrase {text!r}: {{{name}:KIND}} with KIND one of {known}, or words with |"
        )
    return Slot(name, kind)


def slots(group: Group, whole: bool = True) -> Iterator[Slot]:
    """The slots of a phrase in order: of its first alternatives, with or without what may be left out."""
    for part in group.alternatives[0]:
        if isinstance(part, Slot):
            yield part
        elif isinstance(part, Group) and (whole or part.needed):
            yield from slots(part, whole)


def example(group: Group, whole: bool = True) -> str:
    """The phrase with words in its slots, as a person may say it."""
    words = []
    for part in group.alternatives[0]:
        if isinstance(part, Slot):
            words.append(part.example[0])
        elif isinstance(part, str):
            words.append(part)
        elif whole or part.needed:
            words.append(example(part, whole))
    return " ".join(filter(None, words))


def fields(values: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """A recipe's fields of what its slots came to: a field that stands twice is a list."""
    out: dict[str, Any] = {}
    for name in dict.fromkeys(name for name, _ in values):
        given = [value for other, value in values if other == name]
        out[name] = given[0] if len(given) == 1 else given
    return out
