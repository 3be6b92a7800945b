"""Carry image gradients back to the Gaussians of each tile.

This runs front to back as well. What lies behind a splat enters its gradient only through one number a
pixel, the loss-weighted light still to come, which starts as the total and shrinks by each splat's share:
no list of contributors, no division by the light left over.
"""

import functools
from collections.abc import Callable
from typing import Any

from rpaug.core.jit import kernel
from rpaug.render.splat._banks import (
    bank_dot,
    bank_fma,
    bank_of_zeros,
    broadcast_bank,
    load_bank,
    store_totals,
)
from rpaug.render.splat._compositing import (
    AHEAD,
    ONE,
    WINDOW,
    ZERO,
    blend,
    corners,
    place,
    slopes,
    vectors,
)
from rpaug.render.splat._pinhole import MOMENTS, OPACITY
from rpaug.render.splat._simd import (
    WIDTH,
    broadcast,
    fma,
    load,
    lowest_bit,
    negative,
    next_ticket,
    prefetch,
    select,
    store,
)


@functools.cache
# Long: one kernel is one function: its loop over tiles and blocks is compiled as a whole.
def backward_kernel(channels: int) -> Callable[..., Any]:
    """The kernel that fills gradient slots, for one number of channels."""
    size = WIDTH * (
        2 + channels
    )  # a block's state: light left over, light to come, channels' gradients
    stride = WIDTH * ((MOMENTS + channels + WIDTH - 1) // WIDTH)

    # Long: see above.
    def composite_backward(
        ticket, order, records, values, width, height, tile, starts, entries, rules, changed,
        slot_of, out, left_over, d_out, d_left_over, slots,
    ):  # fmt: skip
        """Fill each entry's slot with six moments of ds over (u, v), then the channels' gradients."""
        tiles_across, windows = (width + tile - 1) // tile, tile // WINDOW
        count = windows * windows * WIDTH
        state = vectors(count * size // WIDTH)
        corners_u, corners_v = vectors(1), vectors(1)
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
                    block, lane = place(column - left, row - top, windows)
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
                slope_u, slope_v = slopes(records, i)
                m = mu = mv = muu = muv = mvv = broadcast(ZERO)
                d_colors = bank_of_zeros(channels)
                for window in range(windows * windows):
                    inside = (touched >> (window * WIDTH)) & 0xFFFF
                    if inside == 0:
                        continue
                    x = left + (window & (windows - 1)) * WINDOW
                    y = top + (window >> (windows - 1)) * WINDOW
                    corner_u, corner_v = corners(records, i, x, y, slope_u, slope_v)
                    store(corners_u, 0, corner_u)
                    store(corners_v, 0, corner_v)
                    while inside:
                        lane = lowest_bit(inside)
                        inside &= inside - 1
                        at = (window * WIDTH + lane) * size
                        u, v = slope_u + corners_u[lane], slope_v + corners_v[lane]
                        before = load(state, at)
                        raw, alpha, _, drawn, weight, rest = blend(u, v, opacity, before, rules)
                        store(state, at, rest)
                        pulls = load_bank(state, at + 2 * WIDTH, channels)
                        pull = bank_dot(pulls, broadcast_bank(values, i, channels))
                        d_colors = bank_fma(weight, pulls, d_colors)
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
                store_totals(slots, slot_of[entry] * stride, (m, mu, mv, muu, muv, mvv), d_colors)

    return kernel(composite_backward)
