"""Words for things in color images alone: never table, background, or what an image cuts off; all cameras agree."""

import json
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rgb_only_tables import BLOCK, PLATE, episode, image

from rpaug.core.errors import TargetError
from rpaug.core.types import CameraView, Scene
from rpaug.pipeline import prepare, recipe
from rpaug.scene.build import build
from rpaug.scene.placement.placing import find_free_space
from rpaug.scene.targets import settled
from rpaug.scene.targets.targets import Target, assumed, find

LENGTH = 12
Paint = Callable[[np.ndarray], None]


def seen(*painted: Paint, words: str = "put the block on the plate") -> Scene:
    """A camera for each way to paint over the drawn table."""
    bare = episode(LENGTH)
    camera = bare.views["image_0"].camera
    views = {}
    for k, paint in enumerate(painted):
        frames = [image(t) for t in range(LENGTH)]
        for one in frames:
            paint(one)
        views[f"image_{k}"] = CameraView(camera, frames.__getitem__)
    return build(replace(bare, views=views, descriptions=(words,)), with_bodies=True)


def nothing(out: np.ndarray) -> None:
    """As it is drawn."""


def test_a_word_for_a_thing_never_means_the_table() -> None:
    scene = seen(nothing, words="put the cup on the plate")
    for words in ("the blue cup", "the blue thing"):
        with pytest.raises(TargetError, match="nothing fits"):
            find(scene, Target(text=words))
    assert find(scene, Target(text="the table")) == scene.roles["table"]


def test_a_word_that_the_instruction_lacks_never_goes_by_color_alone() -> None:
    scene = seen(nothing)
    for words in ("the red carrot", "the red cup"):
        with pytest.raises(TargetError, match=r"the instruction names no c.*'the red thing' takes"):
            find(scene, Target(text=words))
    assert find(scene, Target(text="the red thing")) == find(scene, Target(text="the red block"))


def test_what_goes_by_its_color_alone_is_said() -> None:
    scene = seen(nothing)
    (block,) = find(scene, Target(text="the red block"))
    said = f"without a model 'the red block' is known by its color alone: instance {block}"
    assert assumed(scene, Target(text="the red block")) == said
    for words in ("the red thing", "the red carrot", "the table"):
        assert not assumed(scene, Target(text=words))
    known = frozenset({block, 999})  # one of several that go by the name
    for more in (
        {"roles": {**scene.roles, "manipulated": known}},
        {"names": {"block": known}},
    ):
        assert not assumed(replace(scene, **more), Target(text="the red block")), more
    other = {"names": {"plate": frozenset({999})}}
    assert assumed(replace(scene, **other), Target(text="the red block")) == said


def test_the_plan_says_what_goes_by_its_color_alone() -> None:
    edits = [
        {"op": "recolor", "target": {"text": f"the {words}"}, "color": "green"}
        for words in ("red block", "red thing")
    ]
    asked = recipe.build({"version": 1, "edits": edits})
    _, plan = prepare.prepare_scene(episode(LENGTH), asked, 0)
    (said,) = [line for line in plan.assumed if "color alone" in line]
    assert "'the red block'" in said


def test_a_color_that_the_instruction_gives_to_another_thing_tells_nothing() -> None:
    scene = seen(nothing, words="put the red block on the plate")
    with pytest.raises(TargetError, match="in the instruction red is the block"):
        find(scene, Target(text="the red plate"))
    assert find(scene, Target(text="the green plate"))


def test_a_person_may_settle_the_table_by_its_color() -> None:
    scene = seen(nothing)
    blue = settled.SettledRole(color="blue")
    made, wrong = settled.settle(replace(scene, roles={}, beliefs={}), {"table": blue})
    assert not wrong
    assert made.roles["table"] == scene.roles["table"]


@pytest.mark.parametrize("tint", [(180, 130, 130), (140, 80, 80)], ids=["pink", "a dull red"])
def test_what_has_a_touch_of_a_color_is_not_meant_beside_what_has_much(tint: tuple) -> None:
    def pale(out: np.ndarray) -> None:
        out[48:56, 10:20] = tint

    scene = seen(pale)
    (block,) = find(scene, Target(text="the red thing"))
    assert find(scene, Target(text="the red block")) == {block}
    assert (scene.episode.views["image_0"].ids(0)[40, 18:22] == block).all()


def test_what_the_image_cuts_off_is_refused() -> None:
    def cut(out: np.ndarray) -> None:
        out[44:54, 40:52] = out[44:54, 26:38]
        out[48:58, 54:64] = PLATE

    with pytest.raises(TargetError, match="edge of image_0 cuts it off"):
        find(seen(cut), Target(text="the green plate"))


def test_a_handle_is_one_thing_in_all_cameras_that_show_it_or_refused() -> None:
    def gone(out: np.ndarray) -> None:
        out[:, 58:] = BLOCK  # a wall of its color, and the block is part of it
        out[36:44, 14:22] = out[36:44, 26:34]

    (block,) = find(seen(nothing), Target(text="the red block"))
    assert find(seen(nothing, nothing), Target(handle=block)) == {block}
    with pytest.raises(TargetError, match=r"handle \d+: image_1 shows its color, and not it"):
        find(seen(nothing, gone), Target(handle=block))


def test_a_handle_is_refused_where_another_thing_is_as_much_like_it() -> None:
    def two(out: np.ndarray) -> None:
        out[48:56, 34:42] = BLOCK

    scene = seen(nothing, two)
    ids = scene.episode.views["image_1"].ids(0)
    second = int(ids[52, 38])
    (block,) = set(np.unique(ids[36:44, 14:22]).tolist()) & scene.instance_ids - {second}
    for handle in (block, second):
        if (scene.episode.views["image_0"].ids(0) == handle).any():
            with pytest.raises(TargetError, match=r"as much like what image_[01] shows of it"):
                find(scene, Target(handle=handle))
    assert find(scene, Target(handle=[block, second])) == {block, second}


def test_a_camera_that_shows_the_color_elsewhere_disputes_it() -> None:
    def gone(out: np.ndarray) -> None:
        out[36:44, 14:22] = out[36:44, 26:34]
        out[:, 58:] = BLOCK  # a wall

    scene = seen(nothing, gone)
    with pytest.raises(TargetError, match="image_1 shows its color"):
        find(scene, Target(text="the red block"))


def test_a_camera_that_does_not_see_it_does_not_dispute_it() -> None:
    def gone(out: np.ndarray) -> None:
        out[36:44, 14:22] = out[36:44, 26:34]

    assert find(seen(nothing, gone), Target(text="the red block"))


def elsewhere(tint: tuple[int, int, int]) -> Paint:
    """In place of the block there is nothing, and a small thing of another tint stands elsewhere."""

    def painted(out: np.ndarray) -> None:
        out[36:44, 14:22] = out[36:44, 26:34]
        out[50:55, 34:39] = tint

    return painted


def test_a_small_thing_of_nearly_its_color_in_another_camera_disputes_it() -> None:
    # 19 from the block's red, as where what is around is mixed in.
    scene = seen(nothing, elsewhere((180, 52, 52)))
    (block,) = find(scene, Target(text="the red block"))
    other = 77  # told apart, as where colors are cut into clusters otherwise

    def renamed(camera: str, box: tuple[slice, slice]) -> CameraView:
        view = scene.episode.views[camera]
        ids = view.ids(0).copy()  # type: ignore[misc]
        ids[box] = other
        return replace(view, ids=lambda t: ids)

    last = renamed("image_1", np.s_[50:55, 34:39])
    bodies = (*scene.bodies, replace(scene.bodies[-1], instance_ids=frozenset({other})))
    views = {**scene.episode.views, "image_1": last}
    split = replace(scene, episode=replace(scene.episode, views=views), bodies=bodies)
    with pytest.raises(TargetError, match=f"there it may be instance {other}; where that is so"):
        find(split, Target(handle=block))
    assert find(split, Target(handle=[block, other])) == {block, other}
    views["image_0"] = renamed("image_0", np.s_[2:8, 2:8])  # it stands beside the block there
    apart = replace(split, episode=replace(scene.episode, views=views))
    assert find(apart, Target(handle=block)) == {block}


def test_refusals_advise_what_works_in_this_scene() -> None:
    def two(out: np.ndarray) -> None:
        out[48:56, 34:42] = BLOCK

    for scene in (seen(nothing, two), seen(two, two), seen(two), seen(two, elsewhere(BLOCK))):
        for words in ("the red thing", "the red block"):
            for every in (False, True):
                try:
                    find(scene, Target(text=words, all=every))
                except TargetError as error:
                    advised(scene, words, str(error))


def advised(scene: Scene, words: str, said: str) -> None:
    assert "say more" not in said  # places take depth
    for ids in re.findall(r"\{handle: (\[[\d, ]+\])\}", said):
        assert find(scene, Target(handle=json.loads(ids)))
    if "all: true" in said:
        assert find(scene, Target(text=words, all=True))
    assert "{handle" in said or "all: true" in said or "cameras.yaml" in said or "edge" in said


def test_putting_things_in_lacks_a_table_and_the_places_of_cameras_at_once() -> None:
    bare = replace(seen(nothing, nothing), roles={}, beliefs={})
    with pytest.raises(TargetError, match=r"nowhere to put things; and nothing says where image_0"):
        find_free_space(bare)
