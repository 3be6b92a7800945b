"""Draw the rooms of the code and who imports whom, from the imports themselves.

    python tools/architecture.py [--out docs/images/architecture.png]

A room is a folder of `rpaug/`; `adapters`, `recipes` and `tools/bench` are rooms beside it. Rows are the layers of the
import contract in pyproject.toml. An arrow that others imply (a -> b -> c implies a -> c) is left out.
`tests/test_architecture.py` holds the same graph to the rules of docs/architecture.md.
"""

import argparse
import ast
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {"rpaug": "rpaug", "rpaug_adapters": "adapters", "rpaug_recipes": "recipes"}
LABELS = {
    "rpaug": "import rpaug\nthe public names",
    "tools/bench": "tools/bench/\nmay import all",
    "recipes": "recipes/\ndata",
}
Graph = dict[str, set[str]]


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Every module by its dotted name; a package goes by the name of its folder."""
    found = {}
    for package, folder in PACKAGES.items():
        for path in sorted((root / folder).rglob("*.py")):
            parts = (package, *path.relative_to(root / folder).with_suffix("").parts)
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(known: Mapping[str, Path]) -> Graph:
    """Which known modules each module imports."""
    return {name: imported(path, known) - {name} for name, path in known.items()}


def imported(path: Path, known: Mapping[str, Path]) -> set[str]:
    """Which known modules a file imports, inside functions as well as at its top."""
    nodes = ast.walk(ast.parse(path.read_text()))
    return {name for node in nodes for name in _imported(node, known)}


def _imported(node: ast.AST, known: Mapping[str, Path]) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name in known)
    if isinstance(node, ast.ImportFrom):
        for alias in node.names:
            full = f"{node.module}.{alias.name}"
            if full in known:
                yield full
            elif node.module in known:
                yield node.module


def room(module: str) -> str:
    """The top-level folder that a module lies in; `rpaug/__init__.py` is the room `rpaug`."""
    package, *rest = module.split(".")
    return rest[0] if package == "rpaug" and rest else PACKAGES[package]


def rooms(graph: Mapping[str, set[str]]) -> Graph:
    """The same graph with every room as one node."""
    found: Graph = {}
    for name, others in graph.items():
        found.setdefault(room(name), set()).update(room(other) for other in others)
    return {name: others - {name} for name, others in found.items()}


def layers(root: Path = ROOT) -> list[list[str]]:
    """The layers of the import contract, highest first; a folder of `scene` is named with its dot."""
    settings = tomllib.loads((root / "pyproject.toml").read_text())
    (contract,) = (
        one for one in settings["tool"]["importlinter"]["contracts"] if one["type"] == "layers"
    )
    return [[part.strip() for part in layer.split("|")] for layer in contract["layers"]]


def cycle(graph: Mapping[str, set[str]]) -> list[str]:
    """One cycle of the graph, its nodes in order; empty if there is none."""
    done: set[str] = set()

    def visit(node: str, path: list[str]) -> list[str]:
        if node in path:
            return path[path.index(node) :]
        if node in done:
            return []
        for other in sorted(graph.get(node, ())):
            if found := visit(other, [*path, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(graph) if (found := visit(node, []))), [])


def reduced(graph: Mapping[str, set[str]]) -> Graph:
    """The arrows of an acyclic graph that no longer way implies."""

    def reached(node: str) -> set[str]:
        return graph[node].union(*(reached(other) for other in graph[node]))

    return {
        node: {
            other
            for other in others
            if not any(other in reached(third) for third in others - {other})
        }
        for node, others in graph.items()
    }


def draw(out: Path) -> None:
    """The picture, as a PNG."""
    import matplotlib.pyplot as plt

    known = modules()
    arrows = rooms(imports(known))
    lines: dict[str, int] = {}
    for name, path in known.items():
        lines[room(name)] = lines.get(room(name), 0) + len(path.read_text().splitlines())
    rows = [["adapters", "tools/bench"]]
    for layer in layers():
        row = list(dict.fromkeys(part.split(".")[0] for part in layer))
        rows.append([name for name in row if not any(name in other for other in rows)])
    rows = [row for row in rows if row]
    rows[1].append("rpaug")
    rows[-1].append("recipes")  # data, read by name
    places = {}
    figure, axes = plt.subplots(figsize=(11, 1.05 * len(rows)))
    for height, row in enumerate(reversed(rows)):
        for number, name in enumerate(row):
            x, y = (number - (len(row) - 1) / 2) * 2.6, 1.0 * height
            places[name] = (x, y)
            label = LABELS.get(name) or f"{name}/\n{lines[name]:,} lines"
            color = "#e8eef7" if name not in ("adapters", *LABELS) else "#f3eee2"
            box = {"boxstyle": "round,pad=0.45", "facecolor": color, "edgecolor": "#556"}
            axes.text(x, y, label, ha="center", va="center", fontsize=9, bbox=box, zorder=3)
    for name, others in reduced(
        {name: {other for other in arrows.get(name, ()) if other in places} for name in places}
    ).items():
        for other in others:
            way = {"arrowstyle": "-|>", "color": "#889", "shrinkA": 16, "shrinkB": 16, "lw": 1.0}
            way["connectionstyle"] = "arc3,rad=0.08"
            axes.annotate("", places[other], places[name], arrowprops=way, zorder=1)
    axes.set_xlim(-5.6, 5.6)
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.axis("off")
    figure.savefig(out, dpi=90, bbox_inches="tight")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs/images/architecture.png")
    draw(parser.parse_args().out)
