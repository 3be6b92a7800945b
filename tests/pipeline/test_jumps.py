"""What is painted grows and shrinks by and by; where it jumps it was told wrongly, or not at all, in one frame."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from analytic import scene

from rpaug.operators.light_color import Gain
from rpaug.pipeline.copies import Made, render
from rpaug.pipeline.plan import Plan
from rpaug.pipeline.report import Jump, Tally

PAD = frozenset([29])


def tally(*areas: int, first: int = 0) -> Tally:
    made = Tally(["ego"])
    for k, pixels in enumerate(areas):
        made.area("ego", first + k, PAD, pixels)
        made.total["ego", first + k] = 10000
    return made


@pytest.mark.parametrize(
    ("areas", "steps", "jumps"),
    [
        ((4000, 3900, 0, 0, 4100), 3, [Jump(3, 0, 4100), Jump(1, 3900, 0)]),
        ((190, 187, 394, 400), 3, [Jump(1, 187, 394)]),
        ((4000, 2600, 1700, 1300), 3, []),  # by and by
        ((4000, 2600, 1700, 1100, 700, 450, 300, 200, 60, 0), 9, []),  # it leaves the image
        ((0, 4, 0, 2), 3, []),  # specks
        ((0, 0, 0, 0), 0, []),
        ((500,), 0, []),
    ],
)
def test_what_is_painted_grows_and_shrinks_by_and_by(
    areas: tuple[int, ...], steps: int, jumps: list[Jump]
) -> None:
    assert tally(*areas).jumps("ego", PAD) == (steps, jumps)


def test_frames_that_are_no_neighbours_are_not_compared() -> None:
    shown = tally(4000, 3900)
    shown.area("ego", 5, PAD, 100)
    assert shown.jumps("ego", PAD) == (1, [])


@pytest.mark.parametrize(
    ("areas", "told"),
    [
        ((100, 100, 100, 100), None),
        ((0, 0, 0, 1350), "in one of them something else may be painted, or it left out"),
        ((900, 0, 900, 900), "in 2 of 3 steps, most between frames 38 and 53, from 9.0% to 0.0%"),
    ],
)
def test_they_are_told_by_recorded_frames(areas: tuple[int, ...], told: str | None) -> None:
    episode = SimpleNamespace(length=4)
    scene = SimpleNamespace(back=SimpleNamespace(times=[38, 53, 54, 56]))
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
