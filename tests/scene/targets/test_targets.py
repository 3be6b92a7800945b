"""Targets by handle, role and words, and what they say when they cannot be met."""

from dataclasses import replace

import boxes
import pytest
from analysed import analysed
from boxes import BLOCK, HAND, OTHER, PAD, World
from pydantic import ValidationError

from rpaug.core.errors import TargetError
from rpaug.core.types import Scene
from rpaug.scene.targets.survey import survey
from rpaug.scene.targets.targets import Target, find


def test_by_handle(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    assert find(scene, Target(handle=BLOCK)) == {BLOCK}
    assert find(scene, Target(handle=[BLOCK, PAD])) == {BLOCK, PAD}
    with pytest.raises(TargetError, match=r"no such instance 99; there is: 1 \("):
        find(scene, Target(handle=99))


def test_by_role(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    assert find(scene, Target(role="receiver")) == {PAD}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("the red cup", {OTHER}),
        ("maroon thing", {OTHER}),
        ("the green object", {BLOCK}),
        ("blue receiver", {PAD}),
        ("manipulated", {BLOCK}),
        ("the robot", {HAND}),
    ],
)
def test_by_words(placed: tuple[World, Scene], text: str, expected: set[int]) -> None:
    _, scene = placed
    assert find(scene, Target(text=text)) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # The hand stands for the robot; it works towards +x of its lowest part, or so the frame is snapped.
        ("the largest red thing", {OTHER}),
        ("the thing closest to the pad", {BLOCK}),
        ("the thing closest to the red block", {BLOCK}),
        ("the tallest thing", {OTHER}),
        ("the thing farthest from the red block", {PAD}),
        ("the block closest to the receiver", {BLOCK}),
        ("the pad", {PAD}),
        ("the smallest block", {BLOCK}),
        ("the cube nearest to the table", {BLOCK, OTHER}),
    ],
)
def test_by_place(placed: tuple[World, Scene], text: str, expected: set[int]) -> None:
    _, scene = placed
    assert find(scene, Target.model_validate({"text": text, "all": True})) == expected


def test_a_plain_string_is_a_text(placed: tuple[World, Scene]) -> None:
    target = Target.model_validate("the red thing")
    assert target == Target(text="the red thing")
    assert find(placed[1], target) == {OTHER}
    assert {"type": "string", "minLength": 1} in Target.model_json_schema()["anyOf"]


def test_words_of_the_instruction_stand_for_roles(placed: tuple[World, Scene]) -> None:
    given = replace(placed[1], descriptions=("put the widget on the gizmo",))
    assert find(given, Target(text="the widget")) == {BLOCK}
    assert find(given, Target(text="the thing closest to the gizmo")) == {BLOCK}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("the gizmo", "'gizmo' is no role, no shape and not in the instruction"),
        ("the metal cube", "'metal' is nothing that masks and depth can tell"),
        ("the thing closest to the block", "of which. 2 things fit there"),
        ("the ball", "nothing fits"),
        ("the cube", "2 things fit: .*say more"),
        ("the third largest cube", "nothing fits"),
    ],
)
def test_what_the_words_do_not_settle(placed: tuple[World, Scene], text: str, message: str) -> None:
    with pytest.raises(TargetError, match=message):
        find(placed[1], Target(text=text))


def test_several_things_are_listed_unless_all_are_meant(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    with pytest.raises(TargetError, match=r"things fit: .*set all: true"):
        find(scene, Target(text="the thing"))
    assert find(scene, Target(text="the thing", all=True)) == scene.instance_ids


def test_nothing_that_fits_lists_what_there_is(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    with pytest.raises(
        TargetError, match=rf"nothing fits; there is: .*{BLOCK} \(green, manipulated, "
    ):
        find(scene, Target(text="the pink cup"))


def test_an_unknown_role_says_why() -> None:
    with pytest.raises(TargetError, match="one frame alone does not show"):
        find(analysed(boxes.still(1).episode()), Target(role="manipulated"))
    with pytest.raises(TargetError, match="nothing was seen to be moved by the robot"):
        find(analysed(boxes.still(4).episode()), Target(role="receiver"))
    with pytest.raises(TargetError, match="no depth or no instance masks"):
        find(analysed(boxes.still(2).episode(masks=False)), Target(role="robot"))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "exactly one"),
        ({"handle": 1, "role": "robot"}, "exactly one"),
        ({"role": "cup"}, "no role is called 'cup'; there are: manipulated"),
        ({"text": "the cup left of"}, "'left of' of what"),
        ({"text": "the red blue thing"}, "several colors"),
        ({"handle": []}, "at least one handle"),
        ({"handel": 3}, "handel"),
    ],
)
def test_bad_targets(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Target(**fields)


def test_survey(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    rows = {row.instance_id: row for row in survey(scene.episode, scene.bodies, scene.roles)}
    assert sorted(rows) == sorted(world.boxes)
    block = rows[BLOCK]
    assert (block.role, block.color_name, block.moving) == ("manipulated", "green", True)
    # Seen from three sides at 1 cm per pixel.
    assert block.size_cm == pytest.approx((7.0, 7.0, 7.0), abs=1.5)
    assert block.frames == len(world.gripper)
    assert (block.first_frame, block.last_frame) == (0, len(world.gripper) - 1)
    seen = scene.episode.views["left"].ids
    assert seen is not None
    assert block.pixels["left"] == sum((seen(t) == BLOCK).sum() for t in range(len(world.gripper)))


def test_survey_of_a_real_recording(real: Scene) -> None:
    rows = {row.instance_id: row for row in survey(real.episode, real.bodies, real.roles)}
    (drawer,) = real.roles["manipulated"]
    assert rows[drawer].size_cm == pytest.approx(
        (37, 26, 12), abs=2
    )  # as its front and depth measure
    frame = max(real.roles["receiver"], key=lambda h: rows[h].size_cm[2])
    assert rows[frame].size_cm == pytest.approx((38, 38, 37), abs=2)
    assert rows[frame].color_name == "tan"
