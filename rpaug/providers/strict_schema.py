"""Any JSON Schema as one that strict decoding takes, and strict answers back to what the schema says.

OpenAI's structured outputs take a subset of JSON Schema: every property is required and no other is allowed, what may
be left out is null instead, unions are `anyOf`, lists have one kind of item, and sizes are bounded
(developers.openai.com/api/docs/guides/structured-outputs, "Supported schemas"). What cannot be said in it is given up
here: bounds on lengths are dropped, since the caller checks every answer anyway.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

PROPERTIES, LEVELS, ENUM_VALUES, CHARACTERS = 5000, 10, 1000, 120_000  # the published limits
LONG_ENUM, LONG_ENUM_CHARACTERS = (
    250,
    15_000,
)  # of one enum of texts with more values than the first
BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "multipleOf")
KEPT: Mapping[str, tuple[str, ...]] = {
    "string": ("pattern", "format"), "number": BOUNDS, "integer": BOUNDS, "boolean": (), "null": (),
    "array": ("minItems", "maxItems"), "object": (),
}  # fmt: skip
FORMATS = frozenset(
    "date-time time date duration email hostname ipv4 ipv6 uuid".split()  # noqa: SIM905
)
KINDS = {str: "string", bool: "boolean", int: "integer", float: "number", type(None): "null"}

Schema = Mapping[str, Any]


def strict(schema: Schema) -> dict[str, Any] | None:
    """The schema for strict decoding; None where it has free keys, free values or too much of anything.

    `schema` is an object's, with definitions under `$defs`. A property that may be left out becomes one that may be
    null; `answered` turns that back.
    """
    try:
        out = _strict(schema, schema)
        named = {name: _strict(one, schema) for name, one in schema.get("$defs", {}).items()}
    except ValueError:
        return None
    if out.get("type") != "object":
        return None
    out |= {"$defs": named} if named else {}
    return out if _fits(out) else None


def answered(value: Any, schema: Schema, root: Schema | None = None) -> Any:
    """An answer without the nulls that stand for properties left out; what fits no branch of the schema stays."""
    root = schema if root is None else root
    branches = list(_branches(schema, root))
    if isinstance(value, list):
        for node in branches:
            first, rest = node.get("prefixItems", ()), node.get("items", {})
            if node.get("type") == "array":
                kinds = (*first, *[rest] * max(0, len(value) - len(first)))
                return [answered(one, kind, root) for one, kind in zip(value, kinds, strict=False)]
    if isinstance(value, dict):
        for node in branches:
            fields = _fields(node)
            if fields is not None and value.keys() <= fields.keys() and _tagged(value, fields):
                left_out = {
                    name for name in value
                    if value[name] is None and name not in node.get("required", ())
                }  # fmt: skip
                return {
                    name: answered(one, fields[name], root)
                    for name, one in value.items()
                    if name not in left_out
                }
    return value


def _strict(node: Schema, root: Schema) -> dict[str, Any]:
    """One node. Raises ValueError for what strict decoding has no words for."""
    if "$ref" in node:
        return {"$ref": node["$ref"]}  # nothing may stand beside it
    said = {"description": node["description"]} if "description" in node else {}
    for union in ("anyOf", "oneOf", "allOf"):
        if union in node:
            if "properties" in node or (union == "allOf" and len(node[union]) > 1):
                raise ValueError("both at once")
            return _any([_strict(one, root) for one in node[union]]) | said
    if "const" in node or "enum" in node:
        values = node["enum"] if "enum" in node else [node["const"]]
        kinds = sorted({_kind(value) for value in values})
        return {"type": kinds[0] if len(kinds) == 1 else kinds, "enum": list(values)} | said
    kind = node.get("type", "object" if "properties" in node else None)
    if isinstance(kind, list):
        return _any([_strict({**node, "type": one}, root) for one in kind]) | said
    if kind not in KEPT:
        raise ValueError("any value")
    out = {"type": kind} | said | {name: node[name] for name in KEPT[kind] if name in node}
    if out.get("format", "date") not in FORMATS:
        del out["format"]
    if kind == "array":
        return out | _items(node, root)
    return out | _object(node, root) if kind == "object" else out


def _object(node: Schema, root: Schema) -> dict[str, Any]:
    fields = _fields(node)
    if fields is None:
        raise ValueError("free keys")
    required = node.get("required", ())
    ordered = sorted(
        fields, key=lambda name: "const" not in fields[name]
    )  # what tells unions apart
    given = {name: _strict(fields[name], root) for name in ordered}
    for name in ordered:
        if name not in required and not _may_be_null(fields[name], root):
            given[name] = _any([given[name], {"type": "null"}])
    return {"properties": given, "required": list(given), "additionalProperties": False}


def _items(node: Schema, root: Schema) -> dict[str, Any]:
    """One kind of item for all places. A list with a kind for each place gets that many items."""
    places = node.get("prefixItems", [])
    kinds = [*places, node["items"]] if isinstance(node.get("items"), Mapping) else places
    if not kinds:
        raise ValueError("any items")
    count = {"minItems": len(places), "maxItems": len(places)} if "items" not in node else {}
    return {"items": _any([_strict(kind, root) for kind in kinds])} | count


def _fields(node: Schema) -> Mapping[str, Any] | None:
    """An object's properties, or the named keys of a map; None where keys are free."""
    names = node.get("propertyNames", {}).get("enum")
    free = node.get("additionalProperties", False)
    if "properties" in node and free is False:
        fields: Mapping[str, Any] = node["properties"]
        return fields
    if names and isinstance(free, Mapping) and "properties" not in node:
        return dict.fromkeys(names, free)
    return {} if free is False and "additionalProperties" in node else None


def _any(branches: list[dict[str, Any]]) -> dict[str, Any]:
    """Either of these, flat and each once."""
    flat: list[dict[str, Any]] = []
    for branch in branches:
        flat += [one for one in branch.get("anyOf", [branch]) if one not in flat]
    return flat[0] if len(flat) == 1 else {"anyOf": flat}


def _branches(node: Schema, root: Schema, seen: tuple[str, ...] = ()) -> Iterator[Schema]:
    """The plain nodes that a value may fit: references and unions are followed."""
    name = str(node.get("$ref", "")).removeprefix("#/$defs/")
    unions = [one for key in ("anyOf", "oneOf", "allOf") for one in node.get(key, ())]
    if name and name not in seen:
        yield from _branches(root.get("$defs", {}).get(name, {}), root, (*seen, name))
    elif unions:
        for one in unions:
            yield from _branches(one, root, seen)
    elif not name:
        yield node


def _may_be_null(node: Schema, root: Schema) -> bool:
    return any(
        "null" in one.get("type", ()) or None in one.get("enum", ())
        for one in _branches(node, root)
    )


def _tagged(value: Mapping[str, Any], fields: Mapping[str, Any]) -> bool:
    """Whether the value has the constants that tell this object from others."""
    return all(
        value.get(name) == field["const"] for name, field in fields.items() if "const" in field
    )


def _kind(value: Any) -> str:
    if type(value) not in KINDS:
        raise ValueError("a constant that is no scalar")
    return KINDS[type(value)]


def _fits(schema: Schema) -> bool:
    """Whether the published limits are kept."""
    fields = enums = characters = 0
    nodes: list[Schema] = [schema]
    for node in nodes:
        nodes += [*node.get("properties", {}).values(), *node.get("$defs", {}).values()]
        nodes += [*node.get("anyOf", ()), *([node["items"]] if "items" in node else ())]
        values = node.get("enum", ())
        length = sum(len(one) for one in values if isinstance(one, str))
        if len(values) > LONG_ENUM and length > LONG_ENUM_CHARACTERS:
            return False
        fields += len(node.get("properties", ()))
        enums += len(values)
        characters += len("".join([*node.get("properties", ()), *node.get("$defs", ())]))
        characters += len(json.dumps(values)) if values else 0
    return (
        fields <= PROPERTIES
        and enums <= ENUM_VALUES
        and characters <= CHARACTERS
        and _levels(schema, schema) <= LEVELS
    )


def _levels(node: Schema, root: Schema, seen: tuple[str, ...] = ()) -> int:
    """Objects within objects; a schema that holds itself counts once."""
    name = str(node.get("$ref", "")).removeprefix("#/$defs/")
    if name:
        known = name in seen or name == "#"
        return 0 if known else _levels(root["$defs"][name], root, (*seen, name))
    inner = [*node.get("properties", {}).values(), *node.get("anyOf", ())]
    inner += [node["items"]] if "items" in node else []
    deepest = max((_levels(one, root, seen) for one in inner), default=0)
    return deepest + (node.get("type") == "object")
