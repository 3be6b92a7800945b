"""The house keeps its rules: few rooms, imports point down, no cycle, doors, nothing too small or too long.

import-linter proves the layers; here stands what its contract cannot say (docs/architecture.md).
"""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

from tools import architecture

MODULES = architecture.modules()
ROOT = architecture.ROOT
SMALL, FEW = (
    60,
    15,
)  # lines of a module that only one other imports, and how many such modules there may be
LONG = 60  # lines of a function; a longer one says why in a comment that begins with "Long:"


@pytest.fixture(scope="module")
def graph() -> architecture.Graph:
    """Read when a test asks: every worker collects this file, and one runs it."""
    return architecture.imports(MODULES)


def test_the_top_level_holds_the_public_names_alone() -> None:
    files = {path.name for path in (ROOT / "rpaug").iterdir() if path.is_file()}
    assert files == {"__init__.py", "__main__.py", "py.typed"}


def test_there_are_at_most_twenty_rooms() -> None:
    rooms = {path.name for path in (ROOT / "rpaug").iterdir() if (path / "__init__.py").exists()}
    assert 10 < len(rooms) + 3 <= 20  # beside them: adapters, recipes, tools/bench


def test_no_modules_import_each_other_in_a_ring(graph: architecture.Graph) -> None:
    assert architecture.cycle(graph) == []


def test_no_rooms_import_each_other_in_a_ring(graph: architecture.Graph) -> None:
    assert architecture.cycle(architecture.rooms(graph)) == []


def test_no_arrow_points_up(graph: architecture.Graph) -> None:
    level = {
        name: height
        for height, layer in enumerate(reversed(architecture.layers()))
        for name in layer
    }

    def of(module: str) -> int | None:
        parts = module.removeprefix("rpaug.").split(".")
        return level.get(".".join(parts[:2]), level.get(parts[0]))

    for name, others in graph.items():
        for other in others:
            if name.startswith("rpaug.") and other.startswith("rpaug."):
                mine, theirs = of(name), of(other)
                assert mine is not None, name
                assert theirs is not None, other
                assert theirs <= mine, f"{name} -> {other}"


def test_every_folder_of_the_scene_is_a_layer() -> None:
    listed = {name for layer in architecture.layers() for name in layer}
    parts = {name.split(".")[2] for name in MODULES if name.startswith("rpaug.scene.")}
    assert {f"scene.{part}" for part in parts} <= listed


def test_a_ring_would_be_found() -> None:
    assert architecture.cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c"]


def test_modules_that_one_other_imports_are_not_small(graph: architecture.Graph) -> None:
    users = Counter(other for others in graph.values() for other in others)
    small = [
        name
        for name, path in MODULES.items()
        if users[name] == 1
        and path.name != "__init__.py"
        and len(path.read_text().splitlines()) < SMALL
    ]
    assert len(small) <= FEW, small


@pytest.mark.parametrize("folder", ["rpaug", "adapters"])
def test_long_functions_say_why(folder: str) -> None:
    for path in sorted((ROOT / folder).rglob("*.py")):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and node.end_lineno is not None:
                lines = text.splitlines()[node.lineno - 2 : node.end_lineno]
                if node.end_lineno - node.lineno + 1 > LONG:
                    assert any(re.search(r"# Long: \w+", line) for line in lines), (path, node.name)


def test_class_names_are_unique() -> None:
    named = Counter(
        node.name
        for path in MODULES.values()
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in named.items() if count > 1] == []


def test_outsiders_use_only_the_modules_that_a_room_names(graph: architecture.Graph) -> None:
    doors = {
        path.parent.relative_to(ROOT / "rpaug").as_posix().replace("/", "."): _named(path)
        for path in (ROOT / "rpaug").glob("*/**/__init__.py")
    }
    for name, others in graph.items():
        for other in others:
            parts = other.split(".")
            home = next(
                (end for end in range(len(parts) - 1, 1, -1) if ".".join(parts[1:end]) in doors), 0
            )
            if home and not name.startswith(".".join(parts[:home])):
                door = doors[".".join(parts[1:home])]
                assert parts[home] in door, f"{name} -> {other}: not named by {parts[home - 1]}"


def _named(path: Path) -> set[str]:
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return {str(ast.literal_eval(one)) for one in getattr(node.value, "elts", [])}
    return set()


def test_test_files_have_names_of_their_own() -> None:
    """pytest imports them by their base names: of two alike it runs one."""
    names = Counter(path.name for path in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []
