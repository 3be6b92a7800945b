"""Plain data as values of a declared type, and what is wrong with it in the words that recipes use."""

from abc import ABCMeta
from dataclasses import is_dataclass
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from rpaug.core.errors import BadRecipe

Place = tuple[str | int, ...]


class Invalid(Exception):
    """Data that is no value of its type: every fault with the place of its field."""

    def __init__(self, faults: list[tuple[Place, str]]) -> None:
        self.faults = faults
        super().__init__(str(faults))


@cache
def _adapter(kind: type) -> TypeAdapter:
    return TypeAdapter(kind)


def validated(kind: type, data: Any) -> Any:
    """The data as a value of that type. Raises Invalid."""
    try:
        return _adapter(kind).validate_python(data)
    except ValidationError as error:
        faults = []
        for fault in error.errors(include_url=False):
            parts = (part for part in fault["loc"] if not str(part).startswith("function-"))
            faults.append((tuple(parts), _words(fault)))
    raise Invalid(faults)


def _words(fault: Any) -> str:
    if fault["type"] == "missing":
        return "missing"
    if fault["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return "unknown key"
    return f"found {fault['input']!r:.80}; {fault['msg'].removeprefix('Value error, ')}"


def dotted(path: Place) -> str:
    """`edits[0].color` for ("edits", 0, "color")."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


class Validated(ABCMeta):
    """Classes whose keyword arguments are taken as a recipe would take them: `Recolor(target="the cup", color="red")`.

    Raises BadRecipe, naming every argument that is wrong.
    """

    def __call__(cls, *args: Any, **fields: Any) -> Any:
        if args or not is_dataclass(cls):
            return super().__call__(*args, **fields)
        try:
            return validated(cls, fields)
        except Invalid as error:
            told = [": ".join(filter(None, map(str, (dotted(p), m)))) for p, m in error.faults]
        raise BadRecipe("\n".join(f"{cls.__name__}: {words}" for words in told))
