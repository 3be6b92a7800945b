"""What scripted cameras and depth networks make of an episode: as noisy and as wrong as they are asked to be."""

import numpy as np
import pytest

from rpaug.core.types import Episode
from tools.bench import photographing
from tools.bench.scripted_depth import RELATIVE_ERROR, ScriptedDepth

LENGTH, SIZE = 6, 96


def episode(seed: int = 0) -> Episode:
    rng = np.random.default_rng(seed)
    rgb = np.repeat(rng.integers(40, 200, (1, SIZE, SIZE, 3)).astype(np.uint8), LENGTH, 0)
    rgb[:, :4, :4, 0] = 10 * np.arange(LENGTH, dtype=np.uint8)[:, None, None]
    down = np.linspace(1, 2, SIZE, dtype=np.float32)[:, None] * np.ones(SIZE, np.float32)
    K = np.array([[100.0, 0, 48], [0, 100, 48], [0, 0, 1]])
    depth = np.repeat(down[None], LENGTH, 0)
    return Episode.from_arrays(rgb, depth=depth, cameras=(K, np.eye(4)))


@pytest.mark.parametrize("quality", list(RELATIVE_ERROR))
def test_depth_is_off_by_what_its_quality_says(quality: str) -> None:
    truth = episode()
    model = ScriptedDepth(truth, truth, quality, seed=3)
    view = truth.views["front"]
    off, scales = [], []
    for t in range(LENGTH):
        ratio = model(view.rgb(t)) / view.depth(t)
        scales.append(np.median(ratio))
        off.append(np.abs(ratio / scales[-1] - 1).mean())
    assert np.mean(off) == pytest.approx(RELATIVE_ERROR[quality], rel=0.35, abs=1e-6)
    assert (np.std(scales) > 0) == (quality != "perfect")


def test_an_image_that_is_no_frame_has_the_depth_of_what_it_looks_like() -> None:
    truth = episode()
    model = ScriptedDepth(truth, truth, "perfect", seed=3)
    median = np.median([truth.views["front"].rgb(t) for t in range(LENGTH)], 0).astype(np.uint8)
    assert np.array_equal(model(median), truth.views["front"].depth(0))


def test_a_photograph_is_what_its_camera_develops_and_noise() -> None:
    truth = Episode.from_arrays(np.full((LENGTH, SIZE, SIZE, 3), 120, np.uint8))
    faults = photographing.CameraFaults((0.9, 0.8, 1.0), 0.5, 3.0, 95)
    taken = photographing.photographed(truth, faults, seed=1).views["front"]
    clean = photographing.photographed(truth, faults, seed=1, noisy=False).views["front"]
    off = taken.rgb(2).astype(float) - clean.rgb(2)
    assert abs(off.mean()) < 0.5
    assert 1.5 < off.std() < 6
    assert np.array_equal(taken.rgb(2), taken.rgb(2))


def test_a_film_is_nearer_to_what_was_developed_the_better_its_quality() -> None:
    truth = episode()
    off = []
    for crf in (10, 40):
        faults = photographing.CameraFaults((0.9, 0.8, 1.0), 0.5, 1.0, 95, crf)
        taken = photographing.photographed(truth, faults, seed=1).views["front"]
        clean = photographing.photographed(truth, faults, seed=1, noisy=False).views["front"]
        off.append(
            [np.abs(taken.rgb(t).astype(float) - clean.rgb(t)).mean() for t in range(LENGTH)]
        )
    good, poor = np.mean(off, 1)
    assert len(off[0]) == LENGTH
    assert 1 < good < poor / 1.5
