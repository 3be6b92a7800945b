"""Blend the Gaussians of each tile front to back, and carry image gradients back to them.

A tile is cut into blocks of 4x4 pixels; a block is one SIMD vector with its own early stop, and a tile's
blocks stay in cache while its Gaussians pass by. Sixteen blocks make a window, a tile is one window or four;
one vector test finds the blocks of a window that a Gaussian may reach. Most values below belong to sixteen
pixels at once. Light left over (transmittance) is kept with a sign: negative once a pixel is finished.

Both directions blend by the same operations in the same order, so that they always agree on which splats a pixel saw;
forward leaves a bit for each block it changed, and backward looks at no other.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rpaug.core.jit import inlined, kernel
from rpaug.render.splat._banks import bank_fma, broadcast_bank, load_bank, store_bank
from rpaug.render.splat._pinhole import (
    COLUMN,
    FARTHEST,
    L11,
    L21,
    L22,
    OPACITY,
    ROW,
    half_size,
)
from rpaug.render.splat._simd import (
    WIDTH,
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
def vectors(count):
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
def blend(u, v, opacity, before, rules):
    """What a splat does to a block: raw and held alpha, where it is visible and drawn, its weight, and the
    light left over after it.
    """
    raw = opacity * _exp_minus(fma(u, u, v * v))
    alpha = minimum(raw, rules.alpha_max)
    after = before * (ONE - alpha)
    visible = raw >= rules.alpha_floor
    drawn = visible & (after > rules.stop)
    weight = select(drawn, alpha * before, ZERO)
    rest = select(drawn, after, select(visible, negative(absolute(before)), before))
    return raw, alpha, visible, drawn, weight, rest


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
def slopes(records, i):
    """(u, v) of a block's pixels relative to its first pixel."""
    return (
        fma(block_columns(), records[i, L11], block_rows() * records[i, L21]),
        block_rows() * records[i, L22],
    )


@inlined
def corners(records, i, column, row, slope_u, slope_v):
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
# Long: one kernel is one function: its loop over tiles and blocks is compiled as a whole.
def forward_kernel(channels: int) -> Callable[..., Any]:
    """The compositing kernel for one number of channels."""
    size = WIDTH * (1 + channels)  # a block's state: light left over, then the channels

    # Long: see above.
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
        state = vectors(count * size // WIDTH)
        crossing = np.empty(count * WIDTH, np.int32)
        alive = np.empty(windows * windows, np.int64)
        corners_u, corners_v = vectors(1), vectors(1)
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
                slope_u, slope_v = slopes(records, i)
                touched = 0
                for y in range(first_y, last_y + 1):
                    for x in range(first_x, last_x + 1):
                        window = y * windows + x
                        corner_u, corner_v = corners(
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
                            _, _, visible, drawn, weight, rest = blend(u, v, opacity, before, rules)
                            store(state, at, rest)
                            # Read here and not before: registers are too few to keep them.
                            colors = broadcast_bank(values, i, channels)
                            store_bank(
                                state,
                                at + WIDTH,
                                bank_fma(weight, colors, load_bank(state, at + WIDTH, channels)),
                            )
                            if bits(visible):
                                touched |= 1 << block
                            if len(surface):
                                crossed = bits(drawn & (before > HALF) & (rest <= HALF))
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
                    block, lane = place(column - left, row - top, windows)
                    at = block * size + lane
                    left_over[row, column] = abs(state[at])
                    for channel in range(channels):
                        out[row, column, channel] = state[at + WIDTH * (1 + channel)]
                    if len(surface):
                        surface[row, column] = crossing[block * WIDTH + lane]

    return kernel(composite)


@inlined
def place(x, y, windows):
    """Block and lane of the pixel (x, y) of a tile."""
    window = y // WINDOW * windows + x // WINDOW
    block = y % WINDOW // SIDE * SIDE + x % WINDOW // SIDE
    return window * WIDTH + block, y % SIDE * SIDE + x % SIDE
