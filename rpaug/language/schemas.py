"""JSON Schemas that a language model's answers are held to: of plans, of camera motions, of an operator's edits."""

from collections.abc import Mapping
from typing import Any

from rpaug.core import registry
from rpaug.language import answers
from rpaug.pipeline import recipe


def of_plan() -> dict[str, Any]:
    schema = answers.WishPlan.model_json_schema()
    schema["$defs"]["WishStep"]["properties"]["op"] = {"enum": registry.operator_names()}
    return schema


def of_viewpoint(cameras: tuple[str, ...]) -> dict[str, Any]:
    """The schema of a camera's motion: only cameras that there are."""
    schema = answers.Viewpoint.model_json_schema()
    schema["properties"]["cameras"]["items"] = {"enum": [*map(answers.short, cameras), "static"]}
    schema["properties"]["cameras"]["maxItems"] = max(1, len(cameras))
    return schema


def of_edits(op: str) -> dict[str, Any]:
    whole = recipe.schema()["$defs"]
    one = {name: value for name, value in whole[f"op_{op}"].items() if name != "title"}
    one["properties"] = {"op": {"const": op}} | {
        name: value
        for name, value in one["properties"].items()
        if name not in ("op", "probability")
    }
    schema = {
        "type": "object",
        "properties": {"edits": {"type": "array", "items": one, "minItems": 1, "maxItems": 30}},
        "required": ["edits"],
        "additionalProperties": False,
    }
    used: dict[str, Any] = {}
    _gather(schema, whole, used)
    return schema | ({"$defs": used} if used else {})


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
