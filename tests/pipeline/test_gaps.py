"""Frames in which what is edited was not found are told by how much changes in those beside them."""

from types import SimpleNamespace
from typing import Any

import pytest

from rpaug.pipeline.copies import Made
from rpaug.pipeline.report import Tally


def tally(*changed: int, first: int = 0) -> Tally:
    made = Tally(["ego"])
    made.changed = {("ego", first + k): n for k, n in enumerate(changed)}
    made.total = dict.fromkeys(made.changed, 10000)
    return made


@pytest.mark.parametrize(
    ("changed", "gaps"),
    [
        ((4000, 3900, 0, 0, 4100), {1: [2, 3]}),
        ((0, 3, 0, 2800, 2700), {3: [2, 1, 0]}),
        ((4000, 2500, 900, 300, 90, 20, 3, 0), {}),  # it leaves the image
        ((4000, 3000, 5, 3200), {1: [2]}),
        ((0, 4, 0, 2), {}),  # specks
        ((4000, 0), {0: [1]}),
        ((), {}),
    ],
)
def test_what_is_edited_leaves_an_image_by_and_by(
    changed: tuple[int, ...], gaps: dict[int, list[int]]
) -> None:
    assert tally(*changed).gaps("ego") == gaps


def test_frames_that_were_not_rendered_say_nothing() -> None:
    shown = tally(4000, 0)
    shown.changed["ego", 5] = 3000
    shown.total["ego", 5] = 10000
    assert shown.gaps("ego") == {0: [1]}


@pytest.mark.parametrize(("inferred", "said"), [(True, 1), (False, 0)])
def test_they_are_told_by_recorded_frames_where_instances_were_worked_out(
    inferred: bool, said: int
) -> None:
    """Recorded masks know where a thing is: there it may well be gone at once."""
    episode = SimpleNamespace(views={"ego": SimpleNamespace(inferred=inferred)}, length=4)
    back = SimpleNamespace(times=[38, 53, 54, 56])
    scene = SimpleNamespace(episode=episode, back=back)
    made: Any = SimpleNamespace(scene=scene, episode=episode, tally=tally(0, 0, 0, 1350))
    told = Made.uneven.fget(made)  # type: ignore[attr-defined]
    assert len(told) == said
    assert all("frames 38, 53 to 54, and 13.5%" in one and "frame 56" in one for one in told)
