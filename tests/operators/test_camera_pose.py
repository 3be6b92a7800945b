"""A bumped camera is moved as drawn, in its own frame, and nothing else is."""

import json

import numpy as np
import pytest
from analytic import scene
from pydantic import TypeAdapter, ValidationError

from rpaug import BadRecipe, Scene, TargetError, Unsupported
from rpaug.core import geometry
from rpaug.operators.camera_pose import CameraPose
from rpaug.pipeline.contracts import OperatorContract

EYES = {"front": (0.0, -0.9, 0.6), "side": (0.9, -0.1, 0.7), "wrist": (0.2, -0.5, 0.8)}


class TestContract(OperatorContract):
    frames = (0, 2)

    def operator(self) -> CameraPose:
        return CameraPose(camera="static")

    def scene(self) -> Scene:
        return scene(EYES, length=3, moving="wrist")


@pytest.fixture
def recorded():
    return scene(EYES, length=3, moving="wrist")


def test_the_motion_is_in_the_camera_frame_and_held(recorded):
    operator = CameraPose(camera="wrist", shift=0.1, turn=0.05)
    edit = operator.sample(recorded, np.random.default_rng(3))
    moved = operator.apply(recorded, json.loads(json.dumps(edit)))
    assert set(edit) == {"wrist"}
    before, after = recorded.cameras["wrist"].cam_to_world, moved.cameras["wrist"].cam_to_world
    bump = geometry.inverse(before) @ after
    np.testing.assert_allclose(bump, np.broadcast_to(bump[0], bump.shape), atol=1e-12)
    np.testing.assert_allclose(bump[0, :3, 3], edit["wrist"]["shift"], atol=1e-12)
    assert np.abs(bump[0, :3, 3]).max() <= 0.1
    np.testing.assert_allclose(
        bump[0, :3, :3], geometry.rotation(np.array(edit["wrist"]["turn"])), atol=1e-12
    )
    assert moved.cameras["front"] is recorded.cameras["front"]
    assert moved.episode is recorded.episode
    assert moved.bodies is recorded.bodies


def test_a_shift_and_a_turn_go_either_way(recorded):
    operator = CameraPose(camera="wrist", shift=0.1, turn=0.05)
    drawn = [operator.sample(recorded, np.random.default_rng(n))["wrist"] for n in range(40)]
    for name, most in (("shift", 0.1), ("turn", 0.05)):
        values = np.array([one[name] for one in drawn])
        assert (values.min(0) < -most / 2).all()
        assert (values.max(0) > most / 2).all()
        assert np.abs(values).max() <= most


def test_static_names_all_fixed_cameras_with_a_draw_each(recorded):
    edit = CameraPose(camera="static").sample(recorded, np.random.default_rng(0))
    assert list(edit) == ["front", "side"]
    assert edit["front"] != edit["side"]


def test_several_cameras_by_name(recorded):
    operator = TypeAdapter(CameraPose).validate_python({"camera": ["side", "wrist"]})
    assert list(operator.sample(recorded, np.random.default_rng(0))) == ["side", "wrist"]


def test_no_shift_and_no_turn_is_no_change(recorded):
    operator = CameraPose(camera="static", shift=0, turn=0)
    moved = operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0)))
    for name, camera in recorded.cameras.items():
        np.testing.assert_array_equal(moved.cameras[name].cam_to_world, camera.cam_to_world)


@pytest.mark.parametrize("camera", ["back", ("front", "back")])
def test_an_unknown_camera_is_named_with_the_known_ones(recorded, camera):
    with pytest.raises(TargetError, match=r"'back'.*front, side, wrist"):
        CameraPose(camera=camera).sample(recorded, np.random.default_rng(0))
    with pytest.raises(TargetError, match="'back'"):
        CameraPose(camera="front").apply(
            recorded, {"back": {"turn": [0, 0, 0], "shift": [0, 0, 0]}}
        )


def test_static_without_fixed_cameras():
    lone = scene({"wrist": EYES["wrist"]}, length=3, moving="wrist")
    with pytest.raises(TargetError, match=r"'static' names no camera.*wrist"):
        CameraPose(camera="static").sample(lone, np.random.default_rng(0))


@pytest.mark.parametrize("wrong", [{"shift": -0.1}, {"turn": -1}, {"shift": "far"}, {"tilt": 1}])
def test_bad_values_are_refused(wrong):
    with pytest.raises(ValidationError):
        TypeAdapter(CameraPose).validate_python({"camera": "front", **wrong})


def test_an_exact_motion_is_no_draw(recorded):
    operator = CameraPose(camera="static", by=(0.0, -0.05, 0.0))
    edit = operator.sample(recorded, np.random.default_rng(0))
    moved = operator.apply(recorded, json.loads(json.dumps(edit)))
    before, after = recorded.cameras["front"].cam_to_world, moved.cameras["front"].cam_to_world
    # The image's y axis points down: 5 cm against it is 5 cm up in the image.
    np.testing.assert_allclose(after[0, :3, 3], before[0, :3, 3] - 0.05 * before[0, :3, 1])
    np.testing.assert_array_equal(after[0, :3, :3], before[0, :3, :3])


def test_a_motion_may_be_drawn_between_two(recorded):
    low, high = (0.0, -0.1, 0.0), (0.0, -0.05, 0.0)
    operator = CameraPose(camera="front", by=(low, high), turned=((0, 0, -0.1), (0, 0, 0.1)))
    drawn = [operator.sample(recorded, np.random.default_rng(n))["front"] for n in range(20)]
    lifts = [-one["shift"][1] for one in drawn]
    rolls = [one["turn"][2] for one in drawn]
    assert 0.05 <= min(lifts) < max(lifts) <= 0.1
    assert -0.1 <= min(rolls) < 0 < max(rolls) <= 0.1
    assert all(one["shift"][::2] == [0, 0] and one["turn"][:2] == [0, 0] for one in drawn)
    with pytest.raises(BadRecipe, match=r"low .* exceeds high"):
        CameraPose(camera="front", by=(high, low))


def test_a_camera_can_be_aimed_at_a_place(recorded):
    place = np.array([0.1, -0.2, 0.05])
    operator = CameraPose(camera="front", by=(0.0, -0.1, 0.0), toward=tuple(place))
    edit = operator.sample(recorded, np.random.default_rng(0))
    camera = operator.apply(recorded, json.loads(json.dumps(edit))).cameras["front"]
    before = recorded.cameras["front"].cam_to_world[0]
    np.testing.assert_allclose(
        camera.cam_to_world[0, :3, 3], before[:3, 3] - 0.1 * before[:3, 1], atol=1e-9
    )
    seen = geometry.transform(geometry.inverse(camera.cam_to_world[0]), place)
    np.testing.assert_allclose(seen[:2], 0, atol=1e-9)
    assert seen[2] > 0
    with pytest.raises(Unsupported, match="'wrist' moves"):
        CameraPose(camera="wrist", toward=(0, 0, 0)).sample(recorded, np.random.default_rng(0))


def test_a_motion_has_limits():
    with pytest.raises(BadRecipe, match="turned"):
        CameraPose(camera="front", turned=(4.0, 0.0, 0.0))
