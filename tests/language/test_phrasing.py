"""Phrasing: what people say and the order it comes to mean the same; nothing is added to what was said."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.language import tokens
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after

CAMERAS = WishContext(cameras=("front", "wrist"))


@pytest.mark.parametrize(
    ("stated", "order"),
    [
        ("I want the yellow cup gone", "remove the yellow cup"),
        ("the cup should be moved 5 cm to the left", "move the cup 5 cm to the left"),
        ("have the scene lit from above", "light the scene from above"),
        ("the walls should get a stone texture", "give the walls a stone texture"),
        ("let the box be red", "make the box red"),
        ("throw two mugs in", "add two mugs"),
        ("a blue book should be placed near the cup", "add a blue book near the cup"),
        ("for the table, a wooden texture", "give the table a wooden texture"),
        ("by 5 cm raise the front camera", "raise the front camera by 5 cm"),
        ("front camera: tilt down 3 degrees", "tilt the front camera down 3 degrees"),
        ("the exposure should vary by up to one stop", "vary the exposure by up to one stop"),
        ("randomly move the cup", "move the cup"),
        ("raise the front camera 1/2 inch", "raise the front camera half an inch"),
        ("move the cup by 5 cm at most", "move the cup by up to 5 cm"),
        ("two distractors of 4-8 cm", "two distractors between 4 cm and 8 cm"),
    ],
)
def test_both_ask_for_the_same(stated: str, order: str) -> None:
    meant = said_after(stated, (), CAMERAS)
    assert meant.edits == said_after(order, (), CAMERAS).edits
    assert meant.edits


@pytest.mark.parametrize(
    "stated",
    [
        "the cup should not be moved",
        "I want the policy gone",
        "have the dataset deleted",
        "the cup should be fed",
        "the camera wants the cup",
        "clear the table",
        "wipe the table",
        "drop the mug",
        "cut the mug",
        "pull the drawer out",
        "push the cup away",
        "shake the bottle",
        "let the cup go",
        "cut the lights",
        "drop the jpeg compression",
        "the robot should pick up the cup",
    ],
)
def test_what_means_nothing_is_refused_in_other_words_too(stated: str) -> None:
    with pytest.raises(NotUnderstood):
        said_after(stated, (), CAMERAS)


@given(
    st.integers(1, 20), st.integers(21, 90), st.sampled_from(["cm", "mm", "inches", "degrees", "%"])
)
def test_a_range_is_said_in_one_way(low: int, high: int, unit: str) -> None:
    plain = f"between {low} {unit} and {high} {unit}"
    whole = tokens.tokens(tokens.split(plain), (), ())
    assert len(whole) == 1
    for stated in (
        f"{low} to {high} {unit}",
        f"{low}-{high} {unit}",
        f"{low}–{high} {unit}",
        f"from {low} to {high} {unit}",
        f"between {low} and {high} {unit}",
        f"{low} {unit} to {high} {unit}",
    ):
        (said,) = tokens.tokens(tokens.split(stated), (), ())
        assert (said.kind, said.value) == (whole[0].kind, whole[0].value)
