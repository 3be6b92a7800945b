"""Kernels of the video scene beside what they stand for, written with whole arrays."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rpaug.core import geometry
from rpaug.scene.video import colmap, instances, moving, sweep, video_scene
from rpaug.scene.video.kept import KeptInstances

K = np.array([[60.0, 0, 39.5], [0, 60.0, 29.5], [0, 0, 1]])
SHAPE = (60, 80)


def test_correlation_is_that_of_box_filters() -> None:
    rng = np.random.default_rng(0)
    grey = 3 * cv2.GaussianBlur(rng.uniform(0, 255, SHAPE).astype(np.float32), (0, 0), 2)
    seen = (0.7 * grey + rng.normal(20, 3, SHAPE)).astype(np.float32)
    seen[:, :20] = seen[30:36, 50:] = -1e4
    mean, spread = sweep._moments(grey)
    out = np.empty_like(grey)
    sweep.correlation(grey, mean, spread, seen, out)
    window = (sweep.WINDOW, sweep.WINDOW)
    missing = cv2.boxFilter((seen < 0).astype(np.float32), -1, window) > sweep.UNSEEN
    shown = np.maximum(seen, 0)
    there, wide = sweep._moments(shown)
    both = cv2.boxFilter(grey * shown, -1, window)
    expected = np.where(missing, -1, (both - mean * there) / (spread * wide))
    # Single precision: squares of grey levels leave a hundredth of a squared level.
    assert np.abs(out - expected).max() < 0.005


@pytest.mark.parametrize("span", [(0.5, 4.0), (0.05, 0.2)])
def test_flow_is_off_where_no_place_between_near_and_far_explains_it(
    span: tuple[float, float],
) -> None:
    rng = np.random.default_rng(1)
    flow = cv2.GaussianBlur(rng.normal(0, 60, (*SHAPE, 2)), (0, 0), 9).astype(np.float32)
    returned = (-flow + rng.normal(0, 0.8, flow.shape)).astype(np.float32)
    way = geometry.rigid(np.array([0.02, 0.05, -0.01]), np.array([0.1, 0.02, 0.3]))
    out = np.empty(SHAPE, np.float32)
    ahead, beside = K @ way[:3, :3] @ np.linalg.inv(K), K @ way[:3, 3]
    moving.off_line(flow, returned, ahead, beside, np.array(span), out)

    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rays = geometry.rays(columns, rows, K)
    local = [geometry.transform(way, z * rays) for z in span]
    near, far = (
        np.stack(geometry.to_image(one, np.maximum(one[..., 2], 1e-6), K), -1) for one in local
    )
    to, along = np.stack([columns, rows], -1) + flow, far - near
    share = ((to - near) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-9)
    apart = np.linalg.norm(to - near - np.clip(share, 0, 1)[..., None] * along, axis=-1)
    off = apart > moving.ASIDE + moving.DRIFT * np.linalg.norm(flow, axis=-1)
    sure = np.linalg.norm(flow + returned, axis=-1) < moving.RETURNS
    sure &= np.min([one[..., 2] for one in local], axis=0) > 1e-6
    assert np.array_equal(np.isfinite(out), sure)
    assert np.array_equal(out[sure] > 0, off[sure])


def test_the_support_is_laid_in_its_plane_where_that_is_near() -> None:
    rng = np.random.default_rng(2)
    pose = geometry.rigid(np.array([2.2, 0.1, 0.0]), np.array([0.0, 0.0, 1.0]))
    met = instances.plane_depth(K, pose, SHAPE, 0.2)
    depth = (np.maximum(met, 0.5) * rng.uniform(0.4, 1.6, SHAPE)).astype(np.float32)
    ids = rng.integers(0, 5, SHAPE).astype(np.int32)
    support = np.array([1, 3], np.int32)
    near = np.isin(ids, support) & (met > 0) & (np.abs(met / depth - 1) < video_scene.SNAP)
    assert 0 < near.sum() < np.isin(ids, support).sum()
    laid = video_scene.laid(ids, depth, support, K, pose, 0.2)
    assert np.allclose(laid, np.where(near, met, depth))
    none = video_scene.laid(ids, depth, support[:0], K, pose, 0.2)
    assert np.array_equal(none, depth)


def test_pairs_are_neighbours_and_powers_of_two() -> None:
    assert colmap._pairs(4, 2) == 3 + 2
    assert colmap._pairs(100, 4) == 99 + 98 + 97 + 96 + 92


def test_kept_ids_are_those_that_were_found(tmp_path: Path) -> None:
    ids = np.random.default_rng(3).integers(0, 9, SHAPE).astype(np.int32)
    kept = KeptInstances(tmp_path / "state")
    assert np.array_equal(kept.frame(4, lambda k: ids + k), ids + 4)
    again = kept.frame(4, lambda k: ids)
    assert again.dtype == np.int32
    assert np.array_equal(again, ids + 4)
