"""Pieces of a video that share too few points, and which way is up where cameras look down."""

from dataclasses import replace

import numpy as np
import walks

from rpaug.core import geometry
from rpaug.scene.video import believed, pieces, world
from rpaug.scene.video.instances import InstanceMap, Support
from rpaug.scene.video.model import Reconstruction

LENGTH = 10


def nadir(turns: np.ndarray) -> np.ndarray:
    """Cameras that look straight down a metre above the ground, turned about the vertical by `turns` degrees."""
    track = np.tile(np.eye(4), (len(turns), 1, 1))
    for t, turn in enumerate(np.radians(turns)):
        right = np.array([np.cos(turn), np.sin(turn), 0])
        down = np.array([0, 0, -1.0])
        track[t, :3, :3] = np.stack([right, np.cross(down, right), down], 1)
        track[t, 2, 3] = 1.0
    return track


def test_up_is_told_by_cameras_that_look_straight_down_and_turn() -> None:
    turned = geometry.rigid(np.array([0.4, -0.9, 0.3]), np.zeros(3))
    track = turned @ nadir(np.linspace(-50, 50, 20))
    assert world.upward(track) @ turned[:3, 2] > 0.99
    mean = -track[:, :3, 1].mean(0)
    assert (
        abs(mean @ turned[:3, 2]) / np.linalg.norm(mean) < 0.1
    )  # the images' own upright is level


def test_a_plane_that_cameras_are_below_is_no_support() -> None:
    model = walks.model(LENGTH)
    up = world.upward(model.cam_to_world)
    below = replace(model, cam_to_world=model.cam_to_world.copy())
    below.cam_to_world[:, :3, 3] -= 6 * up
    assert world.upright(model, up)[1] is not None
    assert world.upright(below, up)[1] is None


def parted() -> Reconstruction:
    """A video of two walks that share three points, the second in a unit three times as long, and turned."""
    first = walks.model(LENGTH)
    other = walks.model(LENGTH).moved(geometry.rigid(np.array([0.02, 0.05, 0.03]), np.ones(3)), 3.0)
    count = len(first.points)
    seen = np.zeros((2 * LENGTH, 2 * count), bool)
    seen[:LENGTH, :count], seen[LENGTH:, count:] = first.seen, other.seen
    seen[LENGTH - 1 : LENGTH + 1, :3] = True
    return replace(
        first, times=np.arange(2 * LENGTH, dtype=np.int32), seen=seen,
        cam_to_world=np.concatenate([first.cam_to_world, other.cam_to_world]),
        points=np.concatenate([first.points, other.points]),
        colors=np.concatenate([first.colors, other.colors]),
    )  # fmt: skip


def test_frames_that_share_too_few_points_are_pieces_with_a_support_each() -> None:
    model = parted()
    parts = pieces.pieces(model.seen)
    assert sorted(parts) == [[*range(LENGTH)], [*range(LENGTH, 2 * LENGTH)]]
    depths = [np.full((4, 6), 1.0 if k < LENGTH else 3.0, np.float32) for k in range(2 * LENGTH)]
    placed, scaled, of, level = pieces.placed(model, parts, depths)
    assert level == 0
    assert np.abs(placed.points[:, 2]).max() < 0.02
    assert of == [k // LENGTH for k in range(2 * LENGTH)]
    eyes = placed.cam_to_world[:, :3, 3].reshape(2, LENGTH, 3)
    assert np.allclose(*np.median(eyes[..., 2], 1))
    assert np.allclose(*(scaled[k].mean() for k in (0, LENGTH)), rtol=0.05)
    apart = eyes[1, :, 0].min() - eyes[0, :, 0].max()
    assert apart > 2 * max(one.max() for one in scaled)


def test_one_walk_is_one_piece() -> None:
    assert pieces.pieces(walks.model(LENGTH).seen) == [[*range(LENGTH)]]


def test_what_is_believed_names_each_piece_and_what_has_no_table() -> None:
    none, gray = np.zeros(0, np.int32), np.zeros(3, np.float32)
    one = Support(frozenset([4]), gray, sightings=50, measured=0.9, disputed=0.2)
    found = InstanceMap(1.0, none.astype(np.int64), none, 4, (one, None), 0.0)
    spans = [(0, 9), (15, 30)]
    belief, told = believed.table(found, spans), believed.told(found, spans, 1.0)
    assert belief is not None
    assert belief.confidence == 0.9 * 0.8
    assert "instance 4 in frames 0 to 9" in belief.reasons[0]
    assert "2 pieces (frames 0 to 9; 15 to 30)" in told[0]
    none, wrong = believed.doubts(found, spans)
    assert none.startswith("frames 15 to 30 show no table")
    assert wrong.startswith("20% of the table 4 (frames 0 to 9)")
    assert believed.table(replace(found, supports=()), [(0, 9)]) is None
    assert believed.told(replace(found, supports=()), [(0, 9)], 1.0) == (believed.NONE,)
