"""Blend the Gaussians of each tile front to back, and carry image gradients back to them.

A tile is cut into blocks of 4x4 pixels; a block is one SIMD vector with its own early stop, and a tile's
blocks stay in cache while its Gaussians pass by. Every value below belongs to sixteen pixels at once.
Light left over (transmittance) is kept with a sign: negative once a pixel is finished.

Backward runs front to back as well. What lies behind a splat enters its gradient only through one number a
pixel, the loss-weighted light still to come, which starts as the total and shrinks by each splat's share:
no list of contributors, no division by the light left over. Both directions compute alpha by the same
operations in the same order, so that they always agree on which splats a pixel saw.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rpaug.render.jit import inlined, kernel
from rpaug.render.splat._projection import (
    COLUMN,
    HALF_HEIGHT,
    HALF_WIDTH,
    L11,
    L21,
    L22,
    MOMENTS,
    OPACITY,
    ROW,
)
from rpaug.render.splat._simd import (
    WIDTH,
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
    minimum,
    negative,
    next_ticket,
    select,
    store,
    store_bank,
    store_totals,
)
from rpaug.render.splat.settings import Settings

SIDE = 4  # pixels along a block
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
def _exp_minus(s):
    """exp(-s) for s in [0, ln 255]; what is longer comes out too large, but below 1/255."""
    x = minimum(s, LONGEST) * EIGHTH
    p = fma(fma(fma(fma(fma(E5, x, E4), x, E3), x, E2), x, E1), x, ONE)
    p = p * p
    p = p * p
    return p * p


@inlined
def _blocks_touched(records, i, left, top, across, down):
    """First and last block column, first and last block row of a tile that a Gaussian may reach."""
    x, y = records[i, COLUMN] - np.float32(left), records[i, ROW] - np.float32(top)
    half_width, half_height = records[i, HALF_WIDTH], records[i, HALF_HEIGHT]
    return (
        max(0, math.ceil(x - half_width)) // SIDE,
        min(across - 1, math.floor(x + half_width) // SIDE),
        max(0, math.ceil(y - half_height)) // SIDE,
        min(down - 1, math.floor(y + half_height) // SIDE),
    )


@inlined
def _whitened(records, i, column, row):
    """(u, v) of the pixel at (column, row), in the whitened coordinates of Gaussian i."""
    dx, dy = np.float32(column) - records[i, COLUMN], np.float32(row) - records[i, ROW]
    return records[i, L11] * dx + records[i, L21] * dy, records[i, L22] * dy


@functools.cache
def forward_kernel(channels: int) -> Callable[..., Any]:
    """The compositing kernel for one number of channels."""
    size = WIDTH * (1 + channels)  # a block's state: light left over, then the channels

    def composite(
        ticket, order, records, values, width, height, tile, starts, entries, rules, out, left_over, surface
    ):  # fmt: skip
        """Fill `out` (h, w, channels), `left_over` (h, w) and `surface` (h, w; -1: none) tile by tile.

        Tiles are taken from `order` as tickets come up; several threads may share one `ticket`. An empty
        `surface` is left alone.
        """
        tiles_across, most = (width + tile - 1) // tile, tile // SIDE
        state = np.empty(most * most * size, np.float32)
        finished = np.empty(most * most, np.bool_)
        crossing = np.empty(most * most * WIDTH, np.int32)
        while True:
            turn = next_ticket(ticket)
            if turn >= len(order):
                return
            number = order[turn]
            left, top = (number % tiles_across) * tile, (number // tiles_across) * tile
            across = min(most, (width - left + SIDE - 1) // SIDE)
            down = min(most, (height - top + SIDE - 1) // SIDE)
            state[:] = ZERO
            finished[:] = False
            crossing[:] = -1
            for block in range(most * most):
                store(state, block * size, broadcast(ONE))
            unfinished = across * down
            for entry in range(starts[number], starts[number + 1]):
                i = entries[entry]
                first_x, last_x, first_y, last_y = _blocks_touched(
                    records, i, left, top, across, down
                )
                opacity = records[i, OPACITY]
                farthest = np.float32(math.log(opacity / rules.alpha_floor) + 1e-5)
                slope_u = fma(block_columns(), records[i, L11], block_rows() * records[i, L21])
                slope_v = block_rows() * records[i, L22]
                colours = broadcast_bank(values, i, channels)
                for y in range(first_y, last_y + 1):
                    for x in range(first_x, last_x + 1):
                        block = y * most + x
                        if finished[block]:
                            continue
                        u0, v0 = _whitened(records, i, left + SIDE * x, top + SIDE * y)
                        u, v = slope_u + u0, slope_v + v0
                        s = fma(u, u, v * v)
                        near = s <= farthest
                        if bits(near) == 0:
                            continue
                        at = block * size
                        before = load(state, at)
                        raw = opacity * _exp_minus(s)
                        alpha = minimum(raw, rules.alpha_max)
                        after = before * (ONE - alpha)
                        open_ = near & (raw >= rules.alpha_floor) & (before > ZERO)
                        drawn = open_ & (after > rules.stop)
                        weight = select(drawn, alpha * before, ZERO)
                        rest = select(drawn, after, select(open_, negative(before), before))
                        store(state, at, rest)
                        store_bank(
                            state,
                            at + WIDTH,
                            bank_fma(weight, colours, load_bank(state, at + WIDTH, channels)),
                        )
                        if len(surface):
                            crossed = bits(drawn & (before > HALF) & (after <= HALF))
                            for lane in range(WIDTH):
                                if crossed >> lane & 1:
                                    crossing[block * WIDTH + lane] = i
                        if bits(rest > ZERO) == 0:
                            finished[block] = True
                            unfinished -= 1
                if unfinished == 0:
                    break
            for row in range(top, min(top + tile, height)):
                for column in range(left, min(left + tile, width)):
                    block = (row - top) // SIDE * most + (column - left) // SIDE
                    lane = (row - top) % SIDE * SIDE + (column - left) % SIDE
                    at = block * size + lane
                    left_over[row, column] = abs(state[at])
                    for channel in range(channels):
                        out[row, column, channel] = state[at + WIDTH * (1 + channel)]
                    if len(surface):
                        surface[row, column] = crossing[block * WIDTH + lane]

    return kernel(composite)


@functools.cache
def backward_kernel(channels: int) -> Callable[..., Any]:
    """The kernel that fills gradient slots, for one number of channels."""
    size = WIDTH * (
        2 + channels
    )  # a block's state: light left over, light to come, the channels' gradients
    stride = WIDTH * ((MOMENTS + channels + WIDTH - 1) // WIDTH)

    def composite_backward(
        ticket, order, records, values, width, height, tile, starts, entries, rules, slot_of,
        out, left_over, d_out, d_left_over, slots,
    ):  # fmt: skip
        """Fill each entry's slot with six moments of ds over (u, v), then the channels' gradients."""
        tiles_across, most = (width + tile - 1) // tile, tile // SIDE
        state = np.empty(most * most * size, np.float32)
        finished = np.empty(most * most, np.bool_)
        while True:
            turn = next_ticket(ticket)
            if turn >= len(order):
                return
            number = order[turn]
            left, top = (number % tiles_across) * tile, (number // tiles_across) * tile
            across = min(most, (width - left + SIDE - 1) // SIDE)
            down = min(most, (height - top + SIDE - 1) // SIDE)
            state[:] = ZERO
            finished[:] = False
            for row in range(top, min(top + tile, height)):
                for column in range(left, min(left + tile, width)):
                    block = (row - top) // SIDE * most + (column - left) // SIDE
                    at = block * size + (row - top) % SIDE * SIDE + (column - left) % SIDE
                    to_come = d_left_over[row, column] * left_over[row, column]
                    for channel in range(channels):
                        pull = d_out[row, column, channel]
                        state[at + WIDTH * (2 + channel)] = pull
                        to_come += pull * out[row, column, channel]
                    state[at + WIDTH] = to_come
            for block in range(most * most):
                store(state, block * size, broadcast(ONE))
            unfinished = across * down
            for entry in range(starts[number], starts[number + 1]):
                m = mu = mv = muu = muv = mvv = broadcast(ZERO)
                d_colours = bank_of_zeros(channels)
                if unfinished > 0:
                    i = entries[entry]
                    first_x, last_x, first_y, last_y = _blocks_touched(
                        records, i, left, top, across, down
                    )
                    opacity = records[i, OPACITY]
                    farthest = np.float32(math.log(opacity / rules.alpha_floor) + 1e-5)
                    slope_u = fma(block_columns(), records[i, L11], block_rows() * records[i, L21])
                    slope_v = block_rows() * records[i, L22]
                    colours = broadcast_bank(values, i, channels)
                    for y in range(first_y, last_y + 1):
                        for x in range(first_x, last_x + 1):
                            block = y * most + x
                            if finished[block]:
                                continue
                            u0, v0 = _whitened(records, i, left + SIDE * x, top + SIDE * y)
                            u, v = slope_u + u0, slope_v + v0
                            s = fma(u, u, v * v)
                            near = s <= farthest
                            if bits(near) == 0:
                                continue
                            at = block * size
                            before = load(state, at)
                            raw = opacity * _exp_minus(s)
                            alpha = minimum(raw, rules.alpha_max)
                            after = before * (ONE - alpha)
                            open_ = near & (raw >= rules.alpha_floor) & (before > ZERO)
                            drawn = open_ & (after > rules.stop)
                            weight = select(drawn, alpha * before, ZERO)
                            rest = select(drawn, after, select(open_, negative(before), before))
                            store(state, at, rest)
                            if bits(rest > ZERO) == 0:
                                finished[block] = True
                                unfinished -= 1
                            pulls = load_bank(state, at + 2 * WIDTH, channels)
                            pull = bank_dot(pulls, colours)
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
