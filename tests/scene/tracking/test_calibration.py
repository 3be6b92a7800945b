"""Cameras that disagree about where things are, in a scene known in closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest
from analytic import scene

from rpaug import twin
from rpaug.scene.tracking import calibration

EYES = {
    "front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "left": (-0.7, -0.5, 0.9),
    "above": (0.2, 0.3, 1.2),
}  # fmt: skip


@pytest.fixture(scope="module")
def episode():
    """The ball lies still: what moves says nothing about where cameras stand."""
    moving = scene(EYES, length=4).episode
    views = {name: read_at(view, lambda t: 1) for name, view in moving.views.items()}
    return replace(moving, views=views)


def read_at(view, time):
    """The view whose images are those of another time."""
    return replace(
        view,
        rgb=lambda t: view.rgb(time(t)),
        depth=lambda t: view.depth(time(t)),
        ids=lambda t: view.ids(time(t)),
    )


def shifted(episode, name, shift, where=(0.0, 0.0, 0.0)):
    """The episode with one camera's stated pose off by `shift`, and everything moved by `where`."""
    views = {}
    for each, view in episode.views.items():
        track = view.camera.cam_to_world.copy()
        track[:, :3, 3] += np.asarray(where) + (np.asarray(shift) if each == name else 0.0)
        views[each] = replace(view, camera=replace(view.camera, cam_to_world=track))
    return replace(episode, views=views)


def test_cameras_that_agree_are_not_named(episode):
    assert calibration.check(episode, tolerated=0.001, moving=0.001) == ()


# From above too few faces tell of a shift sideways.
@pytest.mark.parametrize(("name", "axis"), [("front", 0), ("front", 1), ("front", 2), ("above", 2)])
def test_a_centimetre_is_found_and_the_camera_named(episode, name, axis):
    found = calibration.check(shifted(episode, name, 0.01 * np.eye(3)[axis]))
    assert [misfit.camera for misfit in found] == [name]
    assert 8 < found[0].millimetres < 12
    said = re.match(r"(\w+): .* lies (\d+) mm from", str(found[0]))
    assert said
    assert (said[1], int(said[2])) == (name, round(found[0].millimetres))


def test_far_from_the_origin_it_is_the_same(episode):
    far = (1e4, -2e4, 5e3)
    assert (
        calibration.check(shifted(episode, "front", (0, 0, 0), far), tolerated=0.001, moving=0.001)
        == ()
    )
    found = calibration.check(shifted(episode, "front", (0, 0, 0.01), far))
    assert [misfit.camera for misfit in found] == ["front"]


def test_a_late_clock_is_no_wrong_place():
    """One camera shows the frame before: what rolls is elsewhere for it, and it stands where it says."""
    episode = scene(EYES, length=9).episode
    late = read_at(episode.views["front"], lambda t: max(t - 1, 0))
    views = {**episode.views, "front": late}
    assert calibration.check(replace(episode, views=views), tolerated=0.002) == ()


def test_few_points_that_disagree_name_no_camera(episode):
    """A face that one camera puts elsewhere, while all else it sees agrees."""
    view = episode.views["side"]

    def depth(t):
        rows, columns = np.indices(view.ids(t).shape)
        return view.depth(t) + np.float32(0.012) * (
            (rows < 40) & (columns < 40) & (view.ids(t) > 0)
        )

    views = {**episode.views, "side": replace(view, depth=depth)}
    assert calibration.check(replace(episode, views=views)) == ()


def test_of_two_that_disagree_both_are_named(episode):
    two = replace(episode, views={name: episode.views[name] for name in ("front", "side")})
    found = calibration.check(shifted(two, "front", (0, 0, 0.01)))
    assert {misfit.camera for misfit in found} == {"front", "side"}


def test_one_camera_has_nothing_to_agree_with(episode):
    assert calibration.check(replace(episode, views={"front": episode.views["front"]})) == ()


def test_how_far_a_camera_disagrees_with_still_ones(episode):
    everything = np.unique(np.concatenate([v.ids(0).ravel() for v in episode.views.values()]))
    assert calibration.disagreement(episode, "front", everything) < 0.001
    off = shifted(episode, "front", (0, 0, 0.01))
    assert 0.005 < calibration.disagreement(off, "front", everything) < 0.011
    # Nothing in common says nothing.
    assert calibration.disagreement(episode, "front", [-7]) == np.inf


@pytest.mark.gl
def test_both_sides_of_a_thin_wall_are_not_one_surface():
    """An open box of one handle: one camera sees a wall's inside where another sees its outside."""
    take = twin.perform("put_in_box", 1000, episode=18, frames=20, roam=0.08)
    assert calibration.check(take.episode, tolerated=0.001, moving=0.001) == ()
