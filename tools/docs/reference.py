"""Reference pages of the site, made from the code: recipe keys, operators' fields, Python names, commands."""

import inspect
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

import typer

import rpaug
from rpaug import training
from rpaug.cli import COMMANDS, GROUPS, app
from rpaug.core import registry
from rpaug.pipeline import recipe

Schema = Mapping[str, Any]
BOUNDS = {
    "minimum": "≥ {}",
    "exclusiveMinimum": "> {}",
    "maximum": "≤ {}",
    "exclusiveMaximum": "< {}",
    "minLength": "at least {} letters",
    "minItems": "at least {}",
    "maxItems": "at most {}",
}


def kind(schema: Schema) -> str:
    """A schema in words: `one of "a", "b"`, `list of numbers`, `number ≥ 0`."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}](recipe-reference.md#{name.lower()})"
    if found := schema.get("anyOf") or schema.get("oneOf"):
        return " or ".join(dict.fromkeys(kind(one) for one in found))
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return "one of " + ", ".join(f"`{json.dumps(one)}`" for one in schema["enum"])
    of = schema.get("items") or schema.get("prefixItems", [{}])[0]
    words = {
        "null": "none",
        "array": f"list of {kind(of)}" if of else "list",
        "object": "mapping",
    }.get(schema.get("type", "anything"), schema.get("type", "anything"))
    bounds = [said.format(schema[key]) for key, said in BOUNDS.items() if key in schema]
    return " ".join([words, *([", ".join(bounds)] if bounds else [])])


def fields(schema: Schema) -> str:
    """The keys of a mapping as a table: key, what it takes, its default."""
    required = schema.get("required", ())
    rows = ["|key|takes|default|", "|---|---|---|"]
    for key, one in schema.get("properties", {}).items():
        default = "required" if key in required else f"`{json.dumps(one.get('default'))}`"
        rows.append(f"|`{key}`|{kind(one).replace('|', chr(92) + '|')}|{default}|")
    return "\n".join(rows) + "\n"


def recipe_page() -> str:
    """Every key that a recipe takes, from its JSON Schema; operators have pages of their own."""
    schema = recipe.schema()
    top = {**schema, "properties": {**schema["properties"]}}
    top["properties"]["edits"] = {"type": "array", "default": []}
    operators = ", ".join(f"[`{name}`](operators/{name}.md)" for name in registry.operator_names())
    parts = [
        "# Recipe reference",
        "From the JSON Schema that `rpaug validate-recipe --schema` prints. What keys mean: [recipes](recipes.md).",
        fields(top),
        f"An entry of `edits` has `op`, one of {operators}, the fields of that operator, and `probability`; or "
        "`one_of`, a list of such entries with a `weight` each.",
    ]
    for name, one in sorted(schema["$defs"].items()):
        if not name.startswith(("op_", "one_of")):
            parts += [f"## {name}", *_told(one)]
    return "\n\n".join(parts) + "\n"


def _told(schema: Schema) -> Iterator[str]:
    if words := schema.get("description"):
        yield words
    yield fields(schema) if "properties" in schema else kind(schema) + "."


def operator_fields(name: str) -> str:
    """An operator's fields, from the same schema."""
    schema = recipe.schema()["$defs"][f"op_{name}"]
    own = {
        key: one for key, one in schema["properties"].items() if key not in ("op", "probability")
    }
    return fields({**schema, "properties": own}).replace(
        "(recipe-reference.md", "(../recipe-reference.md"
    )


def python_page() -> str:
    """Every public name: signature and docstring, and the methods and fields of classes."""
    parts = [
        "# Python reference",
        "How they go together: [in Python](python.md), [training](training.md).",
    ]
    for module in (rpaug, training):
        parts.append(f"## {module.__name__}")
        for name in sorted(module.__all__, key=str.lower):
            parts += _entry(name, getattr(module, name))
    return "\n\n".join(parts) + "\n"


def _entry(name: str, value: Any, level: str = "###") -> Iterator[str]:
    yield f"{level} {name}"
    if callable(value) and (signature := _signature(value)):
        yield f"```python\n{name}{signature}\n```"
    if not isinstance(value, (str, tuple, dict)) and (words := inspect.getdoc(value)):
        yield words.replace("<", "&lt;")
    if inspect.isclass(value):
        for own, method in vars(value).items():
            if inspect.isfunction(method) and not own.startswith("_") and method.__doc__:
                yield from _entry(f"{name}.{own}", method, "####")


def _signature(value: Any) -> str:
    try:
        return re.sub(r"(?:\w+\.)+(\w+)", r"\1", str(inspect.signature(value)))
    except (TypeError, ValueError):  # enumerations and contracts for tests have none that helps
        return ""


def commands_page(introduction: str) -> str:
    """The page of commands as it is written, and below it every option of each."""
    listed = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    parts = [introduction.rstrip(), "## Every option"]
    for name in COMMANDS:
        parts += _command(name, listed[name])
    for group, (words, names) in GROUPS.items():
        parts.append(f"### rpaug {group}\n\n{words}")
        for name in names:
            parts += _command(f"{group} {name}", listed[group].commands[name])
    return "\n\n".join(parts) + "\n"


def _command(name: str, listed: Any) -> Iterator[str]:
    loaded = typer.Typer(add_completion=False)
    loaded.command(name)(listed.callback())
    command = typer.main.get_command(loaded)
    yield f"### rpaug {name}"
    yield " ".join((listed.help or "").split())
    rows = ["|option|what it does|", "|---|---|"]
    for one in command.params:
        shown = " ".join(one.opts) if one.param_type_name == "option" else one.name.upper()
        rows.append(f"|`{shown}`|{_cell(getattr(one, 'help', None) or '')}|")
    yield "\n".join(rows)


def _cell(words: str) -> str:
    return " ".join(words.split()).replace("|", "\\|").replace("<", "&lt;")
