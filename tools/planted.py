"""Plant bugs one at a time, each in a copy of the checkout that is thrown away, and see whether a test notices.

    python -m tools.planted [LIST] [--part first] [--only NAME] [--out FILE] [--record]

LIST is a TOML file, a table a bug: `file`, `old` text that stands there once, `new` text, what a user `suffers`, and
the `part` of the list that it belongs to. Tests that name the bug's module run first, then the others of the folder
that mirrors it, then those that import the module, or one that does. A bug is noticed by a test that fails with it and
passes without it; the first such test ends the run. No real recordings are read.

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
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
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

    @property
    def layer(self) -> str:
        """The folder of the code that it is in."""
        first, second, *_ = Path(self.file).parts
        return second if first == "rpaug" else first

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
    first = [name for name in mirror if steps[name] == 0]
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
        (work / "packages").mkdir()
        for package, folder in architecture.PACKAGES.items():
            (work / "packages" / package).symlink_to(self.copy / folder)

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

    def fails(self, bug: PlantedBug, tests: Sequence[str], but: Sequence[str] = ()) -> str | None:
        """The first test that fails in the copy as it is now."""
        command = [sys.executable, "-m", "pytest", "-x", "--tb=no", "-p", "no:cacheprovider"]
        skipped = [f"--deselect={one}" if "::" in one else f"--ignore={one}" for one in but]
        child = subprocess.Popen(
            [*command, *skipped, *tests],
            cwd=self.copy,
            env=self._environment(bug),
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
            return HUNG
        if child.returncode in (0, 5):  # 5: no test is left
            return None
        found = FAILED.search(said)
        if found is None:
            raise SystemExit(f"{bug.name}: pytest ended with {child.returncode}:\n{said[-2000:]}")
        return found[1]

    def _environment(self, bug: PlantedBug) -> dict[str, str]:
        """The copy's own code; kernels of an unchanged folder may come from the runs before."""
        own = "jit" in (self.root / bug.file).read_text()  # numba does not see what a kernel calls
        kept = {name: value for name, value in os.environ.items() if name not in MISLEADING}
        return kept | {
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": str(self.work / "packages"),
            "PYTHONPYCACHEPREFIX": str(self.work / "bytecode"),
            "XDG_CACHE_HOME": str(self.work / "cache"),
            "NUMBA_CACHE_DIR": str(self.work / ("kernels-of-one" if own else "kernels")),
        }


def noticed(bug: PlantedBug, place: ThrownAway) -> str | None:
    """The test that fails with the bug and passes without it; None if there is none."""
    text = bug.planted(place.root)
    place.renew()
    file, without = place.copy / bug.file, list[str]()
    for tests in stages(bug.file, place.root):
        while tests:
            file.write_text(text)
            failed = place.fails(bug, tests, without)
            if failed is None or failed == HUNG:
                break
            shutil.copy2(place.root / bug.file, file)
            if place.fails(bug, [failed]) is None:
                return failed
            without.append(failed)
        if tests and failed == HUNG:
            return HUNG
    return None


def wilson(hits: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """The interval of a share, in per cent."""
    middle = (hits + z * z / 2) / (of + z * z)
    half = z / (of + z * z) * (hits * (of - hits) / of + z * z / 4) ** 0.5
    return 100 * (middle - half), 100 * (middle + half)


def _row(name: str, bugs: Sequence[PlantedBug], tries: Tries) -> list[pages.Cell]:
    before, now = (sum(tries[bug.name][at]["by"] is not None for bug in bugs) for at in (0, -1))
    low, high = wilson(before, len(bugs))
    share: pages.Cell = {"value": round(100 * before / len(bugs), 1), "target": f">= {TARGET}"}
    return [name, len(bugs), share, f"{low:.0f} to {high:.0f}", round(100 * now / len(bugs), 1)]


def table(bugs: Iterable[PlantedBug], tries: Tries) -> pages.Table:
    """The figures of all bugs that were tried, by part and by layer."""
    parts, layers = (
        defaultdict[str, list[PlantedBug]](list),
        defaultdict[str, list[PlantedBug]](list),
    )
    for bug in (bug for bug in bugs if bug.name in tries):
        parts[bug.part].append(bug)
        if bug.part != "named":
            layers[bug.layer].append(bug)
    fresh = [bug for of in layers.values() for bug in of]
    rows = [_row(name, of, tries) for name, of in parts.items()]
    rows += [_row("all fresh ones", fresh, tries)] if fresh else []
    for name, of in sorted(layers.items()):
        row = _row(name, of, tries)
        rows.append([*row[:2], str(pages.plain(row[2])), *row[3:]])
    return pages.Table(
        id="planted",
        title="Bugs planted one at a time, noticed by the tests without real recordings",
        command="python -m tools.planted --record",
        seeds="tools/planted.toml",
        columns=["planted", "bugs", "noticed, %", "95 % interval", "with the tests since, %"],
        rows=rows,
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
    parser.add_argument("--record", action="store_true", help="Write the figures of all tries.")
    given = parser.parse_args()
    bugs = read(given.list)
    for bug in bugs:
        bug.planted(ROOT)
    tries: Tries = json.loads(given.out.read_text()) if given.out.exists() else {}
    given.out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        place = ThrownAway(ROOT, Path(work))
        for bug in bugs:
            other = given.part not in (None, bug.part) or bug.name not in (given.only or [bug.name])
            if other or (bug.name in tries and tries[bug.name][-1]["by"]):
                continue
            by = noticed(bug, place)
            tries.setdefault(bug.name, []).append({"commit": pages.stamp()["commit"], "by": by})
            given.out.write_text(json.dumps(tries, indent=1))
            print(f"{bug.part:8}{bug.name:28}{by or 'NOT NOTICED: ' + bug.suffers}", flush=True)
    if given.record:
        pages.record("house", table(bugs, tries))


if __name__ == "__main__":
    main()
