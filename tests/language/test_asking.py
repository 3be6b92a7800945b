"""A wish is grounded in a recorded scene, becomes a recipe that loads, and goes on over several rounds."""

import json

import pytest
import yaml
from tabletop import gl, scene, take

from rpaug.core.errors import BadInput, TargetError, Unsupported
from rpaug.language import asking, declared, rounds
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.pipeline import recipe


def setting() -> WishContext:
    return asking.setting_of(take().episode)


@gl
def test_a_wish_becomes_a_recipe_with_a_log(tmp_path):
    asked = asking.ask("make the cylinder blue and raise the front camera 5 cm", setting(), scene)
    path = tmp_path / "recipe.yaml"
    path.write_text(asked.yaml)
    assert [step.options[0].name for step in recipe.load(path).steps] == ["recolor", "camera_pose"]
    assert "# asked: make the cylinder blue" in asked.yaml
    stages = [json.loads(line) for line in asked.log.splitlines()]
    assert [one["stage"] for one in stages] == [
        "manager",
        "operation",
        "renderer",
        "grounding",
        "refiner",
    ]
    assert all({"input", "output", "prompt", "by"} <= one.keys() for one in stages)
    assert stages[3]["output"]


@gl
def test_both_sides_of_a_relation_are_found_first():
    asked = asking.ask("make the block closest to the cylinder white", setting(), scene)
    (found,) = [one.output for one in asked.trace if one.stage == "grounding"]
    assert next(iter(found)) == "cylinder"
    assert len(found) == 2


@gl
@pytest.mark.parametrize(
    ("wish", "error"),
    [
        ("paint the piano red", TargetError),
        ("remove the manipulated object", Unsupported),
        ("paint the block red", TargetError),  # there are several
        ("make the cylinder blurple", NotUnderstood),
        ("paint both cylinders red", NotUnderstood),  # there is one
    ],
)
def test_what_the_scene_has_nothing_for_is_refused(wish, error):
    with pytest.raises((error, Unsupported)):
        asking.ask(wish, setting(), scene)


@gl
def test_what_is_named_beside_the_distractors_is_not_passed_over():
    asked = asking.ask("remove the distractors and the largest block", setting(), scene)
    assert [edit["op"] for edit in asked.recipe["edits"]] == ["remove", "remove"]


def test_a_talk_goes_on_and_back(tmp_path):
    talk, path = rounds.History(), tmp_path / "talk.json"
    for wish in ("paint the cup blue", "add two mugs", "now make the cup darker"):
        asked = asking.ask(wish, WishContext(cameras=("front",)), history=talk)
        path.write_text(asked.history.model_dump_json())
        talk = rounds.load(path)
    assert len(talk.rounds) == 3
    assert asked.recipe["edits"][0]["color"] == {"rgb": [0.0, 0.0, 0.6]}
    undone = asking.ask("undo", WishContext(), history=talk)
    assert undone.recipe["edits"][0]["color"] == "blue"
    less = asking.ask("undo the mugs", WishContext(), history=talk)
    assert [edit["op"] for edit in less.recipe["edits"]] == ["recolor"]


def test_a_broken_history_is_refused(tmp_path):
    path = tmp_path / "talk.json"
    for text in ("", "{", '{"rounds": [{"said": 3}]}', '{"rounds": [], "extra": 1}'):
        path.write_text(text)
        with pytest.raises(BadInput, match="history"):
            rounds.load(path)


def test_an_over_long_wish_is_refused():
    with pytest.raises(NotUnderstood, match="characters"):
        asking.ask("a" * 5000, WishContext())


@pytest.mark.parametrize(
    ("stated", "inner"),
    [
        ("cup closest to the drawer", ["drawer"]),
        ("block left of the cup on the pad", ["pad", "cup on the pad"]),
        ("block that is nearest", []),
        ({"role": "table"}, []),
    ],
)
def test_the_phrases_inside_a_target(stated, inner):
    assert declared.phrases(stated) == inner


def test_notes_and_wishes_cannot_break_out_of_their_comment():
    asked = asking.ask("paint the cup\nblue\n", WishContext())
    assert yaml.safe_load(asked.yaml)["edits"] == [
        {"op": "recolor", "target": "cup", "color": "blue"}
    ]


def test_it_says_how_each_part_was_read():
    asked = asking.ask("paint the cup red or blue, dim the light", WishContext())
    assert asked.read == (
        "'paint the cup red or blue' as one of 2: recolor target cup color red, ...",
        "'dim the light' as light_color brightness [0.6, 0.6]",
    )
    assert f"# read: {asked.read[0]}\n" in asked.yaml
