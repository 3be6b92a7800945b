"""A part finer than the masks: a red lid on a box whose mask knows the box alone."""

from collections.abc import Sequence
from dataclasses import replace

import boxes
import numpy as np
import pytest
from boxes import OTHER, PAD, Box, World, at
from pydantic import ValidationError

from rpaug.core import geometry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Body, Episode, Gaussians, Scene
from rpaug.gaussians import parts, semantic
from rpaug.gaussians.distil import detected, overlap
from rpaug.gaussians.seeds import seeds
from rpaug.providers.detect import Detection
from rpaug.scene.targets.targets import Target, TargetPart, find

LID = 77


def world() -> World:
    """A broad white box on the table with a small red lid on its top."""
    things = boxes.furniture() | {
        PAD: Box((0.36, 0.36, 0.10), at(0.1, 0.05, 0.05), (225, 225, 225)),
        LID: Box((0.12, 0.12, 0.03), at(0.16, 0.02, 0.115), (190, 20, 20)),
    }
    still = np.tile(at(0.1, 0, 0.5), (3, 1, 1))
    return World(things, still, np.ones(3), size=96)


def coarse(episode: Episode) -> Episode:
    views = {}
    for name, view in episode.views.items():
        assert view.ids is not None
        read = view.ids
        views[name] = replace(
            view, ids=lambda t, read=read: np.where(read(t) == LID, PAD, read(t)).astype(np.int32)
        )
    return replace(episode, views=views)


@pytest.fixture(scope="module")
def fine() -> Episode:
    return world().episode()


@pytest.fixture(scope="module")
def scene(fine: Episode) -> Scene:
    episode = coarse(fine)
    still = np.tile(np.eye(4), (3, 1, 1))
    instance_ids = sorted(set(world().boxes) - {LID})
    bodies = tuple(Body(frozenset([h]), still, "static") for h in instance_ids)
    cameras = {name: view.camera for name, view in episode.views.items()}
    bare = Scene(episode, cameras, bodies, {"receiver": frozenset({PAD})}, False, ())
    return replace(bare, gaussians=seeds(bare))


def box_of(fine: Episode, camera: str, instance_id: int) -> tuple[float, float, float, float]:
    read = fine.views[camera].ids
    assert read is not None
    rows, columns = np.nonzero(read(0) == instance_id)
    return columns.min() - 1.0, rows.min() - 1.0, columns.max() + 1.0, rows.max() + 1.0


def iou(scene: Scene, instance_id: int, fine: Episode) -> float:
    assert scene.gaussians is not None
    stage, both, either = semantic.LabelRenderer(scene), 0, 0
    for name, view in fine.views.items():
        assert view.ids is not None
        drawn = semantic.mask(scene.gaussians.ids, stage, name, 1) == instance_id
        true = view.ids(1) == LID
        both, either = both + (drawn & true).sum(), either + (drawn | true).sum()
    return both / either


def same_but_ids(one: Gaussians, two: Gaussians, rows: Sequence[int]) -> None:
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    rest = np.setdiff1d(np.arange(len(one)), rows)
    np.testing.assert_array_equal(one.ids[rest], two.ids[rest])


@pytest.mark.parametrize("by", ["vote", "encodings"])
def test_the_part_gets_a_handle_and_nothing_else_changes(
    scene: Scene, fine: Episode, by: str
) -> None:
    prompt = semantic.PartPrompt("front", 0, box_of(fine, "front", LID))
    known = None
    if by == "encodings":
        quick = semantic.Learning(steps=60, rate=0.1, smoothness=0.05, sampled=200)
        known = semantic.learn(scene, semantic.recorded(scene, 1), settings=quick)
    given = semantic.tell_apart(scene, frozenset([PAD]), prompt, by=by, identities=known)  # type: ignore[arg-type]
    assert given.finer
    # The lid is some 50 pixels in each image, and the Gaussians are not fitted.
    assert iou(given.scene, given.instance_id, fine) > (0.8 if by == "vote" else 0.6)
    assert scene.gaussians is not None
    assert given.scene.gaussians is not None
    same_but_ids(scene.gaussians, given.scene.gaussians, given.rows.tolist())
    assert len({p.camera for p in given.pictures}) > 1  # one box was carried to other cameras
    assert given.scene.roles["receiver"] == {PAD, given.instance_id}
    assert any({PAD, given.instance_id} <= body.instance_ids for body in given.scene.bodies)
    if known is not None:
        assert given.identities is not None
        others = scene.gaussians.ids != PAD
        np.testing.assert_array_equal(given.identities.encodings[others], known.encodings[others])
        kept = given.identities.instance_ids != given.instance_id
        np.testing.assert_array_equal(given.identities.weight[kept], known.weight)


def test_a_box_around_the_whole_needs_nothing_finer(scene: Scene, fine: Episode) -> None:
    prompt = semantic.PartPrompt("left", 0, box_of(fine, "left", PAD))
    given = semantic.tell_apart(scene, frozenset([PAD]), prompt)
    assert (given.finer, given.instance_id) == (False, PAD)
    assert given.scene is scene


def test_what_cannot_be_told_says_why(scene: Scene, fine: Episode) -> None:
    lid = semantic.PartPrompt("front", 0, box_of(fine, "front", LID))
    with pytest.raises(TargetError, match="nothing of the target stands out"):
        semantic.tell_apart(scene, frozenset([OTHER]), lid)
    with pytest.raises(TargetError, match="not one rigid body"):
        semantic.tell_apart(scene, frozenset([PAD, OTHER]), lid)
    with pytest.raises(TargetError, match=f"instance id {OTHER} is taken"):
        semantic.tell_apart(scene, frozenset([PAD]), lid, instance_id=OTHER)


def test_a_detector_gives_the_box(scene: Scene, fine: Episode) -> None:
    lid = box_of(fine, "front", LID)
    elsewhere = box_of(fine, "front", OTHER)

    def detector(image: np.ndarray, words: str) -> list[Detection]:
        return [Detection(elsewhere, 0.9), Detection(lid, 0.6)] if words == "lid" else []

    assert detected(scene, frozenset([PAD]), "lid", detector, "front", 0).box == lid
    with pytest.raises(TargetError, match="finds no 'knob' on the target in camera front"):
        detected(scene, frozenset([PAD]), "knob", detector, "front", 0)


def test_targets_with_parts(scene: Scene, fine: Episode) -> None:
    bare = replace(scene, gaussians=None)
    target = Target(
        role="receiver", part=TargetPart(camera="front", box=box_of(fine, "front", LID))
    )
    with pytest.raises(TargetError, match="not told apart in this episode"):
        find(bare, target)
    made = parts.given(bare, [target, target])
    assert made.gaussians is None
    assert target.part is not None
    assert find(made, target) == {target.part.instance_id}
    both = either = 0
    for name, view in made.episode.views.items():
        recorded, true = scene.episode.views[name].ids, fine.views[name].ids
        assert view.ids is not None
        assert recorded is not None
        assert true is not None
        ids = view.ids(2)
        mine = ids == target.part.instance_id
        np.testing.assert_array_equal(ids[~mine], recorded(2)[~mine])
        both, either = (
            both + (mine & (true(2) == LID)).sum(),
            either + (mine | (true(2) == LID)).sum(),
        )
    assert both / either > 0.8
    for part, message in (
        (TargetPart(camera="top", box=(1, 1, 2, 2)), "no camera is called 'top'; there are: front"),
        (TargetPart(camera="left", frame=3, box=(1, 1, 2, 2)), "frame 3 of 3"),
        (TargetPart(camera="left", box=box_of(fine, "left", PAD)), "leave `part` out"),
    ):
        with pytest.raises(TargetError, match=message):
            parts.given(bare, [Target(handle=PAD, part=part)])
    unknown = TargetPart(camera="left", box=(1, 1, 2, 2), segmenter="scissors")
    with pytest.raises(Unsupported, match="scissors: no model there"):
        parts.given(bare, [Target(handle=PAD, part=unknown)])


def test_bad_parts() -> None:
    for fields in (
        {},
        {"words": "lid"},
        {"box": (3, 3, 1, 4)},
        {"box": (0, 0, 1, 1), "words": "x"},
    ):
        with pytest.raises(ValidationError, match=r"give a box, or words|left < right"):
            TargetPart(camera="front", **fields)  # type: ignore[arg-type]


def test_overlap_of_boxes() -> None:
    assert overlap((0, 0, 9, 9), (0, 0, 9, 9)) == 1
    assert overlap((0, 0, 9, 9), (5, 0, 14, 9)) == pytest.approx(1 / 3)
    assert overlap((0, 0, 1, 1), (5, 5, 6, 6)) == 0
    assert overlap(None, (0, 0, 1, 1)) == 0


def test_a_part_of_what_moves_is_found_where_it_went(fine: Episode) -> None:
    """The box slides and turns from frame to frame: masks of all frames lie on its lid as it is there."""
    made, length = world(), 3
    motion = np.stack(
        [
            geometry.rigid(np.array([0, 0, 0.5 * t]), np.array([-0.08 * t, 0.1 * t, 0.0]))
            for t in range(length)
        ]
    )
    things = {
        one: replace(box, poses=motion @ box.poses) if one in (PAD, LID) else box
        for one, box in made.boxes.items()
    }
    episode = replace(made, boxes=things).episode()
    still = np.tile(np.eye(4), (length, 1, 1))
    bodies = tuple(
        Body(
            frozenset([one]), motion if one == PAD else still, "aligned" if one == PAD else "static"
        )
        for one in sorted({*things} - {LID})
    )
    cameras = {name: view.camera for name, view in episode.views.items()}
    bare = Scene(coarse(episode), cameras, bodies, {"receiver": frozenset({PAD})}, False, ())
    scene = replace(bare, gaussians=seeds(bare))
    prompt = semantic.PartPrompt("front", 0, box_of(episode, "front", LID))
    given = semantic.tell_apart(scene, frozenset([PAD]), prompt)
    assert given.finer
    later = [one for one in given.pictures if one.t > 0]
    assert later
    for one in later:
        ids = episode.views[one.camera].ids
        assert ids is not None
        found, true = one.ids == given.instance_id, ids(one.t) == LID
        assert (found & true).sum() / (found | true).sum() > 0.5
