"""Shares of the copies that exclude each other come to one draw, or are refused."""

from typing import Any

import pytest

from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after

SETTING = WishContext(cameras=("front", "wrist"), instructions=("put the can into the bin",))


def edit(wish: str) -> dict[str, Any]:
    (one,) = said_after(wish, (), SETTING).edits
    return one


def drawn(wish: str, field: str = "color") -> list[tuple[Any, float]]:
    return [(one[field], one["weight"]) for one in edit(wish)["one_of"]]


@pytest.mark.parametrize(
    ("wish", "looks", "whole"),
    [
        ("the can blue 40%, yellow 40%, leave red 20%", [("blue", 0.4), ("yellow", 0.4)], 0.8),
        ("make the can white in 1/4 of copies and black in 1/2, as it is in the rest",
         [("white", 0.25), ("black", 0.5)], 0.75),
        ("the can orange in 30 percent of the copies, black otherwise", [("orange", 0.3), ("black", 0.7)], None),
    ],
)  # fmt: skip
def test_each_look_gets_its_share(wish: str, looks: list[Any], whole: float | None) -> None:
    assert drawn(wish) == looks
    assert edit(wish).get("probability") == whole


def test_lamps_and_halves_of_other_edits_are_drawn_too() -> None:
    dark, bright = (
        one[0] for one, _ in drawn("lamp: 30% dark, 30% bright, the other normal", "brightness")
    )
    assert dark < 1 < bright
    options = edit("randomize the can in half of the copies and in the other half only the lights")[
        "one_of"
    ]
    assert [(one["op"], one["weight"]) for one in options] == [
        ("recolor", 0.5),
        ("light_color", 0.5),
    ]


@pytest.mark.parametrize(
    "wish",
    [
        "the can blue 70%, yellow 70%",
        "randomize the can and the bin in half of the copies, in the other half the lights",
        "make the can blue 40% and the bin red 60%",
        "light 30% darker, 20% warmer",
    ],
)
def test_shares_that_cannot_be_kept_are_refused(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        edit(wish)
