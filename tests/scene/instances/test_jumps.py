"""Things grow and shrink by and by in a video; where they jump they were told wrongly in one of two frames."""

import pytest

from rpaug.scene.instances.jumps import Jump, jumps


@pytest.mark.parametrize(
    ("areas", "steps", "found"),
    [
        ((4000, 3900, 0, 0, 4100), 3, [Jump(3, 4, 0, 4100), Jump(1, 2, 3900, 0)]),
        ((190, 187, 394, 400), 3, [Jump(1, 2, 187, 394)]),
        ((4000, 2600, 1700, 1300), 3, []),  # by and by
        ((4000, 2600, 1700, 1100, 700, 450, 300, 200, 60, 0), 9, []),  # it leaves the image
        ((0, 4, 0, 2), 3, []),  # specks
        ((0, 0, 0, 0), 0, []),
        ((500,), 0, []),
    ],
)
def test_what_a_video_shows_jumps_where_it_was_told_wrongly(
    areas: tuple[int, ...], steps: int, found: list[Jump]
) -> None:
    assert jumps(dict(enumerate(areas)), 10000) == (steps, found)


def test_frames_that_are_no_neighbours_are_not_compared() -> None:
    assert jumps({0: 4000, 1: 3900, 4: 100}, 10000) == (1, [])
    assert jumps({0: 4000, 2: 100}, 10000) == (1, [Jump(0, 2, 4000, 100)])
