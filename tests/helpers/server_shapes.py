"""Four servers as their documents describe them: what each takes and refuses, and how its replies and errors look.

OpenAI's rules of strict schemas are those of its page "Structured outputs", read independently of our own conversion.
A server is `play(handler, n, body, stated)`: it answers the JSON `stated`, or refuses the request.
"""

import json
from collections.abc import Callable, Mapping
from typing import Any

from endpoints import Handler

TYPES = {"string", "number", "boolean", "integer", "object", "array", "null"}
KNOWN = {
    "type", "properties", "required", "additionalProperties", "items", "anyOf", "enum", "const", "$ref", "$defs",
    "description", "pattern", "format", "multipleOf", "maximum", "exclusiveMaximum", "minimum", "exclusiveMinimum",
    "minItems", "maxItems",
}  # fmt: skip
FORMATS = {"date-time", "time", "date", "duration", "email", "hostname", "ipv4", "ipv6", "uuid"}
Play = Callable[[Handler, Mapping[str, Any], Any], None]


def strict_fault(schema: Mapping[str, Any]) -> str | None:
    """What OpenAI's strict mode refuses of a schema, in its words; None where it takes it."""
    if schema.get("type") != "object" or "anyOf" in schema:
        return "schema must be a JSON Schema of 'type: \"object\"'"
    properties = enums = 0
    todo: list[tuple[tuple[str, ...], Mapping[str, Any], int]] = [((), schema, 0)]
    while todo:
        where, node, level = todo.pop()
        if "$ref" in node:
            if set(node) != {"$ref"}:
                return f"In context={where}, $ref cannot have keywords {set(node) - {'$ref'}}"
            if node["$ref"].removeprefix("#/$defs/") not in schema.get("$defs", {}):
                return f"In context={where}, reference to component {node['$ref']!r} was not found"
            continue
        if extra := set(node) - KNOWN:
            return f"In context={where}, {sorted(extra)[0]!r} is not permitted"
        kinds = node.get("type")
        kinds = kinds if isinstance(kinds, list) else [kinds]
        if "anyOf" not in node and not set(kinds) <= TYPES:
            return f"In context={where}, schema must have a 'type' key"
        if node.get("format", "date") not in FORMATS:
            return f"In context={where}, {node['format']!r} is not a valid format"
        if "array" in kinds and not isinstance(node.get("items"), dict):
            return f"In context={where}, array schema missing items"
        if "object" in kinds:
            if node.get("additionalProperties") is not False:
                return f"In context={where}, 'additionalProperties' is required to be supplied and to be false"
            if sorted(node.get("required", ())) != sorted(node.get("properties", {})):
                return (
                    f"In context={where}, 'required' is required to be supplied and to be an array"
                    " including every key in properties"
                )
        firsts = [
            (name, json.dumps(one["properties"][name].get("enum")))
            for one in (_resolved(branch, schema) for branch in node.get("anyOf", ()))
            for name in list(one.get("properties", ()))[:1]
        ]
        if len(set(firsts)) < len(firsts):
            return f"In context={where}, objects provided via 'anyOf' must not share identical first keys"
        properties += len(node.get("properties", ()))
        enums += len(node.get("enum", ()))
        deeper = level + ("object" in kinds)
        if properties > 5000 or enums > 1000 or deeper > 10:
            return f"In context={where}, the schema exceeds a limit"
        inner = [*node.get("properties", {}).items(), *enumerate(node.get("anyOf", ()))]
        inner += [("items", node["items"])] if "items" in node else []
        todo += [((*where, str(name)), one, deeper) for name, one in inner]
        todo += [((name,), one, 1) for name, one in node.get("$defs", {}).items()]
    return None


def _resolved(node: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    name = str(node.get("$ref", "")).removeprefix("#/$defs/")
    return root["$defs"][name] if name else node


def filled(value: Any, schema: Mapping[str, Any], root: Mapping[str, Any]) -> Any:
    """The value as strict decoding would say it: null where a property is left out."""
    node = _resolved(schema, root)
    branches = [_resolved(one, root) for one in node.get("anyOf", [node])]
    if isinstance(value, dict):
        for one in branches:
            fields = one.get("properties", {})
            tags = all(
                value[name] in fields[name].get("enum", [value[name]])
                for name in value
                if name in fields
            )
            if one.get("type") == "object" and value.keys() <= fields.keys() and tags:
                return {
                    name: filled(value[name], field, root) if name in value else None
                    for name, field in fields.items()
                }
    if isinstance(value, list):
        for one in branches:
            if one.get("type") == "array":
                return [filled(item, one["items"], root) for item in value]
    return value


def reply(handler: Handler, message: Mapping[str, Any], **more: Any) -> None:
    """A completion of this message, by default one that ended well."""
    choice = {"index": 0, "message": {"role": "assistant", **message}, "finish_reason": "stop"}
    whole = {"id": "chatcmpl-1", "object": "chat.completion", "choices": [choice | more]}
    usage = {"prompt_tokens": 10, "completion_tokens": 5, "total_tokens": 15}
    handler.answer(json.dumps(whole | {"usage": usage}).encode())


def refuse(handler: Handler, status: int, error: Any) -> None:
    handler.answer(json.dumps(error).encode(), status)


def openai(handler: Handler, body: Mapping[str, Any], stated: Any) -> None:
    """A reasoning model: no `max_tokens`, no temperature but 1, strict schemas by the rules."""

    def fault(message: str, param: str) -> None:
        error = {"message": message, "type": "invalid_request_error", "param": param, "code": None}
        refuse(handler, 400, {"error": error})

    if "max_tokens" in body:
        words = "Unsupported parameter: 'max_tokens' is not supported with this model."
        return fault(f"{words} Use 'max_completion_tokens' instead.", "max_tokens")
    if body.get("temperature", 1) != 1:
        words = "Unsupported value: 'temperature' does not support 0 with this model."
        return fault(f"{words} Only the default (1) value is supported.", "temperature")
    form = body.get("response_format", {"type": "text"})
    if form["type"] == "json_schema" and form["json_schema"]["strict"]:
        schema = form["json_schema"]["schema"]
        if wrong := strict_fault(schema):
            name = form["json_schema"]["name"]
            return fault(f"Invalid schema for response_format {name!r}: {wrong}", "response_format")
        stated = filled(stated, schema, schema)
    if form["type"] == "json_object" and "json" not in json.dumps(body["messages"]).lower():
        return fault("'messages' must contain the word 'json' in some form", "messages")
    return reply(handler, {"content": json.dumps(stated), "refusal": None, "annotations": []})


def llama_cpp(handler: Handler, body: Mapping[str, Any], stated: Any) -> None:
    """A build without `json_schema` and --jinja: it answers 500 to both; thoughts come before the answer."""
    form = body.get("response_format", {}).get("type", "")
    if "tools" in body or form not in ("", "text", "json_object"):
        words = f'response_format type must be one of "text" or "json_object", but got: {form}'
        words = "tools param requires --jinja flag" if "tools" in body else words
        return refuse(
            handler, 500, {"error": {"code": 500, "message": words, "type": "server_error"}}
        )
    return reply(handler, {"content": f"<think>\nA {{plan}}.\n</think>\n\n{json.dumps(stated)}"})


def vllm(handler: Handler, body: Mapping[str, Any], stated: Any) -> None:
    """A server with no guided decoding that forbids what it does not know, and calls the tool that it is given."""

    def fault(message: str) -> None:
        error = {"object": "error", "message": message, "type": "BadRequestError", "param": None}
        refuse(handler, 400, error | {"code": 400})

    if "response_format" in body:
        return fault(
            "[{'type': 'extra_forbidden', 'loc': ('body', 'response_format'), 'msg': 'Extra inputs are not permitted', "
            "'input': {'temperature': 'max_tokens'}}]"
        )
    if body.get("max_tokens", body.get("max_completion_tokens", 0)) > 1096:
        return fault(
            "'max_tokens' or 'max_completion_tokens' is too large: 2048. This model's maximum context length is 4096 "
            "tokens and your request has 3000 input tokens"
        )
    if "tools" not in body:
        return reply(handler, {"content": f"Sure:\n```json\n{json.dumps(stated)}\n```\nEnjoy!"})
    function = {"name": body["tools"][0]["function"]["name"], "arguments": json.dumps(stated)}
    message = {"content": None, "reasoning_content": "Hm {", "refusal": None}
    calls = [{"id": "call_1", "type": "function", "function": function}]
    return reply(handler, message | {"tool_calls": calls}, finish_reason="tool_calls")


def ollama(handler: Handler, body: Mapping[str, Any], stated: Any) -> None:
    """It ignores what it does not know, a schema among it: JSON comes in a fence, first without the right keys."""
    if body.get("tools"):
        words = "registry.ollama.ai/library/small:latest does not support tools"
        error = {"message": words, "type": "invalid_request_error", "param": None, "code": None}
        return refuse(handler, 400, {"error": error})
    told = "JSON schema" in json.dumps(body["messages"])
    words = f"```json\n{json.dumps(stated if told else {'answer': 'of course'})}\n```"
    return reply(handler, {"content": words, "reasoning": "Let me see."})


SHAPES: dict[str, Play] = {
    "openai": openai, "llama.cpp": llama_cpp, "vllm": vllm, "ollama": ollama,
}  # fmt: skip
