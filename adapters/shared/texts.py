"""JSON and YAML files that lie beside recordings. Errors name file and place."""

import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from rpaug import BadInput, files, safe_yaml

Kind = TypeVar("Kind", bound=BaseModel)


def stamp(path: Path) -> tuple[int, int]:
    """What tells one state of a file from another, for those who remember what it said: when it was written, and its
    size. Zeros where there is none."""
    try:
        about = path.stat()
    except OSError:
        return 0, 0
    return about.st_mtime_ns, about.st_size


def read_json(path: Path, expected: str) -> Any:
    """What a JSON file holds. Raises BadInput: `expected` is what it should have been."""
    try:
        return json.loads(files.read_bytes(path))
    except (ValueError, RecursionError) as error:
        raise BadInput(path, "JSON", found=str(error)[:80], expected=expected) from None


def json_bytes(value: Any) -> bytes:
    """A JSON file of plain values, its text as it is read."""
    return (json.dumps(value, indent=1, ensure_ascii=False) + "\n").encode()


def read_yaml(path: Path, kind: type[Kind], most: int) -> Kind:
    """What a YAML file of at most so many values holds. Raises BadInput, naming line or key."""
    try:
        return kind.model_validate(safe_yaml.load(files.read_bytes(path), most)[0])
    except safe_yaml.NotPlain as error:
        line = f"line {error.line}" if error.line else "YAML"
        raise BadInput(path, line, found=error.found, expected=error.expected) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        found = str(first["input"])[:60]
        expected = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        raise BadInput(path, where, found=found, expected=expected) from None
