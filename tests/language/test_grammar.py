"""The grammar: every command of the half that is worked with is exactly right, and nonsense changes nothing."""

import contextlib
import re
from types import SimpleNamespace
from typing import Any, cast

import known
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rpaug.core import registry
from rpaug.core.errors import BadRecipe
from rpaug.language import things
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.recording import Recording
from rpaug.language.rounds import said_after
from rpaug.pipeline import recipe
from rpaug.scene.targets import relations

OURS = [*(one for one in known.every() if not one.aside), *known.every(known.OTHERS)]


def rounded(value: Any, of: str = "") -> Any:
    """Numbers to three digits, targets by what they mean: "all the mugs" is every mug, "that is on" is "on"."""
    if isinstance(value, dict):
        return {name: rounded(inner, name) for name, inner in value.items()}
    if isinstance(value, str) and of in ("target", "targets", "near", "text"):
        return re.sub(r"([a-z]{2}?)(?:(?<=x)e)?s'", r"\1'", repr(relations.parse(value)))
    if isinstance(value, list | tuple):
        return [rounded(inner, of) for inner in value]
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return round(float(value), 3) if plain else value


def understood(one: known.Known) -> dict[str, Any] | None:
    """The recipe's own part of what comes of a command; None if it is refused."""
    setting = WishContext(cameras=one.cameras, instructions=one.instructions)
    try:
        answer = said_after(one.say, one.after, setting)
        recipe.build(answer.recipe())
    except (NotUnderstood, BadRecipe):  # `ask` refuses what comes to no valid recipe
        return None
    return rounded({**answer.settings, "edits": list(answer.edits)})


@pytest.mark.parametrize(
    "words", ["the second drawer from the top", "the drawer at the bottom", "the top left drawer"]
)
def test_parts_are_named_by_their_place(words: str) -> None:
    setting = WishContext(cameras=("front",), instructions=("open the middle drawer",))
    (edit,) = said_after(f"make {words} purple", (), setting).edits
    assert edit == {"op": "recolor", "target": words.removeprefix("the "), "color": "purple"}


@pytest.mark.parametrize(
    "one", OURS, ids=lambda one: f"{one.kind}: {' / '.join([*one.after, one.say])[:60]}"
)
def test_commands_with_known_answers(one: known.Known) -> None:
    there = not one.missed and (one.needs is None or one.needs in registry.operator_names())
    assert understood(one) == (rounded(one.answer) if there else None)


def test_there_are_two_hundred_and_half_are_set_aside() -> None:
    every = known.every()
    assert len(every) >= 200
    assert 0.4 < sum(one.aside for one in every) / len(every) < 0.6
    assert {one.kind for one in every} >= {"relations", "rounds", "nonsense", "several"}
    assert len({(one.kind, one.after, one.say, one.instructions) for one in every}) == len(every)


def test_every_operator_can_be_asked_for() -> None:
    asked = {
        option["op"]
        for one in known.every()
        for edit in (one.answer or {}).get("edits", ())
        for option in edit.get("one_of", [edit])
    }
    assert asked >= set(registry.operator_names())


@pytest.mark.parametrize(
    ("wish", "why"),
    [
        ("raise the ceiling camera 5 cm", "front, left_shoulder"),
        ("paint the cup red and reticulate the splines", "reticulate the splines"),
        ("put a unicorn on the table", "no 'unicorn'"),
        ("make the mug 20 cm tall", "factors"),
        ("make the cup twice as small", "half its size"),
        ("cover the box with blue marble", "marble_white, marble_green"),
        ("cold 6500 K light", "6500 K is the recorded light's white"),
        ("move the mug to the left", "how far"),
        ("light it from the left", "from above"),
        ("jitter the mug's lid", "understood would be, for one: 'jitter the front camera"),
        ("paint the cup crinkly", "understood would be, for one: 'paint the cup blue'"),
    ],
)
def test_a_refusal_says_why(wish: str, why: str) -> None:
    with pytest.raises(NotUnderstood, match=why):
        said_after(wish, (), WishContext(cameras=tuple(known.CAMERAS)))


def test_what_is_taken_for_granted_is_told() -> None:
    matte = said_after("make the cup matte black", (), WishContext())
    assert matte.edits == ({"op": "recolor", "target": "cup", "color": "black"},)
    assert matte.notes == ("gloss stays as it was recorded",)
    answer = said_after("look from further left", (), WishContext(cameras=("front",)))
    assert answer.notes == ("10 cm, since no length was named",)
    raised = said_after("move the front camera up by 5 cm", (), WishContext(cameras=("front",)))
    assert raised.notes == (
        "up is where the upper edge of the camera's image is, not up in the room",
    )
    after = said_after("paint the cup blue", ["paint the cup red"], WishContext())
    assert any("takes the place of" in note for note in after.notes)


def test_a_color_belongs_to_what_it_was_said_of() -> None:
    wish = "make the table brown and the walls white"
    assert said_after(wish, (), WishContext()).edits == (
        {"op": "recolor", "target": {"role": "table"}, "color": "brown"},
        {"op": "recolor", "target": {"role": "background"}, "color": "white"},
    )


def test_a_cameras_name_is_no_misspelling() -> None:
    """Not even of a word that it is close to."""
    answer = said_after("blur the eachh camera", (), WishContext(cameras=("eachh", "wrist")))
    assert answer.edits == ({"op": "sensor_blur", "cameras": ["eachh"]},)
    assert answer.notes == ()


def test_a_least_of_a_channel_leaves_all_above_it() -> None:
    wish = "paint the cup in random colors (hue 10-360, saturation at least 0.6)"
    (edit,) = said_after(wish, (), WishContext()).edits
    assert edit["color"] == {"hsv": [[10, 360], [0.6, 1], [0.3, 1]]}


def test_walls_are_flat_and_stand() -> None:
    sizes = {1: (200.0, 300.0, 3.0), 2: (300.0, 4.0, 250.0), 3: (60.0, 40.0, 80.0)}
    there = [{"id": one, "role": "background", "size_cm": size} for one, size in sizes.items()]
    namer = things.Namer(cast(Recording, SimpleNamespace(inventory=there)), None)
    assert namer.target(things.Named("walls")) == {"handle": [2]}
    assert namer.target(things.Named("floor")) == {"handle": [1]}


WORDS = st.sampled_from(
    re.findall(
        r"\S+",
        "make paint the a drawer cup red blue and not near two mug camera front raise 5 cm % it undo remove table of "
        "light by up to left copies with seed delete dataset rm -rf / ; , ( ) . ignore all",
    )
)


@pytest.mark.parametrize("wish", ["raise the front and", "front , the", "tilt front,"])
def test_a_camera_before_a_list_that_breaks_off(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        said_after(wish, (), WishContext(cameras=("front", "front_left")))


@settings(max_examples=150, deadline=None)
@given(st.lists(WORDS, max_size=12))
@example(["drawer", "by", "drawer"])
def test_whatever_is_said_is_refused_or_valid(words: list[str]) -> None:
    try:
        answer = said_after(" ".join(words), (), WishContext(cameras=("front",)))
    except NotUnderstood:
        return
    recipe.build(answer.recipe())


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=80))
def test_no_text_breaks_it(text: str) -> None:
    with contextlib.suppress(NotUnderstood):
        said_after(text, (), WishContext(cameras=("front",)))


@pytest.mark.parametrize(
    ("wish", "order"),
    [
        ("the cup should be blue", "make the cup blue"),
        ("I want the lights a third darker", "make the lights a third darker"),
        ("I'd like the table to look like white marble", "make the table look like white marble"),
        ("all blocks have to be green", "make all blocks green"),
        ("plz put a couple of mugs near the bowl", "put two mugs near the bowl"),
        ("make the bowl about 20% smaller", "make the bowl 20% smaller"),
    ],
)
def test_a_wish_is_an_order(wish: str, order: str) -> None:
    assert said_after(wish, (), WishContext()).edits == said_after(order, (), WishContext()).edits


@pytest.mark.parametrize(
    "wish",
    [
        "the cup should not be red",
        "the dataset should be blue",
        "I want the cup",
    ],
)
def test_what_is_no_order_stays_refused(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        said_after(wish, (), WishContext())
