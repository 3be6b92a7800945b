"""A run says where what it paints jumps from one frame to the next; what comes and goes is refused."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from analytic import scene

from rpaug import TargetError
from rpaug.operators.light_color import Gain
from rpaug.pipeline.copies import Made, render
from rpaug.pipeline.plan import Plan, check_steady
from rpaug.pipeline.report import Tally

PAD = frozenset([29])


def tally(*areas: int, first: int = 0) -> Tally:
    made = Tally(["ego"])
    for k, pixels in enumerate(areas):
        made.area("ego", first + k, PAD, pixels)
        made.total["ego", first + k] = 10000
    return made


@pytest.mark.parametrize(
    ("areas", "told"),
    [
        ((100, 100, 100, 100), None),
        ((0, 0, 0, 1350), "in one of them something else may be painted, or it left out"),
        ((900, 0, 900, 100), "in 2 of 2 steps, most between frames 53 and 54, from 0.0% to 9.0%"),
    ],
)
def test_they_are_told_by_recorded_frames(areas: tuple[int, ...], told: str | None) -> None:
    episode = SimpleNamespace(length=4)
    scene = SimpleNamespace(back=SimpleNamespace(times=[38, 53, 54, 55]))
    made: Any = SimpleNamespace(scene=scene, episode=episode, tally=tally(*areas))
    said = Made.uneven.fget(made)  # type: ignore[attr-defined]
    assert len(said) == (told is not None)
    assert all(one.startswith("ego: 29 is seen to jump ") and str(told) in one for one in said)


@pytest.mark.parametrize("inferred", [True, False])
def test_what_is_painted_is_counted_where_instances_were_worked_out(inferred: bool) -> None:
    """Recorded masks know where a thing is: there it may well be gone at once."""
    recorded = scene({"front": (1.6, 0.3, 1.0)}, length=2)
    view = recorded.episode.views["front"]
    assert view.ids is not None
    one = int(view.ids(0).max())
    episode = replace(recorded.episode, views={"front": replace(view, inferred=inferred)})
    darker = Gain((0.5, 0.5, 0.5), instance_ids=frozenset([one]))
    painted = replace(recorded, episode=episode, appearance=(darker, Gain((0.9, 0.9, 0.9))))
    made = render(painted, (), Plan(tier=0, representations={"front": 0}, bodies=True))
    made.episode.views["front"].rgb(1)
    counted = {("front", frozenset([one])): {1: int((view.ids(1) == one).sum())}}
    assert made.tally.areas == (counted if inferred else {})


def test_what_comes_and_goes_is_not_painted() -> None:
    recorded = scene({"front": (1.6, 0.3, 1.0)}, length=2)
    one, every = Gain((0.5, 0.5, 0.5), instance_ids=frozenset([7])), Gain((0.9, 0.9, 0.9))
    asked = list[frozenset[int]]()

    def unsteady(ids: frozenset[int]) -> str:
        asked.append(ids)
        return "7 comes and goes" if 7 in ids else ""

    film = replace(recorded, back=SimpleNamespace(unsteady=unsteady))
    check_steady(film, replace(film, appearance=(every,)))
    check_steady(recorded, replace(recorded, appearance=(one,)))  # no video
    before = replace(film, appearance=(one,))
    check_steady(before, replace(before, appearance=(one, every)))  # it was there
    assert asked == []
    with pytest.raises(TargetError, match="7 comes and goes; a detector, or outlines"):
        check_steady(film, replace(film, appearance=(every, one)))
    assert asked == [frozenset([7])]
