"""What a fit starts from: of a moving camera, each place once."""

import numpy as np
from analytic import EYES, LENGTH, scene

from rpaug.gaussians import seeds
from rpaug.gaussians.frame_residuals import PARTS
from rpaug.gaussians.gaussians import chosen


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
