"""Kills `finish` before each of its file operations in turn, and finishes again: what comes out must not differ.

STAGED is an output whose episodes are not gathered yet. It runs in a process of its own, which loads the libraries once
and is forked for each point.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from rpaug.core.registry import adapter
from rpaug.pipeline import output_folder

CHANGES = {"os.rename", "os.remove", "os.rmdir", "os.link", "os.mkdir", "shutil.rmtree"}
KILLED = 9


def tree(root: Path) -> dict[str, bytes | None]:
    """Every file's bytes, and None for a folder."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes() if path.is_file() else None
        for path in root.rglob("*")
    }


def in_child(work: Callable[[], None]) -> int:
    """What a forked process comes to: libraries are loaded once for all of them."""
    if not (child := os.fork()):
        status = 1
        try:
            work()
            status = 0
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_at(point: int, note: Path) -> None:
    """End this process before its file operation number `point`, which is noted."""
    count = 0

    def hook(event: str, given: tuple) -> None:
        nonlocal count
        written = event == "open" and isinstance(given[2], int) and given[2] & os.O_CREAT
        if event not in CHANGES and not written:
            return
        count += 1
        if count > point:
            descriptor = os.open(note, os.O_WRONLY)
            os.write(descriptor, f"{event} {given[0]}".encode())
            os._exit(KILLED)

    sys.addaudithook(hook)


def points(name: str, source: Path, staged: Path, work: Path, every: int) -> list[dict]:
    """A value for each point, or for every so many: the operation that was not done, and what differs from an
    undisturbed run afterwards."""
    given = [name, *map(str, (source, staged, work, every))]
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parent), "OMP_NUM_THREADS": "1"}
    ran = subprocess.run(
        [sys.executable, __file__, *given], env=env, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)


def main(name: str, source: Path, staged: Path, work: Path, every: int) -> list[dict]:
    """All of `points`."""
    layout = adapter(name)
    work.mkdir()
    whole, out, note = work / "whole", work / "out", work / "note"

    def finish() -> None:
        layout.finish(source, out)

    shutil.copytree(staged, out)
    assert in_child(finish) == 0
    out.rename(whole)
    wanted, found, point = tree(whole), [], 0
    while True:
        shutil.copytree(staged, out)
        note.write_text("")

        def dying(point: int = point) -> None:
            killed_at(point, note)
            finish()

        if (status := in_child(dying)) == 0:
            return found
        assert status == KILLED, status
        output_folder.sweep(out)  # as a resumed run does first
        again = in_child(finish)
        made = tree(out)
        differ = sorted(
            path for path in wanted.keys() | made.keys() if wanted.get(path) != made.get(path)
        )
        found.append({"before": note.read_text(), "again": again, "differ": differ})
        shutil.rmtree(out)
        point += every


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], *map(Path, sys.argv[2:5]), int(sys.argv[5]))))
