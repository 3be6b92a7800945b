"""The pages of docs/benchmarks: their tables, and the index's lines, are written from the committed results.

    python -m tools.bench.harness.pages [--check]

docs/benchmarks/results/TOPIC.json holds a topic's title, headline and tables; docs/benchmarks/TOPIC.md holds its prose
and a pair of markers for each table, `<!-- table: ID -->` and `<!-- end -->`. --check writes nothing and fails if a
page is not what its results say. A bench adds its table, or replaces it, by `record`.
"""

import argparse
import json
import operator
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from pathlib import Path

DOCS = Path(__file__).parents[3] / "docs"
TOPIC = r"^- \[[^]]*\]\(benchmarks/(\w+)\.md\).*$"  # a topic's line in the index
MARKED = r"(<!-- {} -->\n).*?(<!-- end -->)"
USUAL = (
    "2 cores"  # the machine that the index describes; where another one measured, its table says so
)
FIGURE = re.compile(r"\{(.+?)\|(.+?)\|(.+?)\}")  # {table|row|column} in a headline
COMPARED = {">=": operator.ge, "<=": operator.le}
SHOWN = {">=": "≥", "<=": "≤"}

# A figure with a target is {"value": 30.4, "target": ">= 31"}.
Cell = str | int | float | Mapping[str, str | float]


@dataclass(frozen=True, kw_only=True)
class Table:
    """Figures of one command: where, when and at which commit they were measured stands with them."""

    id: str
    title: str
    command: str
    commit: str
    date: str
    machine: str
    seeds: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]

    def find(self, row: str, column: str) -> Cell:
        """One figure, by what its row begins with and by its column's name."""
        (found,) = (cells for cells in self.rows if cells[0] == row)
        return found[self.columns.index(column)]

    def misses(self) -> Iterator[str]:
        """What misses its target: row, column, figure."""
        for cells in self.rows:
            for column, cell in zip(self.columns, cells, strict=True):
                if isinstance(cell, Mapping) and not met(cell):
                    yield f"{cells[0]}, {column}: {plain(cell)} ({goal(cell)})"

    def half(self) -> str:
        """The half of the cases with which every row begins ("worked: ") where the title names it too."""
        (begun, *others) = {str(row[0]).partition(": ")[0] for row in self.rows}
        return "" if others or begun not in self.title else f"{begun}: "

    def run(self) -> str:
        """What measured it, at which commit, when and where."""
        usual = self.machine.startswith(USUAL) and not self.machine.startswith(f"{USUAL},")
        machine = "" if usual else f"; {self.machine}"
        return f"`{self.command}`; {self.commit} {self.date}{machine}"

    def origin(self, before: "Table | None") -> str:
        """Its run and seeds, or that they are those of the table before it."""
        if before is None or before.run() != self.run():
            return f"{self.run()}; {self.seeds}"
        return "Measured as above" + ("." if before.seeds == self.seeds else f"; {self.seeds}")

    def markdown(self, before: "Table | None" = None) -> str:
        """The table under its title, its origin below."""
        said = self.half()
        rows = [
            self.columns,
            ["---"] * len(self.columns),
            *([shown(c).removeprefix(said) for c in r] for r in self.rows),
        ]
        body = "\n".join(f"|{'|'.join(cells)}|" for cells in rows)
        return f"**{self.title}**\n\n{body}\n\n{self.origin(before)}\n"


@dataclass(frozen=True)
class Topic:
    """A page's title, its figure for the index, and its tables."""

    title: str
    headline: str  # names figures as {table|row|column}
    tables: Sequence[Table]

    def line(self, name: str) -> str:
        """Its line in the index."""
        tables = {table.id: table for table in self.tables}
        said = FIGURE.sub(lambda m: plain(tables[m[1]].find(m[2], m[3])), self.headline)
        missed = sum(len(list(table.misses())) for table in self.tables)
        count = f"; **{missed} missed**" if missed else ""
        return f"- [{self.title}](benchmarks/{name}.md): {said}{count}"


def met(cell: Mapping[str, str | float]) -> bool:
    """Whether a figure reaches its target."""
    how, bound = str(cell["target"]).split()
    return bool(COMPARED[how](float(cell["value"]), float(bound)))


def goal(cell: Mapping[str, str | float]) -> str:
    """A target in words."""
    how, bound = str(cell["target"]).split()
    return f"{SHOWN[how]}{bound}"


def plain(cell: Cell) -> str:
    """A figure without its target."""
    return str(cell["value"] if isinstance(cell, Mapping) else cell)


def shown(cell: Cell) -> str:
    """A figure with its target, in bold where it misses it."""
    if not isinstance(cell, Mapping):
        return str(cell)
    return (
        f"{cell['value']} ({goal(cell)})"
        if met(cell)
        else f"**{cell['value']} missed** ({goal(cell)})"
    )


def stamp() -> dict[str, str]:
    """Commit, date and machine of what is measured now."""
    commit = subprocess.check_output(
        ["git", "rev-parse", "--short", "HEAD"], cwd=DOCS, text=True
    ).strip()
    machine = f"{os.cpu_count()} cores {platform.machine()}, Python {platform.python_version()}"
    return {"commit": commit, "date": date.today().isoformat(), "machine": machine}


def load(name: str, docs: Path = DOCS) -> Topic:
    """A topic's committed results."""
    read = json.loads((docs / "benchmarks/results" / f"{name}.json").read_text())
    return Topic(read["title"], read["headline"], [Table(**table) for table in read["tables"]])


def names(docs: Path = DOCS) -> list[str]:
    """All topics that have results."""
    return sorted(path.stem for path in (docs / "benchmarks/results").glob("*.json"))


def record(name: str, table: Table, docs: Path = DOCS) -> None:
    """Puts the table in place of the topic's one with its id, or after the others."""
    topic = load(name, docs)
    others = {one.id: one for one in topic.tables}
    save(name, replace(topic, tables=list((others | {table.id: table}).values())), docs)


def save(name: str, topic: Topic, docs: Path = DOCS) -> None:
    """Writes a topic's results, a row a line, so that a change of one figure is a change of one line."""
    tables = []
    for table in topic.tables:
        fields = asdict(table)
        rows = ",\n".join(f"    {_json(row)}" for row in fields.pop("rows"))
        head = "".join(f"   {_json(key)}: {_json(value)},\n" for key, value in fields.items())
        tables.append(f'  {{\n{head}   "rows": [\n{rows}\n   ]\n  }}')
    head = f' "title": {_json(topic.title)},\n "headline": {_json(topic.headline)},\n'
    text = f'{{\n{head} "tables": [\n' + ",\n".join(tables) + "\n ]\n}\n"
    (docs / "benchmarks/results" / f"{name}.json").write_text(text)


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def pages(docs: Path = DOCS) -> dict[Path, str]:
    """Every page and what it should say: prose as it stands, tables and lines anew."""
    topics = {name: load(name, docs) for name in names(docs)}
    index = docs / "benchmarks.md"
    text = re.sub(TOPIC, lambda m: topics[m[1]].line(m[1]), index.read_text(), flags=re.MULTILINE)
    out = {index: text}
    for name, topic in topics.items():
        page = docs / "benchmarks" / f"{name}.md"
        out[page] = page.read_text()
        tables = sorted(topic.tables, key=lambda table: out[page].find(f"<!-- table: {table.id} "))
        for before, table in zip([None, *tables], tables, strict=False):
            out[page] = _marked(page, out[page], f"table: {table.id}", table.markdown(before))
    return out


def _marked(page: Path, text: str, marker: str, body: str) -> str:
    where = re.compile(MARKED.format(re.escape(marker)), re.DOTALL)
    text, found = where.subn(lambda m: m[1] + body + m[2], text)
    if found != 1:
        raise ValueError(f"{page}: {found} places for {marker!r}, not one")
    return text


def main() -> None:
    """Write the pages, or say which are not what their results say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="write nothing, fail if a page is stale"
    )
    given = parser.parse_args()
    stale = {page: text for page, text in pages().items() if page.read_text() != text}
    for page, text in stale.items():
        print(
            f"{page.relative_to(DOCS.parent)}: {'not what its results say' if given.check else 'written'}"
        )
        if not given.check:
            page.write_text(text)
    sys.exit(1 if given.check and stale else 0)


if __name__ == "__main__":
    main()
