"""A likely misspelling is told with a refusal, and nothing is read as another word than it is."""

import pytest

from rpaug.language import spelling
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after


@pytest.mark.parametrize(
    ("wish", "hint"),
    [
        ("tilt the front camera down 5 degress", "'degress' may be 'degrees'"),
        ("mkae the lights dimmer", "'mkae' may be 'make'"),
        ("make the cup yelow", "'yelow' may be 'yellow'"),
    ],
)
def test_it_is_told(wish: str, hint: str) -> None:
    with pytest.raises(NotUnderstood, match=hint):
        said_after(wish, (), WishContext(cameras=("front",)))


@pytest.mark.parametrize("step", ["paint the cup blue", "add two mugs", "frobnicate xyzzy"])
def test_words_that_are_known_or_like_nothing_are_left_alone(step: str) -> None:
    assert spelling.hint(step) == ""
