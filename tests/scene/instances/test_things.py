"""What a drawn table shows, told by color and motion alone."""

import numpy as np
import pytest
from rgb_only_tables import BLOCK, PLATE, TABLE, episode, image, still

from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import CameraView
from rpaug.scene.build import build
from rpaug.scene.instances import backdrop, color_clusters, rgb_episode, rgb_things
from rpaug.scene.targets.targets import Target, find


@pytest.fixture(scope="module")
def scene():
    return build(episode(), with_bodies=True)


def truth(color, t: int, **given) -> np.ndarray:
    return np.abs(image(t, noise=0, **given).astype(int) - color).max(-1) == 0


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


def test_it_is_taken_only_where_depth_and_masks_lack() -> None:
    bare = episode()
    assert rgb_episode.lacking(bare)
    view = bare.views["image_0"]
    for known in (
        {"ids": lambda t: np.zeros((64, 64), np.int32)},
        {"depth": lambda t: np.ones((64, 64), np.float32)},
    ):
        parts = {"rgb": view.rgb, "depth": None, "ids": None, **known}
        given = type(bare)(
            bare.key, {"image_0": CameraView(view.camera, **parts)}, bare.robot, (), bare.length
        )
        assert not rgb_episode.lacking(given)


@pytest.mark.parametrize("t", [0, 5, 11])
def test_support_things_and_what_moves_are_told_apart(scene, t: int) -> None:
    ids = scene.episode.views["image_0"].ids(t)
    assert iou(np.isin(ids, list(scene.roles["table"])), truth(TABLE, t)) > 0.95
    assert iou(np.isin(ids, list(scene.roles["robot"])), truth((15, 15, 18), t)) > 0.9
    for words, color in (("the red thing", BLOCK), ("the green plate", PLATE)):
        assert iou(np.isin(ids, list(find(scene, Target(text=words)))), truth(color, t)) > 0.95


def test_what_is_carried_keeps_its_handle() -> None:
    found = build(episode(16, carried=True), with_bodies=True)
    instance_ids = found.roles["manipulated"]
    for t in (0, 15):
        ids = found.episode.views["image_0"].ids(t)
        assert iou(np.isin(ids, list(instance_ids)), truth(BLOCK, t, carried=True)) > 0.9


def test_a_thing_has_one_handle_in_all_cameras() -> None:
    found = build(episode(views=2), with_bodies=True)
    (instance_id,) = find(found, Target(text="the red thing"))
    for view in found.episode.views.values():
        assert (view.ids(3) == instance_id).sum() > 40


def test_two_things_of_one_color_are_asked_about(scene) -> None:
    with pytest.raises(TargetError, match="no role, no shape"):
        find(scene, Target(text="the carrot"))
    with pytest.raises(
        TargetError, match=r"nothing fits; .*or outlines that you draw, tell things"
    ):
        find(scene, Target(text="the purple thing"))


def test_the_labels_are_the_same_whenever_they_are_asked_for() -> None:
    one, other = (build(episode(), with_bodies=True) for _ in range(2))
    for t in (0, 7):
        assert np.array_equal(
            one.episode.views["image_0"].ids(t), other.episode.views["image_0"].ids(t)
        )


def test_a_camera_that_moves_is_seen_to_and_goes_by_color() -> None:
    bare = episode()
    shaken = CameraView(still(12), lambda t: np.roll(image(t), (5 * t, 9 * t), (0, 1)))
    drop = backdrop.find(shaken, 12)
    assert not drop.still
    found = rgb_things.find(type(bare)("k", {"a": shaken}, bare.robot, (), 12))
    ids = found.ids("a", 4, shaken.rgb(4))
    red = np.roll(truth(BLOCK, 4), (20, 36), (0, 1))
    assert len(np.unique(ids[red])) == 1


def test_images_that_show_nothing_are_left_alone() -> None:
    bare = episode()
    dark = CameraView(still(12), lambda t: np.zeros((64, 64, 3), np.uint8))
    given = type(bare)("k", {**bare.views, "dummy": dark}, bare.robot, (), 12)
    found = build(given, with_bodies=True)
    assert not found.episode.views["dummy"].ids(0).any()
    assert found.episode.views["dummy"].proxy.blank


def test_tints_do_not_depend_on_the_order_of_draws() -> None:
    images = [image(t) for t in range(4)]
    assert np.array_equal(color_clusters.find(images), color_clusters.find(images))
    assert len(color_clusters.find(images)) >= 4


def test_what_needs_depth_is_refused_by_name() -> None:
    from rpaug.pipeline import recipe
    from rpaug.pipeline.prepare import ground, prepare_scene

    for edit, missing in (
        ({"op": "camera_pose", "camera": ["image_0"]}, "camera_pose: .*depth.*cameras.yaml"),
        ({"op": "light_direction"}, "light_direction: .*depth.*cameras.yaml"),
        ({"op": "remove", "target": {"text": "the red thing"}}, "remove: "),
        ({"op": "object_size", "target": {"text": "the red thing"}}, "object_size: "),
    ):
        asked = recipe.build({"version": 1, "edits": [edit]})
        with pytest.raises(Unsupported, match=missing):
            ground(prepare_scene(episode(), asked, 0)[0], asked)


def test_what_needs_depth_is_left_out_where_there_are_other_edits() -> None:
    from rpaug.pipeline import copies, recipe
    from rpaug.pipeline.prepare import ground, prepare_scene

    deep = {"op": "camera_pose", "camera": ["image_0"]}
    asked = recipe.build({"version": 1, "edits": [deep, {"op": "light_color"}]})
    scene, _ = prepare_scene(episode(), asked, 0)
    (missing,) = ground(scene, asked)
    assert "camera_pose" in missing
    assert "cameras.yaml" in missing
    _, (first, second) = copies.draw(scene, asked, 1)
    assert "depth" in first.left_out
    assert second.edit is not None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "the block",
            "'the block': the instruction tells the block by what the robot moves, and (?!.*no manipulated)",
        ),
        ("the bowl", "'the bowl': the instruction names no bowl, and without depth no shape tells"),
    ],
)
def test_a_noun_that_nothing_tells_is_answered_in_its_own_words(text: str, message: str) -> None:
    unmoved = build(episode(), with_bodies=True)
    with pytest.raises(TargetError, match=message):
        find(unmoved, Target(text=text))
