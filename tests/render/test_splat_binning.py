"""Tile lists: each Gaussian in every tile its bounds touch, nearest first, each entry with a slot of its own."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies
from splat_cases import splats, view

from rpaug.render.splat import Rasteriser, Splats
from rpaug.render.splat._pinhole import COLUMN, FARTHEST, HALF_WIDTH, L22, ROW

SIZES = strategies.tuples(strategies.integers(1, 150), strategies.integers(1, 150))


@settings(max_examples=25, deadline=None)
@given(SIZES, strategies.integers(0, 120), strategies.integers(0, 5), strategies.integers(1, 3))
def test_tile_lists(size, count, seed, threads):
    scene = splats(max(count, 1), seed)
    if seed % 2:  # many equal depths
        means = scene.means.copy()
        means[:, 2] = np.round(means[:, 2])
        scene = dataclasses.replace(scene, means=means)
    if count == 0:
        scene = dataclasses.replace(scene, opacities=np.zeros(1, np.float32))
    engine = Rasteriser(threads=threads)
    engine.forward(scene, view(*size))
    width, height, tile = engine._grid
    record, across = engine._records, -(-width // tile)
    half = [record[:, HALF_WIDTH], np.sqrt(record[:, FARTHEST]) / record[:, L22]]
    drawn = record[:, HALF_WIDTH] >= 0
    slots = []
    for number in range(len(engine._starts) - 1):
        entries = engine._entries[engine._starts[number] : engine._starts[number + 1]]
        left, top = number % across * tile, number // across * tile
        columns = np.arange(left, min(left + tile, width))
        rows = np.arange(top, min(top + tile, height))
        touches = drawn.copy()
        for at, pixels, reach in ((COLUMN, columns, half[0]), (ROW, rows, half[1])):
            touches &= (np.abs(record[:, at, None] - pixels) <= reach[:, None]).any(1)
        expected = np.flatnonzero(touches)
        order = np.argsort(engine._depths[expected], kind="stable")
        np.testing.assert_array_equal(entries, expected[order])
        slots.append(engine._slot_of[engine._starts[number] : engine._starts[number + 1]])
        first = engine._first_slot
        assert ((slots[-1] >= first[entries]) & (slots[-1] < first[entries + 1])).all()
    assert sorted(np.concatenate(slots)) == list(range(len(engine._entries)))


@pytest.mark.parametrize("count", [3000])
def test_long_lists_are_sorted_stably(count):
    """Beyond the insertion sort, with depths that share bytes and tie."""
    rng = np.random.default_rng(0)
    scene = splats(count, 1)
    means = scene.means.copy()
    means[:, :2] *= 0.05
    means[:, 2] = rng.choice(rng.uniform(1, 100, 400), count)
    engine = Rasteriser()
    engine.forward(dataclasses.replace(scene, means=means), view(16, 16))
    entries = engine._entries
    assert len(entries) > 1000
    pairs = list(zip(engine._depths[entries], entries, strict=True))
    assert pairs == sorted(pairs)


def nudged(scene: Splats, share: float, seed: int) -> Splats:
    """The splats as some steps of a fit leave them: moved and scaled by up to `share` of their size."""
    rng = np.random.default_rng(seed)
    sizes = scene.scales.mean(-1, keepdims=True)
    return dataclasses.replace(
        scene,
        means=scene.means + (share * sizes * rng.normal(size=sizes.shape)).astype(np.float32),
        scales=scene.scales * np.exp(share * rng.normal(size=sizes.shape)).astype(np.float32),
    )


def test_a_kept_order_gives_the_same_image_of_the_same_splats():
    scene, at, kept = splats(300, 3), view(90, 70), Rasteriser(keep_order=3)
    expected = Rasteriser().forward(scene, at)
    for _ in range(7):
        np.testing.assert_array_equal(kept.forward(scene, at).color, expected.color)


def test_a_kept_order_is_dropped_when_it_cannot_serve():
    """Another view, another number of splats, or used up: the image is a new one's bit for bit."""
    scene, kept = splats(300, 3), Rasteriser(keep_order=2)
    other = nudged(scene, 0.5, 1)
    for given_, at in (
        (scene, view(90, 70)),
        (scene, view(70, 90)),
        (splats(200, 4), view(70, 90)),
        (splats(200, 4), view(70, 90)),
        (nudged(splats(200, 4), 0.5, 1), view(70, 90)),
        (other, view(90, 70)),
    ):
        np.testing.assert_array_equal(
            kept.forward(given_, at).color, Rasteriser().forward(given_, at).color
        )


@pytest.mark.parametrize("seed", range(3))
def test_errors_of_a_stale_order_are_bounded(seed):
    """Splats that changed by 3 % of their size since: few pixels notice, and gradients point the same way.

    The scene is hard on it: splats of 15 pixels, strewn through each other in depth.
    """
    scene, at, kept = splats(300, seed), view(90, 70), Rasteriser(keep_order=2)
    kept.forward(scene, at)
    moved, fresh = nudged(scene, 0.03, seed), Rasteriser()
    found, expected = kept.forward(moved, at).color, fresh.forward(moved, at).color
    error = np.abs(found - expected).max(-1)
    assert 0 < error.max() < 0.15
    assert (error > 1e-2).mean() < 0.02
    target = np.full_like(expected, 0.5)
    slopes = [engine.backward_squared_error(target)[2].means for engine in (kept, fresh)]
    assert (slopes[0] * slopes[1]).sum() > 0.99 * (slopes[1] ** 2).sum()


def test_splats_that_went_out_of_sight_leave_a_kept_order_without_a_trace():
    scene, at, kept = splats(300, 3), view(90, 70), Rasteriser(keep_order=2)
    kept.forward(scene, at)
    gone = np.arange(300) % 3 == 0
    means, opacities = scene.means.copy(), scene.opacities.copy()
    means[gone, 2], opacities[1] = -1.0, np.nan
    found = kept.forward(dataclasses.replace(scene, means=means, opacities=opacities), at)
    gone[1] = True
    rest = {name: a[~gone] for name, a in vars(scene).items() if a is not None}
    expected = Rasteriser().forward(dataclasses.replace(scene, **rest), at)
    np.testing.assert_array_equal(found.color, expected.color)
    slopes = kept.backward(color=np.ones_like(found.color))
    assert all(not a[gone].any() for a in vars(slopes).values() if a is not None)
