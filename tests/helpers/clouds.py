"""Gaussians at random, as files may hold them."""

import numpy as np

from rpaug.core.types import Gaussians


def some(n: int, bands: int = 1, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(n, 4))
    return Gaussians(
        rng.uniform(-1, 1, (n, 3)).astype(np.float32),
        (quats / np.linalg.norm(quats, axis=-1, keepdims=True)).astype(np.float32),
        rng.uniform(1e-3, 1e-1, (n, 3)).astype(np.float32),
        rng.uniform(0.01, 0.99, n).astype(np.float32),
        rng.normal(size=(n, bands, 3)).astype(np.float32),
        rng.integers(0, 200, n).astype(np.int32),
    )
