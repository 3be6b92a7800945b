"""A finished output that a run goes on with: no file in it is written anew but the two that tell of that."""

import shutil
from collections.abc import Callable
from pathlib import Path

import lerobot_samples
import pytest
import rlds_samples
from droid_samples import droid
from sim_samples import maniskill, robomimic
from videos import write

from rpaug.core import registry
from rpaug.core.files import write_changed
from rpaug.pages import contact
from rpaug.pipeline import journal, recipe, report
from rpaug.pipeline.augment import execute
from rpaug.pipeline.run import Run

RECIPE = {"version": 1, "seed": 3, "copies": 2, "edits": [{"op": "light_color"}]}
MADE: dict[str, Callable[[Path], object]] = {
    "rlds": rlds_samples.dataset,
    "lerobot": lerobot_samples.dataset,
    "robomimic": lambda folder: robomimic(folder / "demo.hdf5"),
    "ManiSkill": lambda folder: maniskill(folder / "traj.h5"),
    "DROID": droid,
    "video": lambda folder: write(folder / "one.mp4", 6),
}
State = dict[str, tuple[int, int, bytes]]


def state(root: Path) -> State:
    """Of each file and folder: its inode, when it was last written, its bytes."""
    found = {}
    for path in root.rglob("*"):
        about = path.stat()
        held = path.read_bytes() if path.is_file() else b""
        found[path.relative_to(root).as_posix()] = (about.st_ino, about.st_mtime_ns, held)
    return found


def gone_on_with(source: Path, out: Path) -> tuple[State, State]:
    """What the output was, and what it is after a run went on with it; its page of pictures is made as the command
    makes it."""
    states = []
    for resume in (False, True):
        summary = execute(Run(source, recipe.build(RECIPE), out), resume=resume)
        contact.write(registry.adapter_for(source), source, out)
        assert summary.copies > 0
        assert summary.resumed == resume * summary.copies
        states.append(state(out))
    return states[0], states[1]


def changed(before: State, after: State) -> set[str]:
    return {name for name in before | after if before.get(name) != after.get(name)}


@pytest.mark.parametrize("kind", ["rlbench", *MADE])
def test_a_finished_output_is_left_alone(kind: str, template: Path, tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    if kind == "rlbench":
        shutil.copytree(template, source)
    else:
        source.mkdir()
        MADE[kind](source)
    before, after = gone_on_with(source, out)
    assert len(before) > len(registry.adapter_for(source).episodes(source))
    assert changed(before, after) == {journal.NAME, report.SUMMARY}
    (_, _, said), (_, _, more) = before[journal.NAME], after[journal.NAME]
    assert more.startswith(said)  # one line: who went on
    assert more[len(said) :].startswith(b'{"begun"')
    assert more.count(b"\n") == said.count(b"\n") + 1


def test_a_file_that_holds_just_that_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_changed(path, b"one")
    before = state(tmp_path)
    write_changed(path, b"one")
    assert state(tmp_path) == before
    for data in (b"two", b"longer", b""):
        write_changed(path, data)
        assert path.read_bytes() == data
