"""Runs of the whole command where something is short: do they end in words, and go on to the bytes of one run?

    python tools/bench/scarce.py [--layout rlbench] [--cases 8] [--kinds disk readonly ...] [--json FILE]

Six tiny episodes of the twin, two copies each, on two workers. For each kind so many cases, evenly spread from nothing
to what an undisturbed run takes: megabytes of a file system of its own (tmpfs), the moment at which that becomes
read-only, open files (RLIMIT_NOFILE), memory of both workers (a cgroup, at whose end the kernel kills one).
For `clock` the run is killed, and what goes on with it believes to live a year before. Then nothing is short any more,
and the run goes on. Needs root for file systems and cgroups of version 1.

A fault is: an end without words of one line, words of a fault of ours, a traceback, a temporary file or a process that
is left, other bytes in the end.
"""

import argparse
import ctypes
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from killed import ENDS, RECIPE, contents, dataset, descendants, works

from rpaug.pipeline import journal

KINDS = ("disk", "readonly", "handles", "memory", "clock")
ROOM = 256  # MB of a file system on which nothing is short
LIBC = ctypes.CDLL(None, use_errno=True)
MS_RDONLY, MS_REMOUNT = 1, 32  # of mount(2)
CGROUP = Path("/sys/fs/cgroup/memory/rpaug_scarce")
YEAR = 365 * 86400
PAST = "import time\nnow = time.time\ntime.time = lambda: now() - {}\n"
OURS = ("a fault in rpaug", "Traceback", "lived on")


@dataclass
class Ended:
    """What a run that was short of something came to."""

    code: int
    words: str

    def faults(self) -> list[str]:
        said = [line for line in self.words.splitlines() if line]
        found = [f"{one}: {said[-1][:200]}" for one in OURS if one in self.words]
        return found + (["no words"] if self.code and not said else [])


@dataclass
class Bench:
    """A dataset, what an undisturbed run makes of it, and a file system to write to."""

    folder: Path
    source: Path
    wanted: dict[str, bytes] = field(default_factory=dict)
    lasts: float = 0.0

    @property
    def out(self) -> Path:
        return self.folder / "room/out"

    def begun(
        self, enter: Callable[[], None] | None = None, path: str = ""
    ) -> subprocess.Popen[str]:
        """The command, which goes on where something is there."""
        (self.folder / "recipe.yaml").write_text(json.dumps(RECIPE))
        given = ["--recipe", str(self.folder / "recipe.yaml"), "--out", str(self.out)]
        given += ["--resume"] if self.out.exists() else []
        command = [sys.executable, "-m", "rpaug", "augment", str(self.source), "--workers=2"]
        first = os.pathsep.join(filter(None, (path, os.environ.get("PYTHONPATH"))))
        env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": first}
        return subprocess.Popen(
            command + given,
            env=env,
            preexec_fn=enter,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def undisturbed(self) -> int:
        """Its bytes on the disk."""
        with mounted(self.folder / "room", ROOM * 1024):
            start = time.monotonic()
            assert ended(self.begun()).code == 0
            self.lasts = time.monotonic() - start
            self.wanted = contents(self.out)
            use = shutil.disk_usage(self.folder / "room")
        return use.used

    def gone_on(self, path: str = "") -> list[str]:
        """What is wrong after nothing is short any more."""
        end, found = ended(self.begun(path=path)), contents(self.out)
        differ = sorted(
            {n for n, data in self.wanted.items() if found.get(n) != data}
            | found.keys() - self.wanted.keys()
        )
        faults = [f"exit code {end.code} in the end: {end.words}"] if end.code else []
        faults += [f"other bytes: {', '.join(differ[:3])}"] if differ else []
        left = [path for path in self.out.parent.rglob(".*") if path.suffix in (".part", ".lock")]
        return faults + [f"left: {path}" for path in left]


def ended(run: subprocess.Popen[str]) -> Ended:
    _, words = run.communicate()
    return Ended(run.returncode, words)


@contextmanager
def mounted(where: Path, kilobytes: int) -> Iterator[None]:
    """A file system in memory, of that size."""
    where.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(where)]
    subprocess.run(mount, check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", str(where)], check=True)


def remounted(where: Path, how: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{how}", str(where)], check=True)


def made_readonly(where: Path) -> bool:
    """Not while a file there is open to be written; a call takes less time than a command, and finds more moments."""
    return LIBC.mount(b"tmpfs", os.fsencode(where), b"tmpfs", MS_RDONLY | MS_REMOUNT, None) == 0


def disk(bench: Bench, share: float, used: int) -> Ended:
    remounted(bench.out.parent, f"size={max(8, int(share * used / 1024))}k")
    end = ended(bench.begun())
    remounted(bench.out.parent, f"size={ROOM}m")
    return end


def readonly(bench: Bench, share: float, _: int) -> Ended:
    """The output alone, beside whose lock, which is open all the time, no file system becomes read-only."""
    run, moment = bench.begun(), time.monotonic() + share * bench.lasts
    while run.poll() is None and (time.monotonic() < moment or not made_readonly(bench.out)):
        time.sleep(0.0001)
    end = ended(run)
    remounted(bench.out, "rw")
    return end


def handles(bench: Bench, share: float, _: int) -> Ended:
    most = int(4 + 20 * share)  # 24 are enough for all of it
    limit = partial(resource.setrlimit, resource.RLIMIT_NOFILE, (most, most))
    return ended(bench.begun(enter=limit))


def memory(bench: Bench, share: float, _: int) -> Ended:
    """Of the workers together: from less than one loads to what both take."""
    CGROUP.mkdir(exist_ok=True)
    (CGROUP / "memory.limit_in_bytes").write_text(str(int((50 + 350 * share) * 2**20)))
    run = bench.begun()
    while run.poll() is None:
        for pid in filter(works, descendants(run.pid)):
            with suppress(OSError):  # it has ended
                (CGROUP / "cgroup.procs").write_text(str(pid))
        time.sleep(0.05)
    end, ends = ended(run), time.monotonic() + ENDS
    while left := (CGROUP / "cgroup.procs").read_text().split():
        if time.monotonic() > ends:
            return Ended(end.code, f"{end.words}\nprocesses lived on: {left}")
        time.sleep(0.05)
    CGROUP.rmdir()
    return end


def clock(bench: Bench, share: float, _: int) -> Ended:
    """Killed here; a year back in what goes on."""
    run = bench.begun()
    while run.poll() is None and not (bench.out / journal.NAME).exists():
        time.sleep(0.005)
    time.sleep(share * bench.lasts)
    run.kill()
    ended(run)
    return Ended(0, "")


def trial(bench: Bench, kind: str, share: float, used: int) -> tuple[Ended, list[str]]:
    with ExitStack() as stack:
        past = stack.enter_context(tempfile.TemporaryDirectory())
        for where in (bench.out.parent, *([bench.out] if kind == "readonly" else ())):
            stack.enter_context(mounted(where, ROOM * 1024))
        end = globals()[kind](bench, share, used)
        (Path(past) / "sitecustomize.py").write_text(PAST.format(YEAR))
        return end, end.faults() + bench.gone_on(past if kind == "clock" else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--layout", default="rlbench")
    parser.add_argument("--cases", type=int, default=8)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found: dict[str, dict[str, object]] = {}
    with tempfile.TemporaryDirectory() as made:
        bench = Bench(Path(made), dataset(Path(made), given.layout))
        used = bench.undisturbed()
        for kind in given.kinds:
            codes, wrong = Counter[int](), list[str]()
            for number in range(given.cases):
                share = (number + 0.5) / given.cases
                end, faults = trial(bench, kind, share, used)
                codes[end.code] += 1
                wrong += [f"{share:.2f}: {fault}" for fault in faults]
                said = end.words.strip().splitlines()[-1:] or ["-"]
                print(f"{kind} {share:.2f}: {end.code}, {said[0][:160]}; {faults}", flush=True)
            found[kind] = {"codes": dict(codes), "wrong": wrong}
            if given.json:
                given.json.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
