"""Plant bugs one at a time, each in a copy of the checkout that is thrown away, and see whether a test notices.

    python -m tools.planted [LIST] [--part first] [--only NAME] [--far [TESTS ...]] [--out FILE] [--record]

LIST is a TOML file, a table a bug: `file`, `old` text that stands there once, `new` text, what a user `suffers`, and
the `part` of the list that it belongs to. The nearest tests run first, bug by bug: of the folder that mirrors the
module those that import it over the fewest steps. With --far the rest of that folder and those that import the module,
or one that does, or the named files, run once with all bugs planted that nothing told. A bug is noticed by a test that
fails with it and passes without it. No real recordings are read.

FILE keeps what came of each try, with its commit; what was noticed is not tried again. --record writes the figures of
FILE onto the benchmarks' page: the first try of each bug is how the tests were, the last how they are.
"""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path

from tools import architecture
from tools.bench.harness import pages

ROOT = Path(__file__).resolve().parent.parent
LIST = ROOT / "tools" / "planted.toml"
TARGET = 95  # per cent noticed
MOST_MINUTES = 20  # of one run of pytest; a bug that hangs it is noticed
MISLEADING = {"RPAUG_TEST_DATA", "RPAUG_READERS", "PYTHONPATH"}
FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)
HUNG = "no end"
FAR = 100  # imports
Tries = dict[str, list[dict[str, str | None]]]


@dataclass(frozen=True, kw_only=True)
class PlantedBug:
    """One wrong place, and what a user would see of it."""

    name: str
    part: str
    file: str
    old: str
    new: str
    suffers: str

    def planted(self, root: Path) -> str:
        """The file's text with the bug. Raises ValueError unless the old text stands there once."""
        text = (root / self.file).read_text()
        if (found := text.count(self.old)) != 1 or self.old == self.new:
            raise ValueError(f"{self.name}: {found} places in {self.file}; expected one to change")
        return text.replace(self.old, self.new)


def read(path: Path) -> list[PlantedBug]:
    """The bugs of a list."""
    return [PlantedBug(name=name, **one) for name, one in tomllib.loads(path.read_text()).items()]


def stages(file: str, root: Path = ROOT) -> list[list[str]]:
    """Test files in the order in which they are run for a module: each stage after those before found nothing."""
    known, graph, tests = _imports(root)
    (module,) = (name for name, path in known.items() if path == root / file)
    far = _distances(module, graph)
    home = root / "tests" / Path(file).relative_to("rpaug" if file.startswith("rpaug") else ".")
    while not home.is_dir():
        home = home.parent
    steps = {
        name: min((far.get(one, FAR) for one in used), default=FAR) for name, used in tests.items()
    }
    steps |= {name: 0 for name in tests if Path(name).name == f"test_{Path(file).stem}.py"}
    nearest = sorted(tests, key=steps.__getitem__)
    mirror = [name for name in nearest if (root / name).is_relative_to(home)]
    least = min((steps[name] for name in mirror), default=0)
    first = [name for name in mirror if steps[name] == least < FAR]
    others = [name for name in nearest if name not in mirror and steps[name] <= 1]
    return [first, mirror[len(first) :], others]


def _distances(module: str, graph: architecture.Graph) -> dict[str, int]:
    """Over how many imports other modules come to this one."""
    far, last = {module: 0}, {module}
    while last:
        last = {name for name, others in graph.items() if others & last} - far.keys()
        far |= dict.fromkeys(last, max(far.values()) + 1)
    return far


@cache
def _imports(root: Path) -> tuple[dict[str, Path], architecture.Graph, dict[str, set[str]]]:
    """The modules, what each imports, and what each test file imports."""
    known = architecture.modules(root)
    tests = sorted(root.glob("tests/**/test_*.py"))
    used = {str(path.relative_to(root)): architecture.imported(path, known) for path in tests}
    return known, architecture.imports(known), used


class ThrownAway:
    """A copy of the checkout at one place, made anew for each bug, with kernels compiled once for all."""

    def __init__(self, root: Path, work: Path) -> None:
        self.root, self.work, self.copy = root, work, work / "copy"
        (work / "packages").mkdir(parents=True, exist_ok=True)
        for package, folder in architecture.PACKAGES.items():
            link = work / "packages" / package
            if not link.is_symlink():
                link.symlink_to(self.copy / folder)

    def renew(self) -> None:
        """All files that git knows or does not ignore, as they are in the checkout."""
        shutil.rmtree(self.copy, ignore_errors=True)
        shutil.rmtree(self.work / "cache", ignore_errors=True)
        shutil.rmtree(self.work / "kernels-of-one", ignore_errors=True)
        listed = ["git", "-C", str(self.root), "ls-files", "-z", "-co", "--exclude-standard"]
        names = subprocess.run(listed, check=True, capture_output=True).stdout.decode().split("\0")
        for name in filter(None, names):
            if (self.root / name).is_file():
                (self.copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(self.root / name, self.copy / name)

    def fails(self, bugs: Sequence[PlantedBug], tests: Sequence[str], *asked: str) -> list[str]:
        """The tests that fail with these bugs, one of which may be that they have no end."""
        for bug in bugs:
            text = bug.planted(self.copy)
            (self.copy / bug.file).write_text(text)
            changed = zlib.crc32(text.encode()) >> 1  # kept bytecode goes by size and this second
            os.utime(self.copy / bug.file, (changed, changed))
        code, said = self._run([*asked, *tests], self._environment(bugs))
        for bug in bugs:
            shutil.copy2(self.root / bug.file, self.copy / bug.file)
        if code is None:
            return [HUNG]
        found = FAILED.findall(said)
        if not found and code not in (0, 5):  # 5: no test is left
            raise SystemExit(f"pytest ended with {code}:\n{said[-2000:]}")
        return found

    def _run(self, asked: Sequence[str], settings: Mapping[str, str]) -> tuple[int | None, str]:
        """How pytest ended, None if it did not, and what it printed."""
        child = subprocess.Popen(
            [sys.executable, "-m", "pytest", "--tb=no", "-p", "no:cacheprovider", *asked],
            cwd=self.copy,
            env=settings,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said, _ = child.communicate(timeout=60 * MOST_MINUTES)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
            return None, ""
        return child.returncode, said

    def _environment(self, bugs: Sequence[PlantedBug]) -> dict[str, str]:
        """The copy's own code; kernels of an unchanged folder may come from the runs before."""
        texts = ((self.root / bug.file).read_text() for bug in bugs)
        own = any("jit" in text for text in texts)  # numba does not see what a kernel calls
        kept = {name: value for name, value in os.environ.items() if name not in MISLEADING}
        return kept | {
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": str(self.work / "packages"),
            "PYTHONPYCACHEPREFIX": str(self.work / "bytecode"),
            "XDG_CACHE_HOME": str(self.work / "cache"),
            "NUMBA_CACHE_DIR": str(self.work / ("kernels-of-one" if own else "kernels")),
        }


def nearest(
    bugs: Iterable[PlantedBug], place: ThrownAway
) -> Iterator[tuple[PlantedBug, str | None]]:
    """Each bug, and which of the tests nearest to it tells it."""
    for bug in bugs:
        yield bug, noticed(bug, place)


def noticed(bug: PlantedBug, place: ThrownAway) -> str | None:
    """The first of the nearest tests that fails with the bug and passes without it; None if there is none."""
    place.renew()
    tests, without = stages(bug.file, place.root)[0], list[str]()
    while tests:
        left_out = [f"--{'deselect' if '::' in one else 'ignore'}={one}" for one in without]
        failed = place.fails([bug], tests, "-x", *left_out)
        if not failed or failed == [HUNG]:
            return failed[0] if failed else None
        if not place.fails([], failed):
            return failed[0]
        without += failed
    return None


def noticed_by_others(
    bugs: Sequence[PlantedBug], place: ThrownAway, named: Sequence[str] = ()
) -> Iterator[tuple[PlantedBug, str | None]]:
    """Each of the bugs, and which of the tests beyond the nearest tells it, or of the `named` files.

    All are planted at once; each test that fails then is run with one after the other.
    """
    left = list(bugs)
    wanted = {name for bug in bugs for files in stages(bug.file, place.root)[1:] for name in files}
    place.renew()
    for tests in batches(named or sorted(wanted)):
        failed = place.fails(left, tests)
        print(f"{tests[0]} and {len(tests) - 1} more: {len(failed)} fail", flush=True)
        if HUNG in failed:
            raise SystemExit(f"{HUNG} within {MOST_MINUTES} minutes: name fewer files")
        anyway = place.fails([], failed) if failed else []
        failed = [test for test in failed if test not in anyway]
        while failed:
            test, *failed = failed
            told = next(
                (one for one in _near_first(left, test, place.root) if place.fails([one], [test])),
                None,
            )
            if told is not None:
                left.remove(told)
                yield told, test
                failed = place.fails(left, failed) if failed else []
    yield from ((bug, None) for bug in left)


def _near_first(bugs: Iterable[PlantedBug], test: str, root: Path) -> list[PlantedBug]:
    """Bugs by how near a test is to the module that each is in."""
    file = test.partition("::")[0]
    return sorted(bugs, key=lambda bug: [file not in one for one in stages(bug.file, root)])


def batches(tests: Sequence[str]) -> list[list[str]]:
    """Files of tests by their folder."""
    return [list(files) for _, files in groupby(tests, lambda name: Path(name).parent)]


def wilson(hits: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """The interval of a share, in per cent."""
    middle = (hits + z * z / 2) / (of + z * z)
    half = z / (of + z * z) * (hits * (of - hits) / of + z * z / 4) ** 0.5
    return max(0.0, 100 * (middle - half)), min(100.0, 100 * (middle + half))


def _row(name: str, bugs: Sequence[PlantedBug], tries: Tries) -> list[pages.Cell]:
    before = sum(_at_first(tries[bug.name]) for bug in bugs)
    now = sum(tries[bug.name][-1]["by"] is not None for bug in bugs)
    low, high = wilson(before, len(bugs))
    share: pages.Cell = {"value": round(100 * before / len(bugs), 1), "target": f">= {TARGET}"}
    return [name, len(bugs), share, f"{low:.0f} to {high:.0f}", round(100 * now / len(bugs), 1)]


def _at_first(tried: Sequence[Mapping[str, str | None]]) -> bool:
    """Whether any test of the commit of the first try told it, near or far."""
    return any(one["by"] for one in tried if one["commit"] == tried[0]["commit"])


def table(
    bugs: Iterable[PlantedBug], tries: Tries, known: Iterable[list[pages.Cell]]
) -> pages.Table:
    """The figures of each part of the list that was tried, and those `known` of the others."""
    parts = defaultdict[str, list[PlantedBug]](list)
    for bug in (bug for bug in bugs if bug.name in tries):
        parts[bug.part].append(bug)
    rows = {str(row[0]): row for row in known}
    rows |= {name: _row(name, of, tries) for name, of in parts.items()}
    return pages.Table(
        id="planted",
        title="Planted bugs that the tests notice without real recordings",
        command="python -m tools.planted --record",
        seeds="first try of each, and the last with the tests since",
        columns=["planted", "bugs", "noticed, %", "95 % interval", "with the tests since, %"],
        rows=list(rows.values()),
        **pages.stamp(),
    )


def main() -> None:
    """Plant, and keep and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("list", type=Path, nargs="?", default=LIST)
    parser.add_argument("--part", help="Only bugs of this part.")
    parser.add_argument(
        "--only", action="append", help="Only this bug; may be given several times."
    )
    parser.add_argument("--out", type=Path, default=ROOT / "bench-output" / "planted.json")
    parser.add_argument(
        "--far", nargs="*", help="For what the nearest let go by: the others, or these files."
    )
    parser.add_argument("--work", type=Path, help="Keep the copy and its kernels here.")
    parser.add_argument("--record", action="store_true", help="Write the figures of all tries.")
    given = parser.parse_args()
    bugs = read(given.list)
    tries: Tries = json.loads(given.out.read_text()) if given.out.exists() else {}
    given.out.parent.mkdir(parents=True, exist_ok=True)
    asked = [
        bug
        for bug in bugs
        if given.part in (None, bug.part)
        and bug.name in (given.only or [bug.name])
        and not (bug.name in tries and tries[bug.name][-1]["by"])
    ]
    for bug in asked:
        bug.planted(ROOT)
    with tempfile.TemporaryDirectory() as work:
        place = ThrownAway(ROOT, given.work or Path(work))
        far = given.far is not None
        found = noticed_by_others(asked, place, given.far) if far else nearest(asked, place)
        for bug, by in found:
            one = {
                "commit": pages.stamp()["commit"],
                "tests": "farther" if far else "nearest",
                "by": by,
            }
            tries.setdefault(bug.name, []).append(one)
            given.out.write_text(json.dumps(tries, indent=1))
            print(f"{bug.part:8}{bug.name:28}{by or 'NOT NOTICED: ' + bug.suffers}", flush=True)
    if given.record:
        (before,) = pages.load("planted").tables
        pages.record("planted", table(bugs, tries, before.rows))


if __name__ == "__main__":
    main()
