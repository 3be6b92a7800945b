"""What an instruction says of its nouns: moved, goal, source, whole, part, grip, or nothing that can be told."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.scene.targets.nouns import named

# As RLBench, LIBERO and Meta-World word their tasks.
STATED = {
    "open the middle drawer": {"drawer": "moved"},
    "grip the middle handle and pull the middle drawer open": {"handle": "grip", "drawer": "moved"},
    "open the box": {"box": "whole"},
    "grasp the lid and open the box": {"lid": "moved", "box": "whole"},
    "leave the pan open": {"pan": "whole"},
    "slide open the left door on the cabinet": {"door": "moved", "cabinet": "whole"},
    "grip the handle and slide the fridge door open": {
        "handle": "grip",
        "door": "moved",
        "fridge": "whole",
    },
    "put the money away in the safe on the bottom shelf": {
        "money": "moved",
        "safe": "goal",
        "shelf": "aside",
    },
    "put the black bowl in the bottom drawer of the cabinet": {
        "bowl": "moved",
        "drawer": "part",
        "cabinet": "whole",
    },
    "take the steak off the grill": {"steak": "moved", "grill": "source"},
    "pick the bowl on the box and place it on the plate": {
        "bowl": "moved",
        "box": "source",
        "plate": "goal",
    },
    "pick the bowl next to the ramekin and place it on the plate": {
        "bowl": "moved",
        "ramekin": "aside",
        "plate": "goal",
    },
    "push a button on the coffee machine": {"button": "moved", "machine": "whole"},
    "turn the left most knob on the oven to switch the oven on": {"knob": "moved", "oven": "whole"},
    "turn on the stove and put the moka pot on it": {"stove": "aside", "pot": "moved"},
    "put the pudding to the left of the plate": {"pudding": "moved", "plate": "aside"},
    "wipe the dirt off the desk": {"dirt": "aside", "desk": "source"},
    "pour water from the can into the pot": {"water": "aside", "can": "moved", "pot": "goal"},
}


@pytest.mark.parametrize("text", STATED)
def test_each_noun_has_its_place_in_the_sentence(text: str) -> None:
    assert {noun: found[0].scope for noun, found in named((text,)).items()} == STATED[text]


def test_place_words_before_a_noun_or_after_it() -> None:
    ((left,),) = (named(("turn left tap",))["tap"],)
    ((back,),) = (named(("pick up the bowl at the back",))["bowl"],)
    assert (left.ranks, back.ranks) == (("leftmost",), ("rearmost",))
    moved, goal = named(("stack the left bowl on the right bowl",))["bowl"]
    assert (moved.scope, moved.ranks, goal.scope, goal.ranks) == (
        "moved",
        ("leftmost",),
        "goal",
        ("rightmost",),
    )


def test_what_is_handled_beside_it_is_known() -> None:
    (nail,) = named(("hit the nail with the hammer",))["nail"]
    assert (nail.others, nail.mixed, nail.tool) == (("hammer",), False, False)
    (hammer,) = named(("hit the nail with the hammer",))["hammer"]
    assert hammer.tool
    (mug,) = named(("put the mug in the microwave and close it",))["mug"]
    assert (mug.others, mug.mixed) == ((), True)


SENTENCE = (
    "put the a on in to of and it off with drawer cup open left top , turn pick from box's middle"
)


@given(st.lists(st.sampled_from(SENTENCE.split()), max_size=12).map(" ".join))
def test_any_sentence_is_read(text: str) -> None:
    assert all(meaning.stated in text for found in named((text,)).values() for meaning in found)
