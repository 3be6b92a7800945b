"""Recording: a factor changes what it names and nothing else; the same seed gives the same bytes."""

import json

import numpy as np
import pytest

from rpaug import BadInput, RpaugError, twin
from rpaug.core import geometry, registry
from rpaug.twin.cameras import BUMPED

pytestmark = pytest.mark.gl

KINDS = ("rgb", "depth", "ids")


def frames(take: twin.Take, name: str, kind: str) -> np.ndarray:
    read = getattr(take.episode.views[name], kind)
    return np.stack([read(t) for t in range(take.episode.length)])


def assert_same_motion(first: twin.Take, second: twin.Take) -> None:
    for field in ("joint_positions", "joint_velocities", "gripper_to_world", "gripper_open"):
        np.testing.assert_array_equal(
            getattr(first.episode.robot, field), getattr(second.episode.robot, field)
        )
    assert first.truth.handles == second.truth.handles
    for name, track in first.poses.items():
        np.testing.assert_array_equal(track, second.poses[name])


def test_the_same_seed_gives_the_same_pixels(drawer):
    again = twin.perform("open_drawer", 3, frames=16)
    assert_same_motion(drawer, again)
    for name in drawer.episode.views:
        for kind in KINDS:
            np.testing.assert_array_equal(frames(drawer, name, kind), frames(again, name, kind))


def test_seeds_and_episodes_differ():
    takes = [
        twin.perform("open_drawer", seed, episode=number, frames=11, size=16)
        for seed, number in ((0, 0), (0, 1), (1, 0))
    ]
    assert len({tuple(take.truth.handles.values()) for take in takes}) == 3
    assert len({take.episode.robot.joint_positions[-1, 0] for take in takes}) == 3
    for take in takes:
        assert min(take.truth.handles.values()) > 0
        assert len(set(take.truth.handles.values())) == len(take.truth.handles)


@pytest.mark.parametrize("target", ["drawer", "block_two_coloured"])
def test_object_color_changes_that_object_only(drawer, target):
    changed = twin.perform("open_drawer", 3, frames=16, factor="object_color", target=target)
    handle = changed.truth.handles[target]
    assert set(changed.truth.tints) == {handle}
    old, new = map(np.array, changed.truth.tints[handle])
    assert_same_motion(drawer, changed)
    for name in drawer.episode.views:
        for kind in ("depth", "ids"):
            np.testing.assert_array_equal(frames(drawer, name, kind), frames(changed, name, kind))
        mine = frames(drawer, name, "ids") == handle
        before, after = frames(drawer, name, "rgb"), frames(changed, name, "rgb")
        np.testing.assert_array_equal(before[~mine], after[~mine])
        # Within the object the truth multiplies: one ratio a channel, to the rounding of both images.
        expected = before[mine] * (new / old)
        assert np.abs(after[mine] - expected).max(initial=0) <= 0.5 + 0.5 * (new / old).max() + 1e-3


def test_one_lamp_of_another_color_changes_what_it_reaches():
    look = twin.Look(shadows=True)
    plain, changed = (
        twin.perform("open_drawer", 3, frames=16, look=look, **factor)
        for factor in ({}, {"factor": "lamp_color", "value": (1, (1.0, 0.5, 0.0))})
    )
    assert [lamp.gain[2] for lamp in changed.truth.new.lamps] == [1, 0, 1]
    for name, view in plain.episode.views.items():
        gone = view.rgb(4).astype(int) - changed.episode.views[name].rgb(4)
        assert not gone[..., 0].any()  # red is as it was
        assert (gone[..., 2].min(), (gone[..., 2] == 0).any(), (gone[..., 2] > 20).any()) == (
            0,
            True,
            True,
        )


def test_light_color_scales_everything_alike(drawer):
    changed = twin.perform("open_drawer", 3, frames=16, factor="light_color")
    ratio = np.divide(changed.truth.light[1], changed.truth.light[0])
    assert not changed.truth.tints
    assert_same_motion(drawer, changed)
    for name in drawer.episode.views:
        for kind in ("depth", "ids"):
            np.testing.assert_array_equal(frames(drawer, name, kind), frames(changed, name, kind))
        before, after = frames(drawer, name, "rgb"), frames(changed, name, "rgb").astype(float)
        # Colors are rounded to 8 bits in both images, and a little in the rasteriser's interpolation.
        off = np.abs(after - before * ratio)
        assert off.max() <= 1 + ratio.max()
        assert off.mean() < 0.5


def test_camera_pose_moves_front_and_shoulders(drawer):
    changed = twin.perform("open_drawer", 3, frames=16, factor="camera_pose")
    assert set(changed.truth.bumps) == set(BUMPED)
    assert_same_motion(drawer, changed)
    for name, view in drawer.episode.views.items():
        moved = changed.episode.views[name].camera.cam_to_world
        if name not in BUMPED:
            np.testing.assert_array_equal(moved, view.camera.cam_to_world)
            np.testing.assert_array_equal(frames(drawer, name, "rgb"), frames(changed, name, "rgb"))
            continue
        bump = changed.truth.bumps[name]
        assert np.abs(bump.shift).max() <= 0.1
        assert np.abs(bump.turn).max() <= 0.05
        step = geometry.rigid(np.array(bump.turn), np.array(bump.shift))
        np.testing.assert_array_equal(moved, view.camera.cam_to_world @ step)
        points = geometry.world_points(
            changed.episode.views[name].depth(0), changed.episode.views[name].camera, 0
        )
        table = (changed.episode.views[name].ids(0) == drawer.truth.handles["table"]) & (
            points[..., 2] > 0.74
        )
        assert np.abs(points[table][:, 2] - 0.752).max() < 5e-5


def test_a_given_value_is_taken(drawer):
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    look = twin.Look(tints={"block_plain": red})
    take = twin.perform(
        "pick_block", 0, frames=17, size=64, look=look,
        factor="object_color", target="block_plain", value=blue,
    )  # fmt: skip
    handle = take.truth.handles["block_plain"]
    assert take.truth.tints == {handle: (red, blue)}
    mine = frames(take, "right_shoulder", "ids") == handle
    colors = frames(take, "right_shoulder", "rgb")[mine]
    assert (colors[:, :2] == 0).all()
    assert (colors[:, 2] > 60).all()


def test_light_direction_turns_every_lamp(drawer):
    changed = twin.perform("open_drawer", 3, frames=16, factor="light_direction")
    turns = {
        round(new.heading - old.heading, 12)
        for new, old in zip(changed.truth.new.lamps, drawer.truth.new.lamps, strict=True)
    }
    assert len(turns) == 1
    assert "lamps" in changed.truth.describe()["new"]
    before, after = frames(drawer, "front", "rgb"), frames(changed, "front", "rgb")
    assert (before != after).mean() > 0.2
    assert (after == 255).mean() < 1e-3  # nothing is lit beyond what an image can show
    for kind in ("depth", "ids"):
        np.testing.assert_array_equal(frames(drawer, "front", kind), frames(changed, "front", kind))


@pytest.mark.parametrize("factor", ["table_color", "table_texture", "background_texture"])
def test_a_factor_of_the_room_changes_its_parts_only(drawer, factor):
    changed = twin.perform("open_drawer", 3, frames=16, factor=factor)
    mine = np.isin(frames(drawer, "front", "ids"), changed.truth.changed)
    before, after = frames(drawer, "front", "rgb"), frames(changed, "front", "rgb")
    np.testing.assert_array_equal(frames(changed, "front", "ids"), frames(drawer, "front", "ids"))
    np.testing.assert_array_equal(before[~mine], after[~mine])
    assert (before[mine] != after[mine]).any(-1).mean() > 0.8


def test_the_receiver_can_be_the_target(block):
    take = twin.perform(
        "pick_block", 5, frames=17, size=16, factor="object_color", target="receiver"
    )
    assert take.truth.receiver == "pad"
    assert take.truth.changed == (take.truth.handles["pad"],)
    with pytest.raises(RpaugError, match="nothing receives"):
        twin.perform("open_drawer", 0, frames=11, size=16, factor="object_color", target="receiver")


def test_unknown_names_list_the_known_ones():
    with pytest.raises(RpaugError, match="open_drawer, pick_block, push_button"):
        twin.perform("juggle", 0)
    with pytest.raises(
        RpaugError, match="object_color, object_texture, object_finish, light_color"
    ):
        twin.perform("open_drawer", 0, factor="gravity")
    with pytest.raises(RpaugError, match="block_plain"):
        twin.perform("open_drawer", 0, factor="object_color", target="teapot")
    with pytest.raises(RpaugError, match="8 to 2048"):
        twin.perform("open_drawer", 0, size=0)


def test_what_is_written_reads_back(tmp_path, drawer):
    (take,) = twin.record("open_drawer", 3, tmp_path, frames=16)
    adapter = registry.adapter("rlbench")
    (key,) = adapter.episodes(tmp_path)
    assert key == "open_drawer/all_variations/episodes/episode0"
    read = take.episode
    assert read.descriptions == drawer.episode.descriptions
    for name, view in drawer.episode.views.items():
        back = read.views[name]
        np.testing.assert_array_equal(back.camera.K, view.camera.K)
        np.testing.assert_allclose(back.camera.cam_to_world, view.camera.cam_to_world, atol=1e-12)
        for t in (0, 15):
            np.testing.assert_array_equal(back.rgb(t), view.rgb(t))
            np.testing.assert_array_equal(back.ids(t), view.ids(t))
            # 24 bits over at most 10 m: steps of 0.6 micrometres.
            np.testing.assert_allclose(back.depth(t), view.depth(t), atol=1e-6)
    np.testing.assert_array_equal(read.robot.joint_positions, drawer.episode.robot.joint_positions)
    np.testing.assert_array_equal(
        read.robot.joint_velocities, drawer.episode.robot.joint_velocities
    )
    for name, track in drawer.episode.robot.extra.items():
        np.testing.assert_array_equal(read.robot.extra[name], track)
    facts = json.loads((tmp_path / key / "truth.json").read_text())
    assert facts["handles"] == take.truth.handles
    with pytest.raises(BadInput):
        twin.record("open_drawer", 3, tmp_path, frames=16)


def test_two_recordings_have_the_same_bytes(tmp_path):
    for place in ("first", "second"):
        twin.record(
            "pick_block", 1, tmp_path / place, frames=17, size=32, episodes=2, factor="object_color"
        )
    first = sorted(path for path in (tmp_path / "first").rglob("*") if path.is_file())
    assert len(first) == 2 * (17 * 15 + 4)
    for path in first:
        assert (
            path.read_bytes()
            == (tmp_path / "second" / path.relative_to(tmp_path / "first")).read_bytes()
        )
