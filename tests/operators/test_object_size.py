"""A resized thing keeps its foot or its grip, and a grasp that would no longer hold is refused with the number."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from pydantic import TypeAdapter, ValidationError
from tabletop import instance_id, scene

from rpaug import Episode, twin
from rpaug.core.errors import Unsupported
from rpaug.operators import object_size
from rpaug.operators.object_size import ObjectSize
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.build import build
from rpaug.scene.placement import growing, placing
from rpaug.scene.targets.targets import Target

pytestmark = pytest.mark.gl


class TestObjectSize(OperatorContract):
    def operator(self):
        return ObjectSize(target=Target(handle=instance_id("cylinder")), range=(1.2, 1.3))

    def scene(self):
        return scene()


def test_the_foot_stays_and_the_top_rises():
    operator = ObjectSize(target=Target(handle=instance_id("cylinder")), range=(1.25, 1.25))
    edit = operator.sample(scene(), np.random.default_rng(0))
    after = operator.apply(scene(), edit)
    body = next(b for b in after.bodies if instance_id("cylinder") in b.instance_ids)
    points = placing.points_of(scene(), [instance_id("cylinder")])
    grown = (body.scale * points) @ body.to_world[0, :3, :3].T + body.to_world[0, :3, 3]
    assert grown[:, 2].min() == pytest.approx(points[:, 2].min(), abs=2e-3)
    assert np.ptp(grown[:, 2]) == pytest.approx(1.25 * np.ptp(points[:, 2]), rel=1e-6)
    before, view = scene().episode.views["front"], shown(after).views["front"]
    assert (view.ids(0) == instance_id("cylinder")).sum() > 1.2 * (
        before.ids(0) == instance_id("cylinder")
    ).sum()


def test_a_grasp_that_no_longer_holds_is_refused_with_the_number():
    held = Target(role="manipulated")
    with pytest.raises(Unsupported, match=r"0\.6 times its size.*the gripper.*lost by \d+\.\d mm"):
        ObjectSize(target=held, range=(0.5, 0.6)).sample(scene(), np.random.default_rng(0))
    with pytest.raises(Unsupported, match=r"1\.5 times its size.*sinks in by \d+\.\d mm"):
        ObjectSize(target=held, range=(1.5, 1.6)).sample(scene(), np.random.default_rng(0))


def test_only_factors_at_which_the_grasp_holds_are_drawn():
    edit = ObjectSize(target=Target(role="manipulated")).sample(scene(), np.random.default_rng(0))
    low, high = edit["allowed"]
    # The block is 64 mm wide between the fingers, and 4 mm are allowed.
    assert low == pytest.approx(1 - 4 / 32, abs=0.03)
    assert high == pytest.approx(1 + 4 / 32, abs=0.03)
    assert low <= edit["scale"] <= high


@given(some.floats(0.9, 1.1), some.floats(0, 0.1), some.integers(0, 9))
def test_a_change_is_seen_wherever_the_range_has_one_that_is(low, width, seed):
    factors = object_size._seen(low, low + width)
    visible = max(1 - low, low + width - 1) >= object_size.SEEN
    assert bool(factors) == visible
    if visible:
        scale = object_size._drawn(factors, np.random.default_rng(seed))
        assert abs(scale - 1) >= object_size.SEEN - 1e-9
        assert low <= scale <= low + width + 1e-9


def test_about_the_grasp_the_tip_stays():
    operator = ObjectSize(target=Target(role="manipulated"), range=(0.95, 0.95), about="grasp")
    after = operator.apply(scene(), operator.sample(scene(), np.random.default_rng(0)))
    body = next(b for b in after.bodies if b.scale != 1)
    was = next(b for b in scene().bodies if b.instance_ids == body.instance_ids)
    moves = np.abs(np.diff(was.to_world, axis=0)).max((1, 2)) > 1e-5
    t = int(np.argmax(moves))
    tip = scene().episode.robot.gripper_to_world[t, :3, 3]
    own = np.linalg.inv(was.to_world[t]) @ [*tip, 1]
    again = body.to_world[t] @ [*(body.scale * own[:3]), 1]
    np.testing.assert_allclose(again[:3], tip, atol=1e-6)


def test_what_is_not_moved_has_no_grasp():
    with pytest.raises(Unsupported, match="the robot does not move it"):
        ObjectSize(target=Target(handle=instance_id("cylinder")), about="grasp").sample(
            scene(), np.random.default_rng(0)
        )


@pytest.mark.parametrize("wrong", [(0.0, 1.0), (1.2, 1.1), (1, 20)])
def test_ranges_out_of_bounds_are_refused(wrong):
    with pytest.raises(ValidationError):
        TypeAdapter(ObjectSize).validate_python({"target": {"handle": 1}, "range": wrong})


def test_it_grows_no_farther_than_there_is_room():
    alone = {instance_id("cylinder")}
    points = placing.points_of(scene(), alone)
    foot = np.array([*points[:, :2].mean(0), points[:, 2].min()])
    fits, what = growing.largest(scene(), frozenset(alone), foot, 9.0)
    assert 1.3 < fits < 9.0
    assert what in ("what stands beside it", "what moves past it")
    wanted = ObjectSize(target=Target(handle=instance_id("cylinder")), range=(8.0, 9.0))
    with pytest.raises(Unsupported, match=r"at 8 times its size it meets what .* is the most"):
        wanted.sample(scene(), np.random.default_rng(0))
    assert growing.largest(scene(), frozenset(alone), foot, 0.8) == (0.8, None)


def test_what_lies_in_another_thing_does_not_come_out_of_its_sides():
    take = twin.perform("open_drawer", 3, frames=17, size=96)
    recorded = build(take.episode, with_bodies=True)
    drawer, cabinet = (take.truth.handles[name] for name in ("drawer", "cabinet"))
    points = placing.points_of(recorded, [drawer])
    foot = np.array([*points[:, :2].mean(0), points[:, 2].min()])
    fits, what = growing.largest(recorded, frozenset([drawer]), foot, 1.3)
    assert what is not None
    assert str(cabinet) in what
    sides = placing.points_of(recorded, [cabinet])
    way = growing._way(recorded, frozenset([drawer]))
    across = np.array([-way[1], way[0]])
    inside = (
        points[:, :2] @ way < (sides[:, :2] @ way).max() - 0.01
    )  # the front panel lies before them
    wide, free_space = np.ptp(points[inside, :2] @ across), np.ptp(sides[:, :2] @ across)
    assert free_space < 1.3 * wide
    assert fits * wide < free_space + 4 * growing.INSIDE
    assert growing.largest(recorded, frozenset([drawer]), foot, 1.02) == (1.02, None)


def test_what_lies_under_another_things_top_does_not_come_out_there(monkeypatch):
    rng = np.random.default_rng(0)
    frame = rng.uniform((-0.3, -0.03, 0.0), (0.3, 0.03, 0.5), (6000, 3))
    frame = frame[(np.abs(frame[:, 0]) > 0.25) | (frame[:, 2] > 0.4)]
    clouds = {1: frame, 2: rng.uniform((-0.24, -0.01, 0.0), (0.0, 0.01, 0.39), (2000, 3))}
    monkeypatch.setattr(growing, "points_of", lambda scene, ids: clouds[min(ids)])
    bodies = [
        SimpleNamespace(instance_ids=frozenset({one}), to_world=np.tile(np.eye(4), (3, 1, 1)))
        for one in clouds
    ]
    window = SimpleNamespace(tracked=bodies, roles={"manipulated": frozenset({2})}, beliefs={})
    foot = np.array([-0.12, 0.0, 0.0])
    fits, what = growing.largest(window, frozenset({2}), foot, 1.3)
    assert what == "the sides of 1, in which it lies"
    assert 0.39 < fits * 0.39 < 0.41
    clouds[1] = frame[frame[:, 2] < 0.4]
    assert growing.largest(window, frozenset({2}), foot, 1.3) == (1.3, None)


def test_a_cabinet_takes_its_drawer_along_as_far_as_the_grip_bears():
    take = twin.perform("open_drawer", 3, frames=17, size=96)
    recorded = build(take.episode, with_bodies=True)
    drawer, cabinet = (take.truth.handles[name] for name in ("drawer", "cabinet"))
    stays, leaves = growing.held(recorded, frozenset([cabinet]))
    assert drawer in stays
    assert not leaves
    alone = Target(handle=cabinet)
    with pytest.raises(Unsupported, match=r"the gripper"):
        ObjectSize(target=alone, range=(0.5, 0.6)).sample(recorded, np.random.default_rng(0))
    operator = ObjectSize(target=alone, range=(0.75, 1.25), contact=0.02)
    edit = operator.sample(recorded, np.random.default_rng(0))
    assert {drawer, cabinet} <= set(edit["handles"])
    after = operator.apply(recorded, edit)
    assert {b.scale for b in after.bodies if b.instance_ids & {drawer, cabinet}} == {edit["scale"]}


def test_a_box_takes_its_lid_along():
    take = twin.perform("close_box", 3, frames=17, size=96)
    recorded = build(take.episode, with_bodies=True)
    lid, box = (frozenset([take.truth.handles[name]]) for name in ("lid", "box"))
    assert growing.held(recorded, box) == (lid, {})


def test_a_drawer_takes_neither_its_cabinet_nor_the_next_drawer_along(monkeypatch):
    rng = np.random.default_rng(0)
    sides = rng.uniform((-0.2, -0.2, 0.0), (0.2, 0.2, 0.4), (4000, 3))
    sides = sides[np.abs(sides[:, :2]).max(1) > 0.18]

    def drawer(low):
        return rng.uniform((-0.175, -0.19, low), (0.175, 0.175, low + 0.15), (2000, 3))

    book = rng.uniform((-0.1, -0.1, 0.03), (0.1, 0.1, 0.06), (500, 3))
    clouds = {1: sides, 2: drawer(0.02), 3: drawer(0.18), 4: book}
    monkeypatch.setattr(growing, "points_by_instance_id", lambda scene, ids: clouds)
    bodies = [
        SimpleNamespace(instance_ids=frozenset({one}), to_world=np.tile(np.eye(4), (3, 1, 1)))
        for one in clouds
    ]
    cabinet = SimpleNamespace(tracked=bodies, roles={}, beliefs={})
    assert growing.held(cabinet, frozenset({2})) == (frozenset({4}), {})
    assert growing.held(cabinet, frozenset({1})) == (frozenset({2, 3, 4}), {})


def test_what_is_taken_out_keeps_its_size_and_is_a_contact():
    take = twin.perform("put_in_box", 0, frames=17, size=96)
    recorded = build(backwards(take.episode), with_bodies=True)
    block, box = (frozenset([take.truth.handles[name]]) for name in ("block_plain", "box"))
    stays, leaves = growing.held(recorded, box)
    assert not stays
    assert set(leaves) == {block}
    floor = min(placing.points_of(recorded, box)[:, 2])
    assert 0 < leaves[block] - floor < 0.06
    assert growing.held(build(take.episode, with_bodies=True), box) == (frozenset(), {})


def backwards(episode: Episode) -> Episode:
    """The same episode from its end to its beginning."""
    last, robot = episode.length - 1, episode.robot
    views = {
        name: replace(
            view,
            camera=replace(view.camera, cam_to_world=view.camera.cam_to_world[::-1].copy()),
            rgb=lambda t, view=view: view.rgb(last - t),
            depth=lambda t, view=view: view.depth(last - t),
            ids=lambda t, view=view: view.ids(last - t),
        )
        for name, view in episode.views.items()
    }
    turned = replace(
        robot,
        joint_positions=robot.joint_positions[::-1].copy(),
        joint_velocities=-robot.joint_velocities[::-1],
        gripper_to_world=robot.gripper_to_world[::-1].copy(),
        gripper_open=robot.gripper_open[::-1].copy(),
        extra={},
    )
    return replace(episode, views=views, robot=turned, source=None)
