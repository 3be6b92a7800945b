"""What was drawn, in words: rounded, named, and whatever operator it was."""

import numpy as np
import pytest

from rpaug.core import registry
from rpaug.pages import told
from rpaug.pipeline import copies, plan, prepare, recipe
from rpaug.scene.targets import survey

EDITS = [
    ({"op": "recolor", "target": {"role": "manipulated"}, "color": "olive"}, "manipulated: brown and gray → olive"),
    ({"op": "table_texture", "texture": "checker_red"}, "table: brown → checker red"),
    ({"op": "light_color", "range": [[0.25] * 3] * 2, "recorded": [0.5] * 3}, "lamps 50 % dimmer, of the same tint"),
    ({"op": "camera_pose", "camera": "front", "turn": 0, "shift": 0}, "front: moved 0.0 cm, turned 0.0 degrees"),
    ({"op": "insert", "category": "mug", "color": "red"}, "added: mug red"),
    ({"op": "remove", "target": {"handle": 221}}, "removed: instance 221"),
    ({"op": "sensor_blur", "sigma": [1.23456, 1.23456]}, "sigma 1.23"),
]  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    edits = [edit for edit, _ in EDITS]
    made = recipe.build({"version": 1, "edits": edits})
    return prepare.prepare_scene(registry.read(registry.SAMPLE, None), made, 0)[0]


@pytest.mark.parametrize(("edit", "words"), EDITS, ids=[edit["op"] for edit, _ in EDITS])
def test_a_draw_in_words(scene, edit, words):
    fields = {name: value for name, value in edit.items() if name != "op"}
    option = recipe.option(edit["op"], fields)
    drawn = option.operator.sample(scene, np.random.default_rng(0))
    made = copies.render(scene, (copies.Draw(0, option, drawn),), plan.make([], scene.episode))
    assert told.draw(made.draws[0].describe(), made.repainted) == words


def test_an_old_color_goes_by_the_word_that_inspect_has(scene):
    rows = {
        row.instance_id: row.color_name
        for row in survey.survey(scene.episode, scene.bodies, scene.roles)
    }
    unseen = max(rows) + 1
    assert survey.color_names(scene.episode, [*rows, unseen]) == rows


def test_a_part_goes_by_its_own_color_and_an_unknown_one_by_none():
    one = {"handle": 3, "albedo": [1, 0, 0], "part": [0]}
    drawn = {
        "op": "recolor",
        "fields": {"target": "mug"},
        "edit": {"color": [0, 0, 1], "surfaces": [one]},
    }
    assert told.draw(drawn, {3: "gray"}) == "mug: red → blue"
    drawn["edit"]["surfaces"] = [{"handle": 3, "albedo": [1, 0, 0]}]
    assert told.draw(drawn, {3: "gray"}) == "mug: gray → blue"
    assert told.draw(drawn) == "mug: as recorded → blue"


def test_what_was_skipped_is_left_out_and_what_was_missing_says_why():
    given = [{"step": 0, "skipped": True}, {"step": 1, "op": "remove", "left_out": "no cup"}]
    assert told.draws(given) == [("remove", "left out: no cup")]


def test_values_for_people_are_rounded_and_short():
    given = {"psnr": 31.23456, "found": True, "bodies": [1, 2, 3, 4], "none": None}
    assert told.short(given) == "psnr 31.2; found yes; bodies 1 2 3 and 1 more; none none"


def test_unknown_operators_are_rounded():
    drawn = {"op": "mine", "edit": {"a": 0.123456789, "b": [1.5, 2, 3, 4, 5], "c": {"d": "x"}}}
    assert told.draw(drawn) == "a 0.123, b 1.5 2 3 and 2 more, c d x"


def test_what_fell_short_of_what_was_asked_is_said():
    drawn = {"op": "mine", "edit": {"a": 1}, "fell_short": ["1 of 2 things", "no lamp"]}
    assert told.draw(drawn) == "a 1 (1 of 2 things; no lamp)"


def test_where_shadows_were_cast_anew_is_said():
    lamps = {"ambient": 0.3, "directions": [[0, 0, 1]], "strengths": [0.7]}
    fields = {"target": {"handle": 3}}
    words = [
        told.draw({"op": "remove", "fields": fields, "edit": {"lamps": one}})
        for one in (lamps, [[0, 0, 1, 0.2]], [])
    ]
    assert words == [
        "removed: instance 3 (shadows cast anew)",
        "removed: instance 3 (its shadow on the table goes along)",
        "removed: instance 3",
    ]


def test_a_lamp_of_some_temperature_is_warmer_or_cooler_alone():
    drawn = {"op": "light_color", "fields": {"temperature": [3000, 3000]}}
    warm = {**drawn, "edit": {"gain": [1.1, 1.0, 0.7]}}
    assert told.draw(warm) == "lamps 7 % dimmer, warmer"
    assert told.draw({**warm, "fields": {}}) == "lamps 7 % dimmer, warmer and greener"


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        ([0.79, 1.11, 0.85], "lamps 8 % dimmer, cooler and greener"),
        ([1.003, 1, 0.999], "lamps as bright, of the same tint"),
        ([0.865, 1.008, 0.841], "lamps 10 % dimmer, greener"),
        ([1.2, 1.0, 1.2], "lamps 13 % brighter, pinker"),
        ([0.9, 0.8, 0.7], "lamps 20 % dimmer, warmer"),
        ([0.5, 0.5, 0.5], "lamps 50 % dimmer, of the same tint"),
    ],
)
def test_a_light_is_called_by_what_it_looks_like(gain, words):
    drawn = {"op": "light_color", "fields": {}, "edit": {"gain": gain}}
    assert told.draw(drawn) == words
