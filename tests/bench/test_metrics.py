"""Metrics against published values and against what they must be by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.bench import metrics
from rpaug.types import Camera

# Sharma, Wu, Dalal: The CIEDE2000 Color-Difference Formula (2005), table 1.
SHARMA = """
50.0000 2.6772 -79.7751 50.0000 0.0000 -82.7485 2.0425
50.0000 3.1571 -77.2803 50.0000 0.0000 -82.7485 2.8615
50.0000 2.8361 -74.0200 50.0000 0.0000 -82.7485 3.4412
50.0000 -1.3802 -84.2814 50.0000 0.0000 -82.7485 1.0000
50.0000 -1.1848 -84.8006 50.0000 0.0000 -82.7485 1.0000
50.0000 -0.9009 -85.5211 50.0000 0.0000 -82.7485 1.0000
50.0000 0.0000 0.0000 50.0000 -1.0000 2.0000 2.3669
50.0000 -1.0000 2.0000 50.0000 0.0000 0.0000 2.3669
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0009 7.1792
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0010 7.1792
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0011 7.2195
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0012 7.2195
50.0000 -0.0010 2.4900 50.0000 0.0009 -2.4900 4.8045
50.0000 -0.0010 2.4900 50.0000 0.0010 -2.4900 4.8045
50.0000 -0.0010 2.4900 50.0000 0.0011 -2.4900 4.7461
50.0000 2.5000 0.0000 50.0000 0.0000 -2.5000 4.3065
50.0000 2.5000 0.0000 73.0000 25.0000 -18.0000 27.1492
50.0000 2.5000 0.0000 61.0000 -5.0000 29.0000 22.8977
50.0000 2.5000 0.0000 56.0000 -27.0000 -3.0000 31.9030
50.0000 2.5000 0.0000 58.0000 24.0000 15.0000 19.4535
50.0000 2.5000 0.0000 50.0000 3.1736 0.5854 1.0000
50.0000 2.5000 0.0000 50.0000 3.2972 0.0000 1.0000
50.0000 2.5000 0.0000 50.0000 1.8634 0.5757 1.0000
50.0000 2.5000 0.0000 50.0000 3.2592 0.3350 1.0000
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381
6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
"""


def test_ciede2000_of_the_published_pairs():
    rows = np.array(SHARMA.split(), float).reshape(34, 7)
    np.testing.assert_allclose(metrics.ciede2000(rows[:, :3], rows[:, 3:6]), rows[:, 6], atol=5e-5)
    np.testing.assert_allclose(metrics.ciede2000(rows[:, 3:6], rows[:, :3]), rows[:, 6], atol=5e-5)


def test_psnr_by_hand():
    assert metrics.psnr(255.0**2) == 0
    assert metrics.psnr(1.0) == pytest.approx(48.1308, abs=1e-4)
    assert metrics.psnr(0.0) == pytest.approx(88.1308, abs=1e-4)


@given(st.integers(0, 1000))
def test_ssim_is_one_for_equal_images_and_symmetric(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.integers(0, 256, (2, 16, 20, 3)).astype(np.uint8)
    np.testing.assert_allclose(metrics.ssim(a, a), 1)
    np.testing.assert_allclose(metrics.ssim(a, b), metrics.ssim(b, a))
    assert np.abs(metrics.ssim(a, b)).max() <= 1 + 1e-9


def test_ssim_of_flat_images_is_the_luminance_term():
    a, b = np.full((16, 16, 3), 100, np.uint8), np.full((16, 16, 3), 150, np.uint8)
    expected = (2 * 100 * 150 + 6.5025) / (100**2 + 150**2 + 6.5025)
    np.testing.assert_allclose(metrics.ssim(a, b), expected, atol=1e-9)


def test_mean_iou_averages_over_handles_of_all_pairs():
    first, second = np.array([[1, 1, 2, 2]], np.int32), np.array([[1, 2, 2, 2]], np.int32)
    assert metrics.mean_iou([(first, first)]) == 1
    assert metrics.mean_iou([(first, second)]) == pytest.approx((1 / 2 + 2 / 3) / 2)
    both = [(first, second), (first, first)]
    assert metrics.mean_iou(both) == pytest.approx((3 / 4 + 4 / 5) / 2)


def test_reprojection_measures_a_plane_that_one_camera_sees_too_far():
    K = np.array([[40.0, 0, 15.5], [0, 40.0, 15.5], [0, 0, 1]])
    left, right = np.eye(4)[None], np.eye(4)[None].copy()
    right[0, 0, 3] = 0.1
    cameras = Camera(K, left, 32, 32), Camera(K, right, 32, 32)
    # A slanted plane z = 1 + 0.2 y: inverse depth is affine in the row, so interpolation adds nothing.
    rows = (np.arange(32) - 15.5) / 40
    plane = np.tile((1 / (1 - 0.2 * rows))[:, None], (1, 32))
    ids = np.ones((32, 32), np.int32)
    true = metrics.reprojection((plane, plane), (ids, ids), cameras, 0)
    assert len(true) > 700
    np.testing.assert_allclose(true, 0, atol=1e-12)
    off = metrics.reprojection((plane, plane + 0.003), (ids, ids), cameras, 0)
    np.testing.assert_allclose(off, 0.003, atol=2e-5)
    assert not len(metrics.reprojection((plane, plane), (ids, 2 * ids), cameras, 0))
    assert not len(metrics.reprojection((plane, plane - 0.5), (ids, ids), cameras, 0))


def test_grown_takes_corners():
    mask = np.zeros((7, 7), bool)
    mask[3, 3] = True
    assert metrics.grown(mask, 2).sum() == 25
    assert metrics.grown(mask, 0) is mask
