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


def test_decibels_are_those_of_grey_levels_at_another_scale():
    assert metrics.decibels(1.0) == 0
    assert metrics.decibels(0.0) == pytest.approx(120)
    assert metrics.decibels(0.01, least=0.1) == pytest.approx(10)
    assert metrics.decibels(3.7e-4) == pytest.approx(metrics.psnr(3.7e-4 * 255**2))


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
