"""What a fit starts from: of a moving camera, each place once."""

import numpy as np
from analytic import EYES, LENGTH, scene

from rpaug.gaussians import seeds
from rpaug.gaussians.frame_residuals import PARTS
from rpaug.gaussians.gaussians import chosen


def test_large_images_are_lifted_on_a_grid(monkeypatch):
    plain = scene({"front": EYES["front"]}, length=LENGTH)
    view = plain.episode.views["front"]
    picture = seeds.picture_of(view, 0, frozenset(np.unique(view.ids(0)).tolist()))
    (whole,) = seeds.finest([picture])
    monkeypatch.setattr(seeds, "LARGE", picture.ids.size // 9 + 1)
    (grid,) = seeds.finest([picture])
    assert abs(len(whole) / len(grid) - 9) < 0.6
    assert abs(np.median(grid.scales[:, 1]) / np.median(whole.scales[:, 1]) - 3) < 0.05
    twice = [part for part in seeds.finest([picture, picture]) if len(part)]
    assert [len(part) for part in twice] == [len(grid)]  # of equals the first has it


def test_pictures_asked_one_by_one_leave_what_all_at_once_leave():
    plain = scene({"wrist": EYES["wrist"]}, length=LENGTH, moving="wrist")
    view = plain.episode.views["wrist"]
    handles = frozenset(np.unique(view.ids(0)).tolist())
    pictures = [seeds.picture_of(view, t, handles) for t in range(LENGTH)]
    *known, last = (one for one in pictures if one is not None)
    part = seeds._sparse(last)
    expected = chosen(part, np.isinf(seeds._footprints(part, known)))
    found = seeds._unseen(part, known)
    assert 0 < len(found) == len(expected) < len(part)
    for name in PARTS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
