"""Every operation of the SIMD value type against numpy, lane by lane."""

import numba
import numpy as np
import pytest

from rpaug.render.splat import _simd as simd
from rpaug.render.splat._banks import (
    bank_dot,
    bank_fma,
    bank_of_zeros,
    broadcast_bank,
    load_bank,
    store_bank,
    store_totals,
)
from rpaug.render.splat._simd import (
    absolute,
    bits,
    block_columns,
    block_rows,
    broadcast,
    fma,
    load,
    lowest_bit,
    maximum,
    minimum,
    negative,
    next_ticket,
    prefetch,
    select,
    store,
)


def lanes(seed: int, count: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=16 * count).astype(np.float32)


@numba.njit
def _arithmetic(a, b, out):
    x, y = load(a, 0), load(b, 0)
    store(out, 0, x + y)
    store(out, 16, x - y)
    store(out, 32, x * y)
    store(out, 48, x / y)
    store(out, 64, fma(x, y, x))
    store(out, 80, minimum(x, y))
    store(out, 96, negative(x))
    store(out, 112, 2 * x - np.float32(3) + 1)
    store(out, 128, maximum(x, y))
    store(out, 144, absolute(x))


def test_arithmetic():
    a, b, out = lanes(0), lanes(1), np.empty(160, np.float32)
    _arithmetic(a, b, out)
    wide = a.astype(np.float64)
    np.testing.assert_array_equal(out[:16], a + b)
    np.testing.assert_array_equal(out[16:32], a - b)
    np.testing.assert_array_equal(out[32:48], a * b)
    np.testing.assert_array_equal(out[48:64], a / b)
    np.testing.assert_allclose(out[64:80], wide * b + a, rtol=0, atol=5e-7)
    np.testing.assert_array_equal(out[80:96], np.minimum(a, b))
    np.testing.assert_array_equal(out[96:112], -a)
    np.testing.assert_allclose(out[112:128], 2 * wide - 2, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(out[128:144], np.maximum(a, b))
    np.testing.assert_array_equal(out[144:], np.abs(a))


@numba.njit
def _compare(a, b, out):
    x, y = load(a, 0), load(b, 0)
    out[0], out[1], out[2], out[3] = bits(x < y), bits(x <= y), bits(x > y), bits(x >= y)
    out[4], out[5] = bits((x > 0) & (y > 0)), bits(x > 100)
    store(a, 0, select(x < y, x, 7))


def test_comparisons_and_masks():
    a, b, out = lanes(0), lanes(1), np.empty(6, np.int64)
    a[3] = b[3]
    a[5] = np.nan
    before = a.copy()
    _compare(a, b, out)

    def packed(where):
        return sum(1 << int(i) for i in np.flatnonzero(where))

    expected = [
        before < b,
        before <= b,
        before > b,
        before >= b,
        (before > 0) & (b > 0),
        before > 100,
    ]
    assert out.tolist() == [packed(where) for where in expected]
    np.testing.assert_array_equal(a, np.where(before < b, before, np.float32(7)))


@numba.njit
def _ramps(value, out):
    store(out, 0, block_columns())
    store(out, 16, block_rows())
    store(out, 32, broadcast(value))


def test_ramps_and_broadcast():
    out = np.empty(48, np.float32)
    _ramps(2.5, out)
    rows, columns = np.divmod(np.arange(16), 4)
    np.testing.assert_array_equal(out, np.concatenate([columns, rows, np.full(16, 2.5)]))


@numba.njit
def _banks(weights, table, row, state, out):
    w = load(weights, 0)
    values = broadcast_bank(table, row, 5)
    kept = load_bank(state, 16, 5)
    store_bank(out, 0, bank_fma(w, values, kept))
    store(out, 80, bank_dot(values, kept))
    store_bank(out, 96, bank_of_zeros(2))


def test_banks():
    weights, state, table = lanes(0), lanes(1, 6), lanes(2, 2).reshape(4, 8)
    out = np.ones(128, np.float32)
    _banks(weights, table, 2, state, out)
    kept = state[16:].reshape(5, 16).astype(np.float64)
    values = table[2, :5, None].astype(np.float64)
    np.testing.assert_allclose(out[:80].reshape(5, 16), weights * values + kept, atol=1e-6)
    np.testing.assert_allclose(out[80:96], (values * kept).sum(0), atol=1e-6)
    assert (out[96:] == 0).all()


@pytest.mark.parametrize("channels", [1, 4, 10, 20])
def test_store_totals(channels):
    @numba.njit
    def sums(state, out):
        store_totals(out, 0, load_bank(state, 0, 6), load_bank(state, 96, channels))

    state = lanes(channels, 6 + channels)
    out = np.ones(32, np.float32)
    sums(state, out)
    used = 6 + channels
    expected = state.reshape(-1, 16).astype(np.float64).sum(1)
    np.testing.assert_allclose(out[:used], expected, atol=1e-5)
    assert (out[used : -(-used // 16) * 16] == 0).all()


def test_next_ticket_counts_up():
    @numba.njit
    def draw(counter):
        return next_ticket(counter), next_ticket(counter)

    counter = np.array([5], np.int64)
    assert draw(counter) == (5, 6)
    assert counter[0] == 7


def test_lowest_bit_and_prefetch():
    @numba.njit
    def lowest(value, table):
        prefetch(table, 1)
        return lowest_bit(value)

    table = np.zeros((2, 4), np.float32)
    assert [lowest(v, table) for v in (1, 8, 1 << 62, -(1 << 63), 12)] == [0, 3, 62, 63, 2]
    assert lowest(0, table) == 64


def test_lane_count_is_one_block():
    assert simd.WIDTH == 16
