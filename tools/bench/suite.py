"""Processor seconds of `make test`, by its parts, and of its tests by folder.

    python -m tools.bench.suite [TESTS ...] [--record before|now]

Runs what `make test` runs, one part after the other, or pytest alone over the given files and folders of tests; adds up
user and system time of every process that was started and waited for. This module is also the plugin of pytest's that
adds up each test's time, with its fixtures. The rest of pytest's is listed as starting: imports and collection, in each
worker. --record writes that column of the table on the benchmarks' page; a run that fails is no figure.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tools.bench.harness import pages

ROOT = Path(__file__).resolve().parents[2]
MODULE = "tools.bench.suite"
LISTENS = "RPAUG_SUITE_SECONDS"  # the folder that each of pytest's processes writes its times into
ADDED = "PYTEST_ADDOPTS"
MOST = 12 * 60  # processor seconds of `make test`
WHOLE, START = "make test", "starting"
TOPIC = "suite"
COLUMNS = ("before", "now")


def spent() -> float:
    """Processor seconds of this process and of those it waited for."""
    return sum(map(of, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))


def of(whom: int) -> float:
    """Processor seconds, of the system's as well."""
    usage = resource.getrusage(whom)
    return usage.ru_utime + usage.ru_stime


class TestTimes:
    """Adds up what each test takes, in one process of pytest's."""

    __test__ = False

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.tests: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Around one test and its fixtures."""
        before = spent()
        try:
            return (yield)
        finally:
            self.tests[item.nodeid] = spent() - before

    def pytest_sessionfinish(self) -> None:
        """Write them down."""
        name = os.environ.get("PYTEST_XDIST_WORKER", "main")
        (self.folder / f"{name}.json").write_text(json.dumps(self.tests))


def pytest_configure(config: pytest.Config) -> None:
    """Called by pytest, of which this module is a plugin then."""
    if LISTENS in os.environ:
        config.pluginmanager.register(TestTimes(Path(os.environ[LISTENS])))
        if "PYTEST_XDIST_WORKER" in os.environ or not config.getoption("numprocesses", None):
            for name in (LISTENS, ADDED):  # tests run here, and may run pytest themselves
                os.environ.pop(name, None)


def part(command: Sequence[str], **variables: str) -> float:
    """Processor seconds of one command. Raises CalledProcessError if it fails."""
    before = of(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=ROOT, env=os.environ | variables, check=True)
    return of(resource.RUSAGE_CHILDREN) - before


def tested(command: Sequence[str]) -> tuple[float, dict[str, float]]:
    """Processor seconds of a command that runs pytest, and of each test."""
    tests: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        seconds = part(command, **{LISTENS: folder, ADDED: f"-p {MODULE}"})
        for path in Path(folder).glob("*.json"):
            tests |= json.loads(path.read_text())
    return seconds, tests


def measured(chosen: Sequence[str]) -> dict[str, float]:
    """The rows of the table and their seconds: of `make test`, or of the chosen tests alone."""
    if chosen:
        seconds, tests = tested([sys.executable, "-m", "pytest", *chosen])
        return {"pytest": seconds} | grouped(seconds, tests, by_file=True)
    parts = {f"make {name}": part(["make", name]) for name in ("check", "wheel")}
    seconds, tests = tested(["make", "unit"])
    whole = seconds + sum(parts.values())
    return {WHOLE: whole, **parts, "make unit": seconds} | grouped(seconds, tests)


def grouped(seconds: float, tests: dict[str, float], by_file: bool = False) -> dict[str, float]:
    """What pytest spent outside of tests, and what tests took by folder or by file, the most first."""
    found: dict[str, float] = defaultdict(float)
    for test, taken in tests.items():
        file = test.split("::")[0]
        found[file if by_file else "/".join(file.split("/")[:2])] += taken
    rest = seconds - sum(found.values())
    return {START: rest, **dict(sorted(found.items(), key=lambda one: -one[1]))}


def table(
    known: pages.Table | None, column: str, found: dict[str, float], chosen: Sequence[str]
) -> pages.Table:
    """Figures of one column beside those of the other, if they are known."""
    other = {} if known is None else {str(row[0]): list(row) for row in known.rows}
    place, lines = 1 + COLUMNS.index(column), []
    for name, seconds in found.items():
        cells: list[pages.Cell] = [*other.get(name, [name, "-", "-"])]
        value = f"{seconds:.1f}"
        bounded = name == WHOLE and column == "now"
        cells[place] = {"value": value, "target": f"<= {MOST}"} if bounded else value
        lines.append(cells)
    stamp = pages.stamp()
    before = f"one run of each, other work beside; before: {stamp['commit']}"
    return pages.Table(
        id=table_of(chosen),
        title="What tests take, processor s",
        command=" ".join(["python -m", MODULE, *chosen]),
        seeds=before if known is None or column == "before" else known.seeds,
        columns=["part", *COLUMNS],
        rows=lines,
        **stamp,
    )


def table_of(chosen: Sequence[str]) -> str:
    """The table on the page: one for `make test`, one for chosen tests."""
    return "chosen" if chosen else "suite"


def main() -> None:
    """Measure, print, and record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tests", nargs="*", help="these alone, in one process")
    parser.add_argument("--record", choices=COLUMNS, help="the column of the page to write")
    given = parser.parse_args()
    found = measured(given.tests)
    for name, seconds in found.items():
        print(f"{name:48}{seconds:8.1f}")
    if given.record:
        tables = {one.id: one for one in pages.load(TOPIC).tables}
        known = tables.get(table_of(given.tests))
        pages.record(TOPIC, table(known, given.record, found, given.tests))


if __name__ == "__main__":
    main()
