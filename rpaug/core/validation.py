"""Plain data as values of a declared type, and what is wrong with it in the words that recipes use."""

import re
from abc import ABCMeta
from dataclasses import is_dataclass
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic.errors import PydanticUserError

from rpaug.core.errors import BadRecipe, did_you_mean

Place = tuple[str | int, ...]

TAGS = ("function-", "[key]")  # parts of pydantic's places that are none of the data's
SHOWN = 4  # fields of an example
MAPPINGS = {"model_type", "model_attributes_type", "dataclass_type", "dict_type"}
EXPECTED = {
    "list_type": "a list",
    "tuple_type": "a list",
    "string_type": "text",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
}
"""What pydantic would have taken, in words."""


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
            parts = (part for part in fault["loc"] if not str(part).startswith(TAGS))
            place = tuple(parts)
            faults.append((place, _told(kind, place, fault)))
    raise Invalid(faults)


def _told(kind: type, path: Place, fault: Any) -> str:
    """One fault in the words of recipes: what was found, and what would have been right."""
    if fault["type"] == "missing":
        return "missing"
    if fault["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        known = list(_properties(kind, path[:-1]))
        meant = did_you_mean(str(path[-1]), known)
        return f"unknown key; {meant}?" if meant else f"unknown key; known are: {', '.join(known)}"
    given, context = fault["input"], fault.get("ctx", {})
    if fault["type"] == "literal_error":
        known = re.findall("'([^']*)'", context["expected"]) or [context["expected"]]
        meant = did_you_mean(given, known) if isinstance(given, str) else ""
        one = f"expected one of: {', '.join(known)}" if len(known) > 1 else f"expected {known[0]}"
        return f"found {given!r:.80}; {f'{meant}? ' if meant else ''}{one}"
    if fault["type"] in MAPPINGS:
        name = next((str(part) for part in reversed(path) if not isinstance(part, int)), "")
        return f"found {kind_of(given)}; expected {_example(name, _properties(kind, path))}"
    if words := EXPECTED.get(fault["type"]):
        return f"found {kind_of(given)}; expected {words.format(**context)}"
    return f"found {given!r:.80}; {fault['msg'].removeprefix('Value error, ')}"


def _example(name: str, fields: dict[str, Any]) -> str:
    """A field as a recipe writes it: `select: {episodes: ..., limit: ...}`."""
    if not fields:
        return "a mapping"
    shown = [
        f"{key}: {'[...]' if one.get('type') == 'array' else '...'}" for key, one in fields.items()
    ]
    more = ", ..." if len(shown) > SHOWN else ""
    return f"`{name}: {{{', '.join(shown[:SHOWN])}{more}}}`"


def _properties(kind: type, path: Place) -> dict[str, Any]:
    """The fields of what lies at that place of a value of this type; empty where that is not known."""
    try:
        root = _adapter(kind).json_schema()
    except PydanticUserError:  # a type without a schema
        return {}
    here = _resolved(root, root)
    for part in path:
        if isinstance(part, int):
            here = _resolved(root, here.get("items", {}))
        elif part in here.get("properties", {}):
            here = _resolved(root, here["properties"][part])
        elif isinstance(here.get("additionalProperties"), dict):
            here = _resolved(root, here["additionalProperties"])
    return here.get("properties", {})


def _resolved(root: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """The schema that a reference names, of several the first with fields."""
    if "$ref" in schema:
        return _resolved(root, root["$defs"][schema["$ref"].rsplit("/", 1)[-1]])
    for choice in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())):
        if "properties" in (found := _resolved(root, choice)):
            return found
    return schema


def kind_of(value: Any) -> str:
    """A value in a few words."""
    return {dict: "a mapping", list: "a list", tuple: "a list", type(None): "nothing"}.get(
        type(value), repr(value)[:60]
    )


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
