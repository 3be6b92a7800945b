"""Compositing as one would write it first in numba: pixel by pixel, scalar. The gate's baseline."""

import math

import numba
import numpy as np

EVERY = {"nogil": True, "fastmath": True, "error_model": "numpy", "cache": True}


@numba.njit(**EVERY)
def forward(
    part, parts, records, values, width, height, tile, starts, entries, rules, out, left_over
):
    """Fill `out` and `left_over` for the tiles part, part + parts, ..."""
    channels, across = values.shape[1], (width + tile - 1) // tile
    for number in range(part, len(starts) - 1, parts):
        left, top = number % across * tile, number // across * tile
        for row in range(top, min(top + tile, height)):
            for column in range(left, min(left + tile, width)):
                light = np.float32(1)
                out[row, column] = 0
                for entry in range(starts[number], starts[number + 1]):
                    i = entries[entry]
                    dx, dy = column - records[i, 0], row - records[i, 1]
                    u, v = records[i, 2] * dx + records[i, 3] * dy, records[i, 4] * dy
                    alpha = min(records[i, 5] * math.exp(-(u * u + v * v)), rules[0])
                    if alpha < rules[1]:
                        continue
                    after = light * (1 - alpha)
                    if after <= rules[2]:
                        break
                    for channel in range(channels):
                        out[row, column, channel] += alpha * light * values[i, channel]
                    light = after
                left_over[row, column] = light


@numba.njit(**EVERY)
def backward(
    part, parts, records, values, width, height, tile, starts, entries, rules, slot_of,
    out, left_over, d_out, d_left_over, slots,
):  # fmt: skip
    """Add up the slots of the tiles part, part + parts, ..., which must be zero before."""
    channels, across = values.shape[1], (width + tile - 1) // tile
    for number in range(part, len(starts) - 1, parts):
        left, top = number % across * tile, number // across * tile
        for row in range(top, min(top + tile, height)):
            for column in range(left, min(left + tile, width)):
                light = np.float32(1)
                to_come = d_left_over[row, column] * left_over[row, column]
                for channel in range(channels):
                    to_come += d_out[row, column, channel] * out[row, column, channel]
                for entry in range(starts[number], starts[number + 1]):
                    i = entries[entry]
                    dx, dy = column - records[i, 0], row - records[i, 1]
                    u, v = records[i, 2] * dx + records[i, 3] * dy, records[i, 4] * dy
                    raw = records[i, 5] * math.exp(-(u * u + v * v))
                    alpha = min(raw, rules[0])
                    if alpha < rules[1]:
                        continue
                    after = light * (1 - alpha)
                    if after <= rules[2]:
                        break
                    slot, pull = slots[slot_of[entry]], np.float32(0)
                    for channel in range(channels):
                        pull += d_out[row, column, channel] * values[i, channel]
                        slot[6 + channel] += alpha * light * d_out[row, column, channel]
                    to_come -= alpha * light * pull
                    if raw < rules[0]:
                        ds = -alpha * (light * pull - to_come / (1 - alpha))
                        slot[0] += ds
                        slot[1] += ds * u
                        slot[2] += ds * v
                        slot[3] += ds * u * u
                        slot[4] += ds * u * v
                        slot[5] += ds * v * v
                    light = after
