"""Blend the Gaussians of each tile front to back, and carry image gradients back to them.

A tile is cut into blocks of 4x4 pixels; a block is one SIMD vector with its own early stop, and a tile's
blocks stay in cache while its Gaussians pass by. Sixteen blocks make a window, a tile is one window or four;
one vector test finds the blocks of a window that a Gaussian may reach. Most values below belong to sixteen
pixels at once. Light left over (transmittance) is kept with a sign: negative once a pixel is finished.

Backward runs front to back as well. What lies behind a splat enters its gradient only through one number a
pixel, the loss-weighted light still to come, which starts as the total and shrinks by each splat's share:
no list of contributors, no division by the light left over. Both directions compute alpha by the same
operations in the same order, so that they always agree on which splats a pixel saw; forward leaves a bit
for each block it changed, and backward looks at no other.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rpaug.render.jit import inlined, kernel
from rpaug.render.splat._pinhole import (
    COLUMN,
    FARTHEST,
    L11,
    L21,
    L22,
    MOMENTS,
    OPACITY,
    ROW,
    half_size,
)
from rpaug.render.splat._simd import (
    WIDTH,
    absolute,
    bank_dot,
    bank_fma,
    bank_of_zeros,
    bits,
    block_columns,
    block_rows,
    broadcast,
    broadcast_bank,
    fma,
    load,
    load_bank,
    lowest_bit,
    maximum,
    minimum,
    negative,
    next_ticket,
    prefetch,
    select,
    store,
    store_bank,
    store_totals,
)
from rpaug.render.splat.settings import Settings

SIDE = 4  # pixels along a block
AHEAD = 8  # entries between asking for a Gaussian's record and reading it
WINDOW_BITS = 4
WINDOW = 1 << WINDOW_BITS  # pixels along a window, whose blocks are the lanes of a vector
ONE, ZERO, HALF = np.float32(1), np.float32(0), np.float32(0.5)

# exp(-x) on [0, ln(255) / 8], exact at 0, relative error 8.4e-8 (minimax, least squares reweighted);
# three squarings take it to [0, ln 255]. tests/render/test_splat_compositing.py holds the error.
E1, E2, E3, E4, E5 = (
    np.float32(value)
    for value in (-0.99999505, 0.49990377, -0.16604707, 0.039882693, -0.0059069996)
)
EIGHTH, LONGEST = np.float32(0.125), np.float32(5.6)


class Rules(NamedTuple):
    """The settings that compositing needs."""

    alpha_max: np.float32
    alpha_floor: np.float32
    stop: np.float32


def rules(settings: Settings) -> Rules:
    """The settings in the precision of the kernels."""
    return Rules(
        np.float32(settings.alpha_max),
        np.float32(settings.alpha_floor),
        np.float32(settings.transmittance_stop),
    )


@inlined
def _vectors(count):
    """Room for `count` vectors that begin on a cache line; numba's own arrays may straddle two."""
    room = np.empty((count + 1) * WIDTH, np.float32)
    skip = -(room.ctypes.data // room.itemsize) % WIDTH
    return room[skip : skip + count * WIDTH]


@inlined
def _exp_minus(s):
    """exp(-s) for s in [0, ln 255]; what is longer comes out too large, but below 1/255."""
    x = minimum(s, LONGEST) * EIGHTH
    p = fma(fma(fma(fma(fma(E5, x, E4), x, E3), x, E2), x, E1), x, ONE)
    p = p * p
    p = p * p
    return p * p


@inlined
def _windows_touched(records, i, left, top, windows):
    """First and last window column, first and last window row of a tile that a Gaussian may reach."""
    x, y = records[i, COLUMN] - np.float32(left), records[i, ROW] - np.float32(top)
    half_width, half_height = half_size(records, i)
    return (  # right shifts round down, also below zero, where // would have to branch
        max(0, math.ceil(x - half_width) >> WINDOW_BITS),
        min(windows - 1, math.floor(x + half_width) >> WINDOW_BITS),
        max(0, math.ceil(y - half_height) >> WINDOW_BITS),
        min(windows - 1, math.floor(y + half_height) >> WINDOW_BITS),
    )


@inlined
def _slopes(records, i):
    """(u, v) of a block's pixels relative to its first pixel."""
    return (
        fma(block_columns(), records[i, L11], block_rows() * records[i, L21]),
        block_rows() * records[i, L22],
    )


@inlined
def _corners(records, i, column, row, slope_u, slope_v):
    """(u, v) of the first pixels of a window's sixteen blocks; the window begins at (column, row)."""
    dx, dy = np.float32(column) - records[i, COLUMN], np.float32(row) - records[i, ROW]
    return (
        fma(slope_u, np.float32(SIDE), records[i, L11] * dx + records[i, L21] * dy),
        fma(slope_v, np.float32(SIDE), records[i, L22] * dy),
    )


@inlined
def _may_reach(records, i, u, v):
    """Bits of the blocks, given their first pixels, in which alpha may come to the floor.

    A block is a parallelogram in whitened coordinates; its bounding box is tested against the circle
    s = farthest. Where they touch the pixels decide.
    """
    half = np.float32(0.5 * (SIDE - 1))
    middle_u, middle_v = half * (records[i, L11] + records[i, L21]), half * records[i, L22]
    half_u = half * (records[i, L11] + abs(records[i, L21]))
    beside = maximum(absolute(u + middle_u) - half_u, ZERO)
    above = maximum(absolute(v + middle_v) - middle_v, ZERO)
    return bits(fma(beside, beside, above * above) <= records[i, FARTHEST])


@inlined
def _blocks_inside(width, height, left, top):
    """Bits of a window's blocks that hold pixels of the image."""
    inside = 0
    for block in range(WIDTH):
        if left + block % SIDE * SIDE < width and top + block // SIDE * SIDE < height:
            inside |= 1 << block
    return inside


@functools.cache
def forward_kernel(channels: int) -> Callable[..., Any]:
    """The compositing kernel for one number of channels."""
    size = WIDTH * (1 + channels)  # a block's state: light left over, then the channels

    def composite(
        ticket, order, records, values, width, height, tile, starts, entries, rules,
        changed, out, left_over, surface,
    ):  # fmt: skip
        """Fill `out` (h, w, channels), `left_over` (h, w) and `surface` (h, w; -1: none) tile by tile.

        Tiles are taken from `order` as tickets come up; several threads may share one `ticket`. `changed` gets
        a bit for each block of the tile that the entry changed. An empty `surface` is left alone.
        """
        tiles_across, windows = (width + tile - 1) // tile, tile // WINDOW
        count = windows * windows * WIDTH
        state = _vectors(count * size // WIDTH)
        crossing = np.empty(count * WIDTH, np.int32)
        alive = np.empty(windows * windows, np.int64)
        corners_u, corners_v = _vectors(1), _vectors(1)
        while True:
            turn = next_ticket(ticket)
            if turn >= len(order):
                return
            number = order[turn]
            left, top = (number % tiles_across) * tile, (number // tiles_across) * tile
            state[:] = ZERO
            crossing[:] = -1
            for block in range(count):
                store(state, block * size, broadcast(ONE))
            unfinished = 0
            for window in range(windows * windows):
                x, y = left + window % windows * WINDOW, top + window // windows * WINDOW
                alive[window] = _blocks_inside(width, height, x, y)
                unfinished += alive[window] != 0
            entry = starts[number]
            while entry < starts[number + 1] and unfinished:
                i = entries[entry]
                ahead = entries[min(entry + AHEAD, starts[number + 1] - 1)]
                prefetch(records, ahead)
                prefetch(values, ahead)
                first_x, last_x, first_y, last_y = _windows_touched(records, i, left, top, windows)
                opacity = records[i, OPACITY]
                slope_u, slope_v = _slopes(records, i)
                touched = 0
                for y in range(first_y, last_y + 1):
                    for x in range(first_x, last_x + 1):
                        window = y * windows + x
                        corner_u, corner_v = _corners(
                            records, i, left + x * WINDOW, top + y * WINDOW, slope_u, slope_v
                        )
                        reach = _may_reach(records, i, corner_u, corner_v)
                        reach &= alive[window]
                        store(corners_u, 0, corner_u)
                        store(corners_v, 0, corner_v)
                        while reach:
                            lane = lowest_bit(reach)
                            reach &= reach - 1
                            block = window * WIDTH + lane
                            at = block * size
                            u, v = slope_u + corners_u[lane], slope_v + corners_v[lane]
                            before = load(state, at)
                            raw = opacity * _exp_minus(fma(u, u, v * v))
                            alpha = minimum(raw, rules.alpha_max)
                            after = before * (ONE - alpha)
                            visible = raw >= rules.alpha_floor
                            drawn = visible & (after > rules.stop)
                            weight = select(drawn, alpha * before, ZERO)
                            rest = select(
                                drawn, after, select(visible, negative(absolute(before)), before)
                            )
                            store(state, at, rest)
                            # Read here and not before: registers are too few to keep them.
                            colours = broadcast_bank(values, i, channels)
                            store_bank(
                                state,
                                at + WIDTH,
                                bank_fma(weight, colours, load_bank(state, at + WIDTH, channels)),
                            )
                            if bits(visible):
                                touched |= 1 << block
                            if len(surface):
                                crossed = bits(drawn & (before > HALF) & (after <= HALF))
                                while crossed:
                                    crossing[block * WIDTH + lowest_bit(crossed)] = i
                                    crossed &= crossed - 1
                            if bits(rest > ZERO) == 0:
                                alive[window] &= ~(1 << lane)
                                unfinished -= alive[window] == 0
                changed[entry] = touched
                entry += 1
            changed[entry : starts[number + 1]] = 0
            for row in range(top, min(top + tile, height)):
                for column in range(left, min(left + tile, width)):
                    block, lane = _place(column - left, row - top, windows)
                    at = block * size + lane
                    left_over[row, column] = abs(state[at])
                    for channel in range(channels):
                        out[row, column, channel] = state[at + WIDTH * (1 + channel)]
                    if len(surface):
                        surface[row, column] = crossing[block * WIDTH + lane]

    return kernel(composite)


@inlined
def _place(x, y, windows):
    """Block and lane of the pixel (x, y) of a tile."""
    window = y // WINDOW * windows + x // WINDOW
    block = y % WINDOW // SIDE * SIDE + x % WINDOW // SIDE
    return window * WIDTH + block, y % SIDE * SIDE + x % SIDE


@functools.cache
def backward_kernel(channels: int) -> Callable[..., Any]:
    """The kernel that fills gradient slots, for one number of channels."""
    size = WIDTH * (
        2 + channels
    )  # a block's state: light left over, light to come, channels' gradients
    stride = WIDTH * ((MOMENTS + channels + WIDTH - 1) // WIDTH)

    def composite_backward(
        ticket, order, records, values, width, height, tile, starts, entries, rules, changed,
        slot_of, out, left_over, d_out, d_left_over, slots,
    ):  # fmt: skip
        """Fill each entry's slot with six moments of ds over (u, v), then the channels' gradients."""
        tiles_across, windows = (width + tile - 1) // tile, tile // WINDOW
        count = windows * windows * WIDTH
        state = _vectors(count * size // WIDTH)
        corners_u, corners_v = _vectors(1), _vectors(1)
        while True:
            turn = next_ticket(ticket)
            if turn >= len(order):
                return
            number = order[turn]
            left, top = (number % tiles_across) * tile, (number // tiles_across) * tile
            state[:] = ZERO
            for block in range(count):
                store(state, block * size, broadcast(ONE))
            for row in range(top, min(top + tile, height)):
                for column in range(left, min(left + tile, width)):
                    block, lane = _place(column - left, row - top, windows)
                    at = block * size + lane
                    to_come = d_left_over[row, column] * left_over[row, column]
                    for channel in range(channels):
                        pull = d_out[row, column, channel]
                        state[at + WIDTH * (2 + channel)] = pull
                        to_come += pull * out[row, column, channel]
                    state[at + WIDTH] = to_come
            for entry in range(starts[number], starts[number + 1]):
                i, touched = entries[entry], changed[entry]
                ahead = entries[min(entry + AHEAD, starts[number + 1] - 1)]
                prefetch(records, ahead)
                prefetch(values, ahead)
                opacity = records[i, OPACITY]
                slope_u, slope_v = _slopes(records, i)
                m = mu = mv = muu = muv = mvv = broadcast(ZERO)
                d_colours = bank_of_zeros(channels)
                for window in range(windows * windows):
                    inside = (touched >> (window * WIDTH)) & 0xFFFF
                    if inside == 0:
                        continue
                    x = left + (window & (windows - 1)) * WINDOW
                    y = top + (window >> (windows - 1)) * WINDOW
                    corner_u, corner_v = _corners(records, i, x, y, slope_u, slope_v)
                    store(corners_u, 0, corner_u)
                    store(corners_v, 0, corner_v)
                    while inside:
                        lane = lowest_bit(inside)
                        inside &= inside - 1
                        at = (window * WIDTH + lane) * size
                        u, v = slope_u + corners_u[lane], slope_v + corners_v[lane]
                        before = load(state, at)
                        raw = opacity * _exp_minus(fma(u, u, v * v))
                        alpha = minimum(raw, rules.alpha_max)
                        after = before * (ONE - alpha)
                        visible = raw >= rules.alpha_floor
                        drawn = visible & (after > rules.stop)
                        weight = select(drawn, alpha * before, ZERO)
                        rest = select(
                            drawn, after, select(visible, negative(absolute(before)), before)
                        )
                        store(state, at, rest)
                        pulls = load_bank(state, at + 2 * WIDTH, channels)
                        pull = bank_dot(pulls, broadcast_bank(values, i, channels))
                        d_colours = bank_fma(weight, pulls, d_colours)
                        behind = load(state, at + WIDTH) - weight * pull
                        store(state, at + WIDTH, behind)
                        d_alpha = before * pull - behind / (ONE - alpha)
                        # d alpha = -alpha ds, except where alpha is held at its greatest value.
                        ds = select(
                            drawn & (raw < rules.alpha_max), negative(alpha) * d_alpha, ZERO
                        )
                        ds_u, ds_v = ds * u, ds * v
                        m, mu, mv = m + ds, mu + ds_u, mv + ds_v
                        muu, muv, mvv = fma(ds_u, u, muu), fma(ds_u, v, muv), fma(ds_v, v, mvv)
                store_totals(slots, slot_of[entry] * stride, (m, mu, mv, muu, muv, mvv), d_colours)

    return kernel(composite_backward)
