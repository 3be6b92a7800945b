"""What bends: pinned points stay, driven ones go where they are led, and recordings show it."""

import numpy as np
import pytest

from rpaug import twin
from rpaug.core import geometry
from rpaug.twin import flex
from rpaug.twin.flex import FABRIC, RUBBER
from rpaug.twin.motion import play
from rpaug.twin.panda import HIGHEST, LOWEST
from rpaug.twin.soft_tasks import SOFT_TASKS
from rpaug.twin.tabletop import ARM
from rpaug.twin.world import Print

PRINT = Print("checks", 1, 0.1)


def test_a_sheet_hangs_from_its_pins():
    corner, right, down = np.array([0.0, 0, 1]), np.array([0.2, 0, 0]), np.array([0, 0, -0.2])
    sheet = flex.sheet(corner, right, down, (4, 4), PRINT)
    pinned = sheet.points[:, 2] > 0.99
    push = flex.gusts(sheet.points, 8, np.array([0, 1.0, 0]), 2e-3, np.random.default_rng(0))
    track = flex.simulate(sheet, FABRIC, length=8, pinned=pinned, forces=push)
    np.testing.assert_allclose(
        track[:, pinned], np.tile(sheet.points[pinned], (8, 1, 1)), atol=1e-9
    )
    assert np.abs(track[-1, ~pinned, 1]).max() > 0.005
    edges = np.linalg.norm(track[:, 5] - track[:, 6], axis=1)
    np.testing.assert_allclose(edges, 0.05, atol=0.005)  # cloth hardly stretches


def test_a_rod_pushes_the_sheet():
    sheet = flex.sheet(
        np.array([0.0, 0, 1]), np.array([0.2, 0, 0]), np.array([0, 0, -0.2]), (8, 8), PRINT
    )
    pinned = sheet.points[:, 2] > 0.99
    still = np.zeros((8, len(sheet.points), 3))
    end = np.stack([np.full(8, 0.1), np.linspace(-0.03, 0.05, 8), np.full(8, 0.85)], 1)
    rod = np.stack([end, end - [0, 0.05, 0]], 1)
    track = flex.simulate(sheet, FABRIC, length=8, pinned=pinned, forces=still, rod=rod)
    assert track[-1, :, 1].max() > 0.008
    assert np.abs(track[1, :, 1]).max() < 0.005


def test_a_hand_is_whole_and_its_foot_is_led():
    hand = flex.hand(np.zeros(3), np.array([0.02, 0.02, 0.02]), PRINT)
    sides = hand.points[hand.elements[:, 1:]] - hand.points[hand.elements[:, :1]]
    assert (np.linalg.det(sides) > 0).all()
    foot = hand.points[:, 2] < 0.03
    turns = [geometry.rotation(np.array([0, 0, a])) for a in np.linspace(0, 0.2, 6)]
    led = np.stack([hand.points @ turn.T for turn in turns])
    track = flex.simulate(
        hand, RUBBER, length=6, pinned=foot, forces=np.zeros_like(led), driven=led
    )
    np.testing.assert_allclose(track[:, foot], led[:, foot], atol=2e-3)
    assert np.isfinite(track).all()
    assert np.abs(track - led).max() < 0.1


@pytest.mark.parametrize("task", SOFT_TASKS)
def test_every_seed_is_reachable(task):
    for seed in range(8):
        job = SOFT_TASKS[task](np.random.default_rng(seed))
        motion = play(ARM, job.script, job.placing, 24)
        assert (motion.joint_positions >= LOWEST).all()
        assert (motion.joint_positions <= HIGHEST).all()


@pytest.mark.gl
@pytest.mark.parametrize("task", SOFT_TASKS)
def test_it_is_seen_where_it_is(task):
    take = twin.perform(task, 2, frames=12, size=64)
    again = twin.perform(task, 2, frames=12, size=64)
    name = take.truth.manipulated
    handle, track = take.truth.handles[name], take.shapes[name]
    np.testing.assert_array_equal(track, again.shapes[name])
    assert np.abs(track - track[:1]).max() > 0.01
    for camera in ("front", "overhead"):
        view = take.episode.views[camera]
        for t in (0, 11):
            mine = view.ids(t) == handle
            assert mine.sum() > (12 if camera == "front" else 0)  # a towel hangs edge-on from above
            np.testing.assert_array_equal(view.rgb(t), again.episode.views[camera].rgb(t))
            points = geometry.world_points(view.depth(t), view.camera, t)[mine]
            gap = np.linalg.norm(points[:, None] - track[t], axis=-1).min(1)
            assert np.quantile(gap, 0.9) < 0.02


@pytest.mark.gl
def test_what_bends_can_be_tinted():
    plain = twin.perform("push_towel", 1, frames=11, size=48)
    tinted = twin.perform(
        "push_towel", 1, frames=11, size=48, factor="object_color", value=(0.2, 0.9, 0.2)
    )
    view, other = plain.episode.views["front"], tinted.episode.views["front"]
    mine = view.ids(5) == plain.truth.handles["towel"]
    np.testing.assert_array_equal(view.ids(5), other.ids(5))
    np.testing.assert_array_equal(view.rgb(5)[~mine], other.rgb(5)[~mine])
    assert (view.rgb(5)[mine] != other.rgb(5)[mine]).any(-1).mean() > 0.9
