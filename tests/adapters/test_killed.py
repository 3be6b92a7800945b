"""Layouts whose episodes end in shared files, killed while they get there: the next run comes to the same bytes.

RLDS and LeRobot, which have more ways to be killed, in their own tests.
"""

import os
from collections.abc import Callable
from pathlib import Path

import crashing
import pytest
from droid_samples import droid
from sim_samples import maniskill, robomimic
from videos import write

from rpaug.core.registry import adapter


def film(folder: Path) -> Path:
    write(folder / "one.mp4", 6)
    return folder


MADE: dict[str, tuple[str, Callable[[Path], object]]] = {
    "robomimic": ("hdf5_sim", lambda folder: robomimic(folder / "demo.hdf5")),
    "ManiSkill": ("hdf5_sim", lambda folder: maniskill(folder / "traj.h5")),
    "video": ("video", film),
    "DROID": ("droid", droid),
}


@pytest.mark.parametrize("kind", MADE)
def test_killed_anywhere_it_comes_to_the_same(kind: str, tmp_path: Path) -> None:
    name, make = MADE[kind]
    layout, source, out = adapter(name), tmp_path / "in", tmp_path / "out"
    source.mkdir()
    make(source)
    keys = list(layout.episodes(source))
    for number in range(2 * len(keys)):
        key = keys[number // 2]
        made = layout.key_at(key, number)
        layout.write(layout.read(source, key), out, made, lambda *_: {"note": b""})
    every = 1 if "RPAUG_EVERY_POINT" in os.environ else 2
    found = crashing.points(name, source, out, tmp_path / "work", every)
    assert found
    assert [one for one in found if one["again"] or one["differ"]] == []
