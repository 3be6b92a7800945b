"""The JSON Schema that a language model's answer to a wish is held to."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from rpaug.core import registry
from rpaug.language import answers
from rpaug.pipeline import recipe


def of_wish(cameras: Sequence[str], ops: Sequence[str] | None = None) -> dict[str, Any]:
    """The schema of a `WishAnswer` whose edits are of these operators, all if None, and move only these cameras."""
    schema = answers.WishAnswer.model_json_schema()
    whole, used = recipe.schema()["$defs"], dict[str, Any]()
    kinds = [_option(op, whole, cameras) for op in ops or registry.operator_names()]
    _gather(kinds, whole, used)
    schema["$defs"] |= used
    options = schema["$defs"]["WishEdit"]["properties"]["options"]
    schema["$defs"]["WishEdit"]["properties"]["options"] = {**options, "items": {"anyOf": kinds}}
    return plain(schema)


def of_plan() -> dict[str, Any]:
    """The schema of a `WishPlan`."""
    schema = answers.WishPlan.model_json_schema()
    schema["$defs"]["WishStep"]["properties"]["op"] = {"enum": registry.operator_names()}
    return plain(schema)


def _option(op: str, whole: Mapping[str, Any], cameras: Sequence[str]) -> dict[str, Any]:
    """An operator's fields as a person may mean them; a camera's motion as a `Viewpoint`."""
    if op == "camera_pose":
        one = answers.Viewpoint.model_json_schema()
        one["properties"]["cameras"]["items"] = {"enum": [*map(answers.short, cameras), "static"]}
        one["properties"]["cameras"]["maxItems"] = max(1, len(cameras))
    else:
        one = dict(whole[f"op_{op}"])
    out = ("op", *recipe.CHANCE, *answers.PLACES)
    fields = {name: value for name, value in one["properties"].items() if name not in out}
    required = ["op", *(name for name in one.get("required", []) if name != "op")]
    fixed = {"op": {"const": op}, "weight": {"type": "number", "exclusiveMinimum": 0}}
    return {**one, "properties": fixed | fields, "required": required}


def fields(op: str, whole: Mapping[str, Any]) -> str:
    """An operator's fields in a line: each name, what it takes, and what holds where it is left out.

    `whole` are the definitions of the recipes' schema.
    """
    one = whole[f"op_{op}"]
    told = []
    for name, value in one["properties"].items():
        if name in ("op", *recipe.CHANCE, *answers.PLACES):
            continue
        given = "" if name in one.get("required", []) else f" = {json.dumps(value.get('default'))}"
        told.append(f"{name}: {_taken(value, whole)}{given}")
    return "; ".join(told)


def _taken(value: Mapping[str, Any], whole: Mapping[str, Any]) -> str:
    """What a value of a schema looks like, in few words."""
    if "$ref" in value:
        name = value["$ref"].removeprefix("#/$defs/")
        return "target" if name == "Target" else _taken(whole[name], whole)
    for several in ("anyOf", "oneOf"):
        if several in value:
            kinds = [_taken(one, whole) for one in value[several] if one != {"type": "null"}]
            return " or ".join(dict.fromkeys(kinds))
    if "const" in value or "enum" in value:
        return "|".join(map(str, value.get("enum", [value.get("const")])))
    if value.get("type") == "array":
        items = value.get("prefixItems") or [value["items"]] * value.get("maxItems", 1)
        more = "" if "maxItems" in value else ", ..."
        return f"[{', '.join(_taken(one, whole) for one in items)}{more}]"
    if value.get("type") == "object":
        named = value.get("propertyNames", {}).get("enum", ())
        inner = value.get("properties") or dict.fromkeys(
            named, value.get("additionalProperties", {})
        )
        return "{" + ", ".join(f"{k}: {_taken(one, whole)}" for k, one in inner.items()) + "}"
    if value.get("pattern", "").startswith("^#"):
        return "#rrggbb"
    low = value.get("minimum", value.get("exclusiveMinimum"))
    high = value.get("maximum", value.get("exclusiveMaximum"))
    bounds = "" if low is None and high is None else f" {_side(low)}..{_side(high)}"
    return f"{value.get('type', 'any')}{bounds}"


def _side(bound: float | None) -> str:
    return "" if bound is None else f"{bound:g}"


def _gather(value: Any, whole: Mapping[str, Any], used: dict[str, Any]) -> None:
    """Every definition that a schema refers to."""
    if isinstance(value, dict):
        name = str(value.get("$ref", "")).removeprefix("#/$defs/")
        if name and name not in used:
            used[name] = whole[name]
            _gather(whole[name], whole, used)
        for inner in value.values():
            _gather(inner, whole, used)
    elif isinstance(value, list):
        for inner in value:
            _gather(inner, whole, used)


def plain(schema: Any) -> Any:
    """Without what constrained decoders may not know: titles, descriptions, defaults and formats."""
    if isinstance(schema, list):
        return [plain(value) for value in schema]
    if not isinstance(schema, dict):
        return schema
    out = {}
    for name, value in schema.items():
        if name == "properties" or name == "$defs":
            out[name] = {key: plain(inner) for key, inner in value.items()}
        elif name not in ("title", "description", "default", "format"):
            out[name] = plain(value)
    return out
