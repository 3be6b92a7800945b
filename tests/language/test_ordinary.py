"""Wishes as people type them: in short, with reasons, in no order; what is said of one thing is done to that alone."""

from typing import Any

import pytest

from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after

SETTING = WishContext(cameras=("front", "wrist"), instructions=("put the can into the bin",))
BLUE: dict[str, Any] = {"op": "recolor", "target": "red can", "color": "blue"}
DISPLAYED: dict[str, Any] = {"op": "sensor_exposure", "stops": [0, 0]}
PASTEL: dict[str, Any] = {"hsv": [[0, 360], [0.15, 0.45], [0.85, 1]]}


def edits(wish: str) -> list[dict[str, Any]]:
    return list(said_after(wish, (), SETTING).edits)


@pytest.mark.parametrize(
    ("wish", "wanted"),
    [
        ("red can -> blue can", [BLUE]),
        ("the red can could be blue, other views stay how they are", [BLUE]),
        ("it looks way too clean in there. the red can should be blue, nothing else should change", [BLUE]),
        ("our lamps go dim in the evening, so make the red can blue", [BLUE]),
        ("red can blue, and pls fix the instruction so it says the right color", [BLUE]),
        (
            "move the can a few cm, differently in each copy",
            [{"op": "move", "target": "can", "shift": 0.05}],
        ),
        (
            "lamp 30% weaker, color temperature 3000 K",
            [{"op": "light_color", "temperature": [3000, 3000], "brightness": [0.7, 0.7]}],
        ),
        ("put some junk on the table", [{"op": "distractors"}]),
        ("turn the red can into a blue one", [BLUE]),
        ("the red can blue like a cola", [BLUE]),
        ("the red can should be blue so that one sees it", [BLUE]),
        (
            "make the red can 10% smaller and blue",
            [{"op": "object_size", "target": "red can", "range": [0.9, 0.9]}, BLUE],
        ),
        (
            "paint the red and blue bins black",
            [
                {"op": "recolor", "target": "red bin", "color": "black"},
                {"op": "recolor", "target": "blue bin", "color": "black"},
            ],
        ),
        ("the can in pastel colors", [{"op": "recolor", "target": "can", "color": PASTEL}]),
        (
            "the can white or black, equal chance",
            [{"one_of": [{"op": "recolor", "target": "can", "color": c} for c in ("white", "black")]}],
        ),
        ("all blocks black", [{"op": "recolor", "target": {"text": "blocks", "all": True}, "color": "black"}]),
        (
            "raise the front camera 5 to 10 cm",
            [{"op": "camera_pose", "camera": "front", "by": [[0, -0.1, 0], [0, -0.05, 0]]}],
        ),
        (
            "shake the front camera by max 3 cm. Turn it max 5 degrees.",
            [{"op": "camera_pose", "camera": "front", "shift": 0.03, "turn": 0.0873}],
        ),
        (
            "the can red, 30%",
            [{"op": "recolor", "target": "can", "color": "red", "probability": 0.3}],
        ),
        ("darker. like 40% of the light", [{"op": "light_color", "brightness": [0.4, 0.4]}]),
        (
            "red can bigger, blue can smaller",
            [
                {"op": "object_size", "target": "red can", "range": [1.1, 1.25]},
                {"op": "object_size", "target": "blue can", "range": [0.8, 0.9]},
            ],
        ),
        (
            "turn the front camera 10 degrees to the left and 5 cm up",
            [{"op": "camera_pose", "camera": "front", "by": [0, -0.05, 0], "turned": [0, -0.1745, 0]}],
        ),
        ("make the lights flicker", [DISPLAYED | {"flicker": [0.1, 0.5]}]),
        ("the lamps flicker by up to half a stop", [DISPLAYED | {"flicker": [0, 0.5]}]),
        ("flickering light, up to 20%", [DISPLAYED | {"flicker": [0, 0.263]}]),
        ("vary the brightness from frame to frame", [DISPLAYED | {"flicker": [0.1, 0.5]}]),
        ("slight flicker in the wrist camera", [DISPLAYED | {"cameras": ["wrist"], "flicker": [0.1, 0.2]}]),
        ("more contrast", [DISPLAYED | {"contrast": [1.2, 1.5]}]),
        ("vary the contrast by 20%", [DISPLAYED | {"contrast": [0.8, 1.2]}]),
        ("randomize contrast from 0.8 to 1.2", [DISPLAYED | {"contrast": [0.8, 1.2]}]),
        ("increase the contrast of the images by 20%", [DISPLAYED | {"contrast": [1.2, 1.2]}]),
        ("reduce the contrast to 70%", [DISPLAYED | {"contrast": [0.7, 0.7]}]),
        ("lower the saturation of the images", [DISPLAYED | {"saturation": [0.5, 0.8]}]),
        ("saturation ±30%", [DISPLAYED | {"saturation": [0.7, 1.3]}]),
        (
            "less contrast in the wrist camera",
            [DISPLAYED | {"cameras": ["wrist"], "contrast": [0.5, 0.8]}],
        ),
        ("noise per frame", [{"op": "sensor_noise"}]),
        ("strong light", [{"op": "light_color", "brightness": [1.6, 1.6]}]),
        ("white can: make it 20% larger", [{"op": "object_size", "target": "white can", "range": [1.2, 1.2]}]),
        ("make it a blue can", [{"op": "recolor", "target": "can", "color": "blue"}]),
        ("remove the can and the tile", [{"op": "remove", "target": "can"}, {"op": "remove", "target": "tile"}]),
        ("all views darker by 50%", [{"op": "sensor_exposure", "stops": [-1, -1]}]),
        (
            "white balance gains +-8%, exposure +-0.3 EV, gamma 0.9 to 1.1",
            [{"op": "sensor_exposure", "gain": [0.92, 1.08], "gamma": [0.9, 1.1], "stops": [-0.3, 0.3]}],
        ),
        (
            "the red can has the same red as the box. Make the red can blue",
            [BLUE],
        ),
        (
            "dim the light, otherwise the policy learns the lamp. And the red can blue",
            [{"op": "light_color", "brightness": [0.6, 0.6]}, BLUE],
        ),
        (
            "strong light from above",
            [{"op": "light_direction", "to": [0, 0, 1]}, {"op": "light_color", "brightness": [1.6, 1.6]}],
        ),
        (
            "the can red, green, blue",
            [{"one_of": [{**BLUE, "target": "can", "color": c} for c in ("red", "green", "blue")]}],
        ),
        (
            "can in 2 colors: red, green",
            [{"one_of": [{**BLUE, "target": "can", "color": c} for c in ("red", "green")]}],
        ),
        ("paint the can blue. the bin too", [{**BLUE, "target": "can"}, {**BLUE, "target": "bin"}]),
        (
            "camera shake! all cameras up to 1 cm, except wrist",
            [{"op": "camera_pose", "camera": ["front"], "shift": 0.01, "turn": 0}],
        ),
        ("front: up to 1 cm jitter", [{"op": "camera_pose", "camera": "front", "shift": 0.01, "turn": 0}]),
        ("light brighter or darker by 30%", [{"op": "light_color", "brightness": [0.7, 1.3]}]),
        ("the light a bit weaker, like 20-30 % less", [{"op": "light_color", "brightness": [0.7, 0.8]}]),
        ("light from other sides", [{"op": "light_direction"}]),
        ("more variety in lighting", [{"op": "light_color"}]),
        ("different lighting conditions", [{"op": "light_color"}]),
        ("mess up the table a bit", [{"op": "distractors"}]),
        ("vary the shadows", [{"op": "shadows"}]),
        (
            "can green/blue/red, each in a third",
            [{"one_of": [{**BLUE, "target": "can", "color": c} for c in ("green", "blue", "red")]}],
        ),
        (
            "jitter camera positions by 3cm/5deg",
            [{"op": "camera_pose", "camera": "static", "shift": 0.03, "turn": 0.0873}],
        ),
        ("make it brighter by 20 to 40 %", [{"op": "light_color", "brightness": [1.2, 1.4]}]),
        ("dimmer, about 60% of now", [{"op": "light_color", "brightness": [0.6, 0.6]}]),
        ("make the can bigger by 10 to 20 %", [{"op": "object_size", "target": "can", "range": [1.1, 1.2]}]),
        ("each copy another table", [{"op": "table_color"}]),
        ("vary the table and the lights but not the cameras", [{"op": "table_color"}, {"op": "light_color"}]),
        ("paint that red can blue", [BLUE]),
        ("dim the light in 20%", [{"op": "light_color", "brightness": [0.6, 0.6], "probability": 0.2}]),
        ("sim2real pack: the can blue", [{**BLUE, "target": "can"}]),
    ],
)  # fmt: skip
def test_it_does_what_is_said(wish: str, wanted: list[dict[str, Any]]) -> None:
    assert edits(wish) == wanted


@pytest.mark.parametrize(
    "wish",
    [
        "the can any color but not red",
        "the can in different colors, but not red",
        "the can any color but never red",
    ],
)
def test_a_banned_color_is_not_drawn(wish: str) -> None:
    (edit,) = edits(wish)
    assert "red" not in {one["color"] for one in edit["one_of"]}


def test_harder_to_see_is_taken_as_dimmer_light_and_told() -> None:
    answer = said_after("make the task harder", (), SETTING)
    assert [one["op"] for one in answer.edits] == ["light_color"]
    assert "dimmer light" in answer.notes[0]


@pytest.mark.parametrize(
    "wish",
    [
        "put a mug there",
        "add a mug away from the can",
        "put the can upside down",
        "bright table, dark wall",
        "the can should not be red",
        "put a banana near the can",
        "cold 6500 K light",
        "make the can red and the bin fuzzy",
        "the can 20% red",
        "the can red and blue",
        "the can blue, and reword the instruction a few ways too",
        "another can in green",
        "table checkered, red/white or blue/white",
        "light from other sides so that the shadows fall elsewhere",
        "change the light color from frame to frame",
        "recolor the can per frame",
        "the light gets darker from frame to frame",
        "flicker the can",
        "contrast 80%",
        "lower contrast by 0.2",
        "more contrast 0.5",
        "decrease contrast by 150%",
        "make the can more saturated",
        "one stop darker and more contrast",
        "flicker by 0.2 stops, or 20%",
        "lights flicker in red",
    ],
)
def test_what_is_not_understood_is_refused(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        edits(wish)


def test_what_was_painted_is_another_color_in_half_of_the_copies() -> None:
    (edit,) = said_after("make it 50/50 with orange", ["paint the can blue"], SETTING).edits
    assert [one["color"] for one in edit["one_of"]] == ["blue", "orange"]


def test_the_same_for_another_thing() -> None:
    first, second = said_after("same for the bin", ["paint the can blue"], SETTING).edits
    assert (first["target"], second["target"], second["color"]) == ("can", "bin", "blue")


@pytest.mark.parametrize(
    "wish", ["other table, not wood", "the table another texture but not wood"]
)
def test_a_banned_texture_is_not_drawn(wish: str) -> None:
    (edit,) = edits(wish)
    names = {one["texture"] for one in edit["one_of"]}
    assert {"marble_white", "slate"} <= names
    assert not names & {"oak", "pine", "walnut"}


def test_no_other_color_is_near_the_banned_one() -> None:
    (edit,) = edits("turn the red can into something that is not blue")
    assert not {one["color"] for one in edit["one_of"]} & {"blue", "navy", "azure", "cyan", "teal"}


def test_what_varies_keeps_no_texture_of_its_description() -> None:
    first, second = edits("vary the wooden table and the red can")
    assert first == {"op": "table_color"}
    assert second["color"] == {"sample": "colosseum"}


def test_that_the_instruction_follows_is_told() -> None:
    answer = said_after("paint the can blue and fix the text to match", (), SETTING)
    assert [one["op"] for one in answer.edits] == ["recolor"]
    assert "the instruction follows" in answer.notes[0]


def test_what_is_left_alone_after_all_is_not_edited() -> None:
    earlier = ["paint the can blue and jitter all cameras"]
    (edit,) = said_after("ok but leave the cameras alone", earlier, SETTING).edits
    assert edit["op"] == "recolor"


def test_each_look_that_is_named_gets_the_same_share() -> None:
    (edit,) = edits("table white or marble, half each")
    shares = {one.get("texture", one.get("color")): one["weight"] for one in edit["one_of"]}
    assert shares.pop("white") == 1
    assert sum(shares.values()) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(
    ("wish", "why"),
    [
        (
            "make the red can blue and shake the front camera, never both in the same copy",
            "exclude",
        ),
        ("wooden table and different light, never together", "exclude"),
        (
            "the can blue instead of red, but pls not the gray/black parts at the rim",
            "not the gray",
        ),
    ],
)
def test_what_is_to_exclude_or_to_be_left_is_no_filler(wish: str, why: str) -> None:
    with pytest.raises(NotUnderstood, match=why):
        edits(wish)


def test_a_choice_excludes_as_it_is() -> None:
    (one,) = edits("the red can either green or blue, never both at once")
    assert [option["color"] for option in one["one_of"]] == ["green", "blue"]


def test_a_share_holds_for_what_takes_an_edits_place() -> None:
    before = said_after("make the lights warmer", (), SETTING)
    (now,) = said_after(
        "stronger in half of the copies", ("make the lights warmer",), SETTING
    ).edits
    assert now["probability"] == 0.5
    assert now["range"] != before.edits[0]["range"]


def test_one_share_of_two_edits_is_of_the_same_copies() -> None:
    one, other = edits("remove the red can and the blue can in one quarter of the copies")
    assert (one["probability"], other["probability"]) == (0.25, 0.25)
    assert one["together"] == other["together"]


@pytest.mark.parametrize("every", ["in all copies", "in all of the copies", "across all copies"])
def test_all_copies_are_all_there_are(every: str) -> None:
    (one,) = edits(f"make the red can bigger {every}")
    assert one["op"] == "object_size"
    assert "probability" not in one


@pytest.mark.parametrize(
    "wish",
    [
        "vary the brightness from 60 to 140 percent",
        "brightness between 60% and 140%",
        "the overall brightness should vary between 60 and 140 percent from copy to copy",
    ],
)
def test_brightness_alone_is_the_lights_and_tints_nothing(wish: str) -> None:
    """It was read as the value of a color; and of `range` each channel is drawn by itself."""
    assert edits(wish) == [{"op": "light_color", "brightness": [0.6, 1.4]}]


def test_what_was_dimmed_gets_warmer_and_stays_as_dim() -> None:
    dim = edits("dim the lights by 40%")
    (warm,) = said_after("warmer", ("dim the lights by 40%",), SETTING).edits
    assert dim == [{"op": "light_color", "brightness": [0.6, 0.6]}]
    assert warm["brightness"] == [0.6, 0.6]
    assert warm["temperature"][0] == warm["temperature"][1] < 6500


def test_white_light_is_white_whatever_the_recorded_tint() -> None:
    assert edits("make the lights white") == [
        {"op": "light_color", "range": [[0.5] * 3, [0.5] * 3]}
    ]


def test_a_tinted_range_says_that_its_tint_varies() -> None:
    answer = said_after("warm light, 20 to 40% dimmer", (), SETTING)
    assert any("its tint varies" in note for note in answer.notes)


def test_warmer_light_is_as_bright_as_it_was() -> None:
    (edit,) = said_after("warmer", ("the light at 3000 K, 3 times as bright",), SETTING).edits
    assert edit["brightness"] == [3, 3]


def test_the_brightness_of_a_thing_is_its_colors() -> None:
    (edit,) = edits("paint the red can with brightness 0.5 to 0.8")
    assert edit["op"] == "recolor"
    assert edit["color"]["hsv"][2] == [0.5, 0.8]


def test_what_changes_together_takes_no_second_share() -> None:
    both = "paint the red can and the blue can green in 30% of the copies"
    with pytest.raises(NotUnderstood, match="same copies as another"):
        edits(f"{both}. paint the red can yellow in 20% of the copies")


@pytest.mark.parametrize("wish", ["make the lights darker by 150%", "dim the lights by up to 100%"])
def test_light_that_cannot_be_is_refused(wish: str) -> None:
    """The first came out brighter, the second as a recipe that is none."""
    with pytest.raises(NotUnderstood):
        edits(wish)
