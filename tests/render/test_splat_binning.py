"""Tile lists: each Gaussian in every tile its bounds touch, nearest first, each entry with a slot of its own."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies
from splat_cases import splats, view

from rpaug.render.splat import Rasteriser
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
