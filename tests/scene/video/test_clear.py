"""A glass on a table is told by its outline at one place in many frames; marks and reflections are none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rpaug.core import geometry
from rpaug.scene.instances import color_clusters
from rpaug.scene.video import believed, clear, support_look
from rpaug.scene.video.clear import ClearThing
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.instances import InstanceMap, Support, plane_depth
from rpaug.scene.video.kept import KeptInstances

HEIGHT, WIDTH = 150, 200
LEVEL, TABLE = 0.0, 2
K = np.array([[220.0, 0, 99.5], [0, 220.0, 74.5], [0, 0, 1]])
FRAMES = 9
SIDE = 0.01
GLASS, MARK, LAMP = (
    0.06,
    0.0,
    -0.9,
)  # metres above the table: rim of a glass, a mark, a mirrored lamp


def poses() -> np.ndarray:
    """Cameras that look down at the table from a walk over it."""
    track = np.tile(np.eye(4), (FRAMES, 1, 1))
    for t in range(FRAMES):
        track[t, :3, :3] = np.diag([1.0, -1.0, -1.0])
        track[t, :3, 3] = [0.04 * t - 0.16, 0.01 * t, 0.6]
    return track


def look(pose: np.ndarray, height: float) -> PosedFrame:
    """A table of soft grain with a disc at a height over it: brighter than what is seen through it, its rim more."""
    depth = plane_depth(K, pose, (HEIGHT, WIDTH), LEVEL)
    points = geometry.transform(pose, geometry.unproject(depth, K))
    grain = 4 * np.sin(40 * points[..., 0]) * np.cos(23 * points[..., 1])
    through = points[..., :2] - pose[:2, 3]
    there = pose[:2, 3] + through * (pose[2, 3] - height) / pose[2, 3]
    middle = pose[:2, 3] if height < 0 else np.zeros(2)
    away = np.linalg.norm(there - middle - [0.01, 0.02], axis=-1) * (0.5 if height < 0 else 1)
    shine = 22.0 * (away < 0.04) + 26.0 * (np.abs(away - 0.038) < 0.004)
    shown = np.array([150.0, 120, 80]) + (grain + shine)[..., None]
    return PosedFrame(shown.round().astype(np.uint8), depth.astype(np.float32), K, pose)


def found(
    height: float,
) -> tuple[list[PosedFrame], support_look.SupportLook, tuple[ClearThing, ...]]:
    looks = [look(pose, height) for pose in poses()]
    masks = [np.ones((HEIGHT, WIDTH), bool)] * FRAMES
    known = support_look.shown(looks, masks, LEVEL, SIDE)
    return looks, known, clear.find(looks, masks, known, 7)


def test_a_glass_is_told_by_its_outline() -> None:
    looks, known, things = found(GLASS)
    (glass,) = things
    assert glass.instance_id == 7
    assert glass.outlined >= clear.FEWEST
    assert glass.shown <= FRAMES
    named = np.full((HEIGHT, WIDTH), TABLE, np.int32)
    covered = []
    for one in looks[2:7]:
        marked = clear.marked(one, named, named == TABLE, known, things)
        disc = one.rgb[..., 0] > 162
        covered.append((marked[disc] == 7).mean())
        assert (marked[~disc] == 7).mean() < 0.05  # places behind the rim
    assert np.mean(covered) > 0.7
    assert min(covered) > 0.5
    kept = clear.marked(looks[3], named, np.zeros((HEIGHT, WIDTH), bool), known, things)
    assert (kept == named).all()  # what is no support is not touched


@pytest.mark.parametrize("height", [MARK, LAMP], ids=["a mark of the table", "a mirrored lamp"])
def test_what_lies_in_the_table_or_wanders_over_it_is_none(height: float) -> None:
    looks, _, things = found(height)
    assert all((one.rgb[..., 0] > 162).any() for one in looks[2:7])
    assert things == ()


def _of(things: tuple[ClearThing, ...], known: support_look.SupportLook) -> InstanceMap:
    none, tan = np.zeros(0, np.int32), np.zeros(3, np.float32)
    support = Support(frozenset([TABLE]), tan, 50, 0.9, 0.0, known, things)
    return InstanceMap(SIDE, none.astype(np.int64), none, 6, (support,), LEVEL)


def test_a_glass_is_an_instance_of_its_own_that_is_told_and_kept(tmp_path: Path) -> None:
    looks, known, things = found(GLASS)
    made = _of(things, known)
    support = made.supports[0]
    assert support is not None
    named = np.full((HEIGHT, WIDTH), TABLE, np.int32)
    color = color_clusters.weighted(looks[4].rgb[:5, :5]).mean((0, 1))
    ids = replace(made, supports=(replace(support, color=color),)).segmented(looks[4], named)
    assert set(np.unique(ids)) == {TABLE, 7}
    (said,) = believed.doubts(made, [(0, 8)])
    assert said.startswith("instance 7 has the color of the table 2")

    def fails() -> InstanceMap:
        raise AssertionError("it was kept")

    folder = KeptInstances(tmp_path)
    folder.map(lambda: made)
    kept = folder.map(fails).supports[0]
    assert kept is not None
    (glass,) = kept.clear
    assert (glass.codes == things[0].codes).all()
    assert (glass.outlined, glass.shown) == (things[0].outlined, things[0].shown)
