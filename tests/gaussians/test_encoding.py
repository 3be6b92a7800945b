"""Identity encodings: gradients against finite differences, what stays still, and the masks they draw."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from boxes import BLOCK, World
from test_vote import overlap

from rpaug.core.types import Scene
from rpaug.gaussians import semantic
from rpaug.gaussians.encoding import descend, divergence_pull, entropy_pull, neighbours
from rpaug.gaussians.seeds import seeds

QUICK = semantic.Learning(steps=80, rate=0.1, smoothness=0.05, sampled=200)


@pytest.fixture(scope="module")
def lifted(placed: tuple[World, Scene]) -> Scene:
    return replace(placed[1], gaussians=seeds(placed[1]))


@pytest.fixture(scope="module")
def learned(lifted: Scene) -> semantic.Identities:
    return semantic.learn(lifted, semantic.recorded(lifted, 6), settings=QUICK, seed=3)


def slopes(loss: Callable[[], float], array: np.ndarray) -> np.ndarray:
    out = np.zeros(array.size)
    for k in range(array.size):
        kept = array.flat[k]
        array.flat[k] = kept + 1e-6
        high = loss()
        array.flat[k] = kept - 1e-6
        out[k] = (high - loss()) / 2e-6
        array.flat[k] = kept
    return out.reshape(array.shape)


def softmax(x: np.ndarray) -> np.ndarray:
    e = np.exp(x - x.max(-1, keepdims=True))
    return e / e.sum(-1, keepdims=True)


def test_entropy_pull_is_the_gradient() -> None:
    rng = np.random.default_rng(0)
    drawn, weight, offset = (
        rng.normal(size=(3, 4, 16)),
        rng.normal(size=(5, 16)),
        rng.normal(size=5),
    )
    classes = rng.integers(-1, 5, (3, 4))

    def loss() -> float:
        p = softmax(drawn @ weight.T + offset)
        known = classes >= 0
        return float(-np.log(p[known][np.arange(known.sum()), classes[known]]).mean())

    for pulled, array in zip(
        entropy_pull(drawn, classes, weight, offset), (drawn, weight, offset), strict=True
    ):
        np.testing.assert_allclose(pulled, slopes(loss, array), atol=1e-7)


def test_divergence_pull_is_the_gradient_with_neighbours_held() -> None:
    rng = np.random.default_rng(1)
    own, beside = rng.normal(size=(4, 16)), rng.normal(size=(4, 3, 16))
    weight, offset = rng.normal(size=(5, 16)), rng.normal(size=5)
    held = softmax(beside @ weight.T + offset)

    def loss() -> float:
        here = softmax(own @ weight.T + offset)[:, None]
        return float((here * np.log(here / held)).sum(-1).mean())

    for pulled, array in zip(
        divergence_pull(own, beside, weight, offset), (own, weight, offset), strict=True
    ):
        np.testing.assert_allclose(pulled, slopes(loss, array), atol=1e-7)


def test_neighbours_are_the_nearest_others() -> None:
    points = np.random.default_rng(2).normal(size=(80, 3)).astype(np.float32)
    apart = ((points[:, None] - points) ** 2).sum(-1)
    expected = np.sort(np.argsort(apart, 1)[:, 1:5], 1)
    np.testing.assert_array_equal(np.sort(neighbours(points, 4), 1), expected)


def test_learned_masks_are_the_recorded_ones(lifted: Scene, learned: semantic.Identities) -> None:
    assert overlap(lifted, learned.ids) > 0.83
    stage = semantic.LabelRenderer(lifted)
    view = lifted.episode.views["left"]
    assert view.ids is not None
    for t in (0, 16):
        assert (semantic.identity_mask(learned, stage, "left", t) != view.ids(t)).mean() < 0.04


def test_the_same_seed_learns_the_same(lifted: Scene) -> None:
    pictures = semantic.recorded(lifted, 2)
    brief = replace(QUICK, steps=4)
    one = semantic.learn(lifted, pictures, settings=brief, seed=5)
    two = semantic.learn(lifted, pictures, settings=brief, seed=5)
    np.testing.assert_array_equal(one.encodings, two.encodings)
    assert not np.array_equal(
        semantic.learn(lifted, pictures, settings=brief, seed=6).encodings, one.encodings
    )


def test_only_the_named_rows_move(lifted: Scene, learned: semantic.Identities) -> None:
    assert lifted.gaussians is not None
    rows = np.flatnonzero(lifted.gaussians.ids == BLOCK)
    head = learned.instance_ids == BLOCK
    made = descend(
        learned,
        semantic.recorded(lifted, 2),
        semantic.LabelRenderer(lifted),
        neighbours(lifted.gaussians.means, 5),
        settings=replace(QUICK, steps=3),
        rng=np.random.default_rng(0),
        rows=rows,
        head=head,
    )
    rest = np.setdiff1d(np.arange(len(learned.encodings)), rows)
    np.testing.assert_array_equal(made.encodings[rest], learned.encodings[rest])
    np.testing.assert_array_equal(made.weight[~head], learned.weight[~head])
    np.testing.assert_array_equal(made.offset[~head], learned.offset[~head])
    assert not np.array_equal(made.encodings[rows], learned.encodings[rows])
