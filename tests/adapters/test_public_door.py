"""The adapters that ship see of rpaug what a third party's may: the names that `import rpaug` promises."""

import ast
from pathlib import Path
from types import ModuleType

import pytest

import rpaug

ADAPTERS = Path(__file__).parents[2] / "adapters"
MODULES = {name for name in rpaug.__all__ if isinstance(getattr(rpaug, name), ModuleType)}
SOURCES = sorted(path.relative_to(ADAPTERS).as_posix() for path in ADAPTERS.rglob("*.py"))


def not_promised(source: str) -> list[str]:
    """What an adapter's source takes from rpaug, in functions too, that is in no `__all__`."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                found += [one.name for one in names if one.name.startswith("rpaug.")]
            case ast.ImportFrom(module="rpaug", names=names):
                found += [one.name for one in names if one.name not in rpaug.__all__]
            case ast.ImportFrom(module=str(module)) if module.startswith("rpaug."):
                found.append(module)
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if name in MODULES:
                if attribute not in getattr(rpaug, name).__all__:
                    found.append(f"{name}.{attribute}")
            case ast.Attribute(value=ast.Name(id="rpaug"), attr=attribute):
                if attribute not in rpaug.__all__:
                    found.append(attribute)
    return found


@pytest.mark.parametrize("source", SOURCES)
def test_an_adapter_comes_in_by_the_public_door(source: str) -> None:
    assert not_promised((ADAPTERS / source).read_text()) == []


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("from rpaug.core.files import read_bytes", "rpaug.core.files"),
        ("def late():\n    import rpaug.core.geometry", "rpaug.core.geometry"),
        ("from rpaug import core", "core"),
        ("from rpaug import files\nfiles.apart(a, b)", "files.apart"),
        ("import rpaug\nrpaug.core", "core"),
    ],
)
def test_what_is_not_promised_is_found(line: str, found: str) -> None:
    assert not_promised(line) == [found]


def test_every_promised_name_is_there() -> None:
    for name in rpaug.__all__:
        for held in getattr(getattr(rpaug, name), "__all__", []) if name in MODULES else ():
            assert hasattr(getattr(rpaug, name), held), f"rpaug.{name}.{held}"
