"""A misspelling is mended where one known word is nearest, and that is told; nothing else is read as another word."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.language import repair
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after

LETTERS = st.text("abcde", max_size=6)


@pytest.mark.parametrize(
    ("wish", "note"),
    [
        ("tilt the front camera down 5 degress", "'degress' is read as 'degrees'"),
        ("make the cup yelow", "'yelow' is read as 'yellow'"),
    ],
)
def test_it_is_mended_and_told(wish: str, note: str) -> None:
    assert note in said_after(wish, (), WishContext(cameras=("front",))).notes


def test_a_word_of_two_is_not_guessed() -> None:
    assert repair.nearest("plane", {"plate", "place"}) is None
    assert repair.nearest("plste", {"plate", "glass"}) == "plate"


@pytest.mark.parametrize("wish", ["frobnicate xyzzy", "make the xyzzy blurple"])
def test_what_is_like_nothing_is_refused(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        said_after(wish, (), WishContext())


@given(LETTERS, LETTERS, LETTERS)
def test_letters_apart_are_a_distance(first: str, second: str, third: str) -> None:
    there = repair.distance(first, second)
    assert there == repair.distance(second, first)
    assert (there == 0) == (first == second)
    assert abs(len(first) - len(second)) <= there <= max(len(first), len(second))
    assert repair.distance(first + third, second + third) <= there
