"""A color is used as it was said, or refused in words: nothing but plain words tells things of the library."""

import itertools

import pytest

from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after
from rpaug.pipeline import recipe

SETTING = WishContext(cameras=("front",), instructions=("pick up the cup",))
SHADES = ("dark red", "light blue", "pastel", "#ff8000")
NEW = ("add 2 {} distractors", "put a mug of color {} on the table")
OTHERS = (
    "paint the cup {}",
    "make the table {}",
    "tint the light {}",
    "add a {} mug",
    "add two {} cups near the target",
    "swap the cup for a {} mug",
    "make the cup {} or green",
    "give the table a {} checkerboard",
)


@pytest.mark.parametrize(("wish", "shade"), list(itertools.product(NEW, SHADES)))
def test_new_things_are_of_plain_colors(wish: str, shade: str) -> None:
    with pytest.raises(NotUnderstood, match=f"{shade}.*plain color words"):
        said_after(wish.format(shade), (), SETTING)


@pytest.mark.parametrize(("wish", "shade"), list(itertools.product(NEW + OTHERS, (*SHADES, "red"))))
def test_what_is_not_refused_is_a_valid_recipe(wish: str, shade: str) -> None:
    """A BadRecipe would speak of fields that nobody wrote."""
    try:
        answer = said_after(wish.format(shade), (), SETTING)
    except NotUnderstood:
        return
    recipe.build(answer.recipe())
    assert answer.edits
