"""Metrics against published values and against what they must be by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.core import metrics


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


def test_grown_takes_corners():
    mask = np.zeros((7, 7), bool)
    mask[3, 3] = True
    assert metrics.grown(mask, 2).sum() == 25
    assert metrics.grown(mask, 0) is mask
