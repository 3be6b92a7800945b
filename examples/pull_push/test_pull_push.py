"""A hole in a smooth image is painted as it was: `pip install . && python -m pytest`."""

import numpy as np
from pull_push import paint


def test_a_slope_goes_on_in_the_hole():
    across = np.linspace(40, 200, 64)
    image = np.repeat(np.broadcast_to(across, (48, 64))[..., None], 3, 2).astype(np.uint8)
    hole = np.zeros((48, 64), bool)
    hole[15:30, 20:36] = True
    painted = paint(np.where(hole[..., None], 0, image), hole)
    assert painted.dtype == np.uint8
    assert np.array_equal(painted[~hole], image[~hole])
    assert np.abs(painted[hole].astype(int) - image[hole]).max() < 25
