"""Where pixels of many images lie: as `surface.lift` tells it for each of them."""

import numpy as np
import pytest
import torch
from devices import DEVICES
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpaug.core import geometry
from rpaug.render.batched.pixels import Pixels
from rpaug.scene.recorded import batched, pooled, surface
from rpaug.scene.recorded.batched import Moved, PlacedPixels, Places
from rpaug.scene.recorded.pooled import AROUND, Pool

K = np.array([[50.0, 0, 5.2], [0, 55.0, 3.9], [0, 0, 1]])
POSES = np.stack(
    [np.eye(4), geometry.rigid(np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, -0.5]))]
)
DEPTHS = arrays(
    np.float32,
    (2, 9, 11),
    elements=st.one_of(
        st.sampled_from([0.0, np.nan, np.inf, 1.0, 1.01]), st.floats(0.25, 4, width=32)
    ),
)
LABELS = arrays(np.int32, (2, 9, 11), elements=st.integers(0, 2))


def close(depth: np.ndarray, ids: np.ndarray, pool: Pool | None, device: torch.device) -> None:
    """That both lift alike."""
    found = batched.lift(
        torch.from_numpy(depth).to(device), torch.from_numpy(ids).to(device), K, POSES, pool
    )
    rows = np.arange(ids[0].size)
    known = np.nan_to_num(depth, posinf=0.0, neginf=0.0)
    for n in range(len(depth)):
        expected = surface.lift(known[n], ids[n], K, POSES[n], rows, pool or pooled.nothing(9, 11))
        for one, other in zip((found.points, found.facing, found.footprint), expected, strict=True):
            mine = one[n].cpu().numpy().reshape(other.shape)
            assert np.isfinite(mine).all()
            np.testing.assert_allclose(mine, other, atol=1e-5, rtol=1e-5)


@settings(deadline=None, max_examples=60)
@given(DEPTHS, LABELS)
def test_images_lie_where_each_alone_lies(depth: np.ndarray, ids: np.ndarray) -> None:
    close(depth, ids, None, torch.device("cpu"))


@settings(deadline=None, max_examples=40)
@given(DEPTHS, LABELS, st.integers(0, 2**32 - 1))
def test_what_other_frames_showed_counts(depth: np.ndarray, ids: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    around = rng.uniform(0.5, 2, (9, 11, 3, AROUND)).astype(np.float32)
    around[..., 1:] *= rng.integers(0, 2, around[..., 1:].shape)
    around[:, :, 1, 0] = np.nan_to_num(depth[0], posinf=0.0, neginf=0.0)
    close(
        depth,
        ids,
        Pool(rng.integers(0, 3, (9, 11, 3), np.int32), around, 0.01),
        torch.device("cpu"),
    )


@pytest.mark.parametrize("device", DEVICES)
def test_images_are_lifted_alike_on_any_device(device: torch.device) -> None:
    rng = np.random.default_rng(1)
    depth = (1 + 0.1 * rng.standard_normal((2, 9, 11))).astype(np.float32)
    close(depth, np.ones((2, 9, 11), np.int32), None, device)


def test_what_moved_lies_in_its_bodys_frame() -> None:
    rng = np.random.default_rng(2)
    depth = torch.from_numpy(rng.uniform(1, 2, (2, 9, 11)).astype(np.float32))
    ids = torch.from_numpy(rng.integers(0, 3, (2, 9, 11), np.int32))
    lifted = batched.lift(depth, ids, K, POSES)
    moved = Moved.of([[(1, POSES[1])], []], ids.device)
    places = Places(
        ids, lambda: lifted, lambda: moved, lambda: torch.ones_like(depth), lambda: None
    )
    at = Pixels.where(torch.ones_like(ids, dtype=torch.bool))
    found = PlacedPixels(at, places)
    back = geometry.inverse(POSES[1])
    inside = ((at.image == 0) & (found.ids == 1)).numpy()
    points, normals = lifted.points.reshape(-1, 3).numpy(), lifted.facing.reshape(-1, 3).numpy()
    np.testing.assert_allclose(
        found.points[inside], geometry.transform(back, points[inside]), atol=1e-5
    )
    np.testing.assert_allclose(found.normals[inside], normals[inside] @ back[:3, :3].T, atol=1e-5)
    assert np.array_equal(found.points[~inside], points[~inside])
    assert np.array_equal(found.normals[~inside], normals[~inside])
