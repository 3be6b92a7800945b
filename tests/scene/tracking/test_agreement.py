"""Points of one camera against the surface that another saw."""

import numpy as np

from rpaug import Camera
from rpaug.scene.tracking import agreement


def test_reprojection_measures_a_plane_that_one_camera_sees_too_far():
    K = np.array([[40.0, 0, 15.5], [0, 40.0, 15.5], [0, 0, 1]])
    left, right = np.eye(4)[None], np.eye(4)[None].copy()
    right[0, 0, 3] = 0.1
    cameras = Camera(K, left, 32, 32), Camera(K, right, 32, 32)
    # A slanted plane z = 1 + 0.2 y: inverse depth is affine in the row, so interpolation adds nothing.
    rows = (np.arange(32) - 15.5) / 40
    plane = np.tile((1 / (1 - 0.2 * rows))[:, None], (1, 32))
    ids = np.ones((32, 32), np.int32)
    true = agreement.reprojection((plane, plane), (ids, ids), cameras, 0)
    assert len(true) > 700
    np.testing.assert_allclose(true, 0, atol=1e-12)
    off = agreement.reprojection((plane, plane + 0.003), (ids, ids), cameras, 0)
    np.testing.assert_allclose(off, 0.003, atol=2e-5)
    assert not len(agreement.reprojection((plane, plane), (ids, 2 * ids), cameras, 0))
    assert not len(agreement.reprojection((plane, plane - 0.5), (ids, ids), cameras, 0))
