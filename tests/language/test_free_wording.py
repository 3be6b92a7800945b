"""Wishes in free words: what is common to many is read, and what would be another thing is refused."""

from typing import Any

import pytest

from rpaug.language import repair, values
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after

CAMERAS = ("front", "overhead", "wrist")
SETTING = WishContext(cameras=CAMERAS)


def edits(wish: str) -> list[dict[str, Any]]:
    return list(said_after(wish, (), SETTING).edits)


def recolored(target: Any, color: Any) -> dict[str, Any]:
    return {"op": "recolor", "target": target, "color": color}


TABLE = {"role": "table"}
OAK = {"sample": "wood"}


@pytest.mark.parametrize(
    ("wish", "wanted"),
    [
        (
            "jitter all cameras by 1 cm",
            [{"op": "camera_pose", "camera": list(CAMERAS), "shift": 0.01, "turn": 0}],
        ),
        (
            "jitter all fixed cameras by 1 cm",
            [{"op": "camera_pose", "camera": "static", "shift": 0.01, "turn": 0}],
        ),
        (
            "random camera poses within 3cm for the front camera",
            [{"op": "camera_pose", "camera": "front", "shift": 0.03, "turn": 0}],
        ),
        (
            "wrist camera: 3 deg roll jitter",
            [
                {
                    "op": "camera_pose",
                    "camera": "wrist",
                    "by": [0, 0, 0],
                    "turned": [[0, 0, -0.0524], [0, 0, 0.0524]],
                }
            ],
        ),
        (
            "one stop darker. not the wrist",
            [{"op": "sensor_exposure", "cameras": ["front", "overhead"], "stops": [-1, -1]}],
        ),
        (
            "gaussian noise, sigma around 5.1",
            [{"op": "sensor_noise", "read": [0, 0.02]}],
        ),
        (
            "motion blur of 3 px in the front camera",
            [{"op": "sensor_blur", "cameras": ["front"], "sigma": [0, 0], "motion": [3, 3]}],
        ),
        (
            "wrist cam darker by half a stop and blurrier",
            [
                {"op": "sensor_exposure", "cameras": ["wrist"], "stops": [-0.5, -0.5]},
                {"op": "sensor_blur", "cameras": ["wrist"]},
            ],
        ),
        (
            "wooden table instead of the white one",
            [{"op": "table_texture", "texture": OAK}],
        ),
        ("the cup blue, like our old one", [recolored("cup", "blue")]),
        (
            "I want the cup white without changing the lights, I'd like four green distractors",
            [
                recolored("cup", "white"),
                {"op": "distractors", "count": 4, "color": "green"},
            ],
        ),
        ("plain white table", [{"op": "table_texture", "texture": "white"}]),
        (
            "the cup in whites and reds",
            [{"one_of": [recolored("cup", "white"), recolored("cup", "red")]}],
        ),
        (
            "table in six saturated colors, but no red or pink",
            [recolored(TABLE, {"hsv": [[35, 290], [0.8, 1], [0.75, 1]]})],
        ),
        (
            "green cup in any other pastel color",
            [recolored("green cup", {"hsv": [[165, 70], [0.15, 0.45], [0.85, 1]]})],
        ),
        (
            "marble table, half with white marble and half black",
            [
                {
                    "one_of": [
                        {"op": "table_texture", "texture": "marble_white", "weight": 0.5},
                        {"op": "table_texture", "texture": "marble_black", "weight": 0.5},
                    ]
                }
            ],
        ),
        (
            "the cup like cardboard in 40 % of the copies, like blue plastic in 60 %",
            [
                {
                    "one_of": [
                        {**recolored("cup", {"rgb": [0.76, 0.6, 0.42]}), "weight": 0.4},
                        {**recolored("cup", "blue"), "weight": 0.6},
                    ]
                }
            ],
        ),
        (
            "lamp: 30% very dark, 70% very bright",
            [
                {
                    "one_of": [
                        {"op": "light_color", "brightness": [2 * v, 2 * v], "weight": w}
                        for v, w in ((0.175, 0.3), (0.95, 0.7))
                    ]
                }
            ],
        ),
        ("randomize: table, light", [{"op": "table_color"}, {"op": "light_color"}]),
        (
            "cup blue or green. the table too",
            [
                {"one_of": [recolored(one, color) for color in ("blue", "green")]}
                for one in ("cup", TABLE)
            ],
        ),
        (
            "add a red or blue mug",
            [
                {
                    "one_of": [
                        {"op": "insert", "category": "mug", "color": color}
                        for color in ("red", "blue")
                    ]
                }
            ],
        ),
        (
            "put 2 mugs on the table, one blue and one red",
            [{"op": "insert", "category": "mug", "color": color} for color in ("blue", "red")],
        ),
        (
            "add a mug in any color but red",
            [{"op": "insert", "category": "mug", "color": "blue"}],
        ),
        (
            "a lemon and an apple on the table please",
            [{"op": "insert", "asset": "lemon"}, {"op": "insert", "asset": "apple"}],
        ),
        (
            "add 2 or 3 distractors, not in the way of the drawer or the arm",
            [{"one_of": [{"op": "distractors", "count": n} for n in (2, 3)]}],
        ),
    ],
)
def test_it_is_read(wish: str, wanted: list[dict[str, Any]]) -> None:
    assert edits(wish) == wanted


@pytest.mark.parametrize(
    "wish",
    [
        "recolor the cup so it's not red anymore",
        "floor tiles instead of planks",
        "make the cup not red",
        "put a plant on the cup",
    ],
)
def test_what_would_be_another_thing_is_refused(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        edits(wish)


def test_a_number_of_lamps_is_no_brightness() -> None:
    (edit,) = edits("night, with one lamp")
    assert edit == {"op": "light_color", "brightness": [0.6, 0.6]}


def test_hues_are_left_out_with_what_goes_by_their_names() -> None:
    whole = {"hsv": [[0, 360], [0.8, 1], [0.75, 1]]}
    assert values.apart("red", ["red"]) == ["red"]
    assert values.apart(whole, []) == [whole]
    assert values.apart(whole, ["blue"]) == [{"hsv": [[325, 185], [0.8, 1], [0.75, 1]]}]
    assert values.apart({"hsv": [[0, 360], [0, 1], [0, 1]]}, ["gray"]) == [
        {"hsv": [[0, 360], [0.3, 1], [0, 1]]}
    ]


@pytest.mark.parametrize(
    ("word", "meant"),
    [("plant", "plank"), ("stove", "stone")],
)
def test_a_word_of_its_own_is_not_mended(word: str, meant: str) -> None:
    assert repair.nearest(word, {meant}) is None


@pytest.mark.parametrize(("word", "meant"), [("yelloe", "yellow"), ("purpel", "purple")])
def test_a_slip_is_mended(word: str, meant: str) -> None:
    assert repair.nearest(word, {meant}) == meant


BLUE = recolored("cabinet", "blue")
DARKER = recolored("cabinet", {"rgb": [0.0, 0.0, 0.6]})
UP = {"op": "camera_pose", "camera": "front", "by": [0, -0.05, 0]}


@pytest.mark.parametrize(
    ("before", "wish", "wanted"),
    [
        ("paint the cabinet blue", "darker", [DARKER]),
        ("paint the cabinet blue", "a bit darker please", [DARKER]),
        (
            "paint the cabinet blue in 30% of the copies",
            "darker",
            [{**DARKER, "probability": 0.3}],
        ),
        ("paint the cabinet blue", "darker light", [BLUE, {"op": "light_color"}]),
        ("paint the cabinet blue", "no, green", [recolored("cabinet", "green")]),
        ("paint the cabinet blue", "rather green", [recolored("cabinet", "green")]),
        (
            "raise the front camera 5 cm",
            "the same for the wrist camera",
            [UP, {**UP, "camera": "wrist"}],
        ),
        ("add a mug", "remove the mug again", []),
    ],
)
def test_what_was_said_before_is_gone_on_with(
    before: str, wish: str, wanted: list[dict[str, Any]]
) -> None:
    found = said_after(wish, (before,), SETTING).edits
    assert [{k: v for k, v in one.items() if k != "brightness"} for one in found] == wanted
