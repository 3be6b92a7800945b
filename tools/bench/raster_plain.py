"""Compositing as one would write it first in numba: scalar, one Gaussian after the other. The gate's baseline.

Same bounds, same early stop a tile, same rules; no vectors but those LLVM finds by itself.
"""

import math

import numba
import numpy as np

EVERY = {"nogil": True, "fastmath": True, "error_model": "numpy", "cache": True}


@numba.njit(**EVERY)
def _box(records, i, left, top, right, bottom):
    """First and last column, first and last row of a Gaussian in a tile."""
    x, y, wide, high = records[i, 0], records[i, 1], records[i, 6], records[i, 7]
    return (
        max(left, math.ceil(x - wide)),
        min(right, math.floor(x + wide)),
        max(top, math.ceil(y - high)),
        min(bottom, math.floor(y + high)),
    )


@numba.njit(**EVERY)
def forward(
    part, parts, records, values, width, height, tile, starts, entries, rules, out, left_over
):
    """Fill `out` and `left_over` for the tiles part, part + parts, ..."""
    channels, across = values.shape[1], (width + tile - 1) // tile
    for number in range(part, len(starts) - 1, parts):
        left, top = number % across * tile, number // across * tile
        right, bottom = min(left + tile, width) - 1, min(top + tile, height) - 1
        out[top : bottom + 1, left : right + 1] = 0
        left_over[top : bottom + 1, left : right + 1] = 1
        unfinished = (right - left + 1) * (bottom - top + 1)
        for entry in range(starts[number], starts[number + 1]):
            i = entries[entry]
            x0, x1, y0, y1 = _box(records, i, left, top, right, bottom)
            for row in range(y0, y1 + 1):
                for column in range(x0, x1 + 1):
                    light = left_over[row, column]
                    dx, dy = column - records[i, 0], row - records[i, 1]
                    u, v = records[i, 2] * dx + records[i, 3] * dy, records[i, 4] * dy
                    alpha = min(records[i, 5] * math.exp(-(u * u + v * v)), rules[0])
                    if light < 0 or alpha < rules[1]:
                        continue
                    after = light * (1 - alpha)
                    if after <= rules[2]:
                        left_over[row, column] = -light  # finished
                        unfinished -= 1
                        continue
                    for channel in range(channels):
                        out[row, column, channel] += alpha * light * values[i, channel]
                    left_over[row, column] = after
            if unfinished == 0:
                break
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                left_over[row, column] = abs(left_over[row, column])


@numba.njit(**EVERY)
def backward(
    part, parts, records, values, width, height, tile, starts, entries, rules, slot_of,
    out, left_over, d_out, d_left_over, slots,
):  # fmt: skip
    """Fill the slots of the tiles part, part + parts, ..."""
    channels, across = values.shape[1], (width + tile - 1) // tile
    state, rest = np.empty((tile, tile), np.float32), np.empty((tile, tile), np.float32)
    for number in range(part, len(starts) - 1, parts):
        left, top = number % across * tile, number // across * tile
        right, bottom = min(left + tile, width) - 1, min(top + tile, height) - 1
        state[:] = 1
        unfinished = (right - left + 1) * (bottom - top + 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                to_come = d_left_over[row, column] * left_over[row, column]
                for channel in range(channels):
                    to_come += d_out[row, column, channel] * out[row, column, channel]
                rest[row - top, column - left] = to_come
        for entry in range(starts[number], starts[number + 1]):
            i, slot = entries[entry], slots[slot_of[entry]]
            slot[:] = 0
            if unfinished == 0:
                continue
            x0, x1, y0, y1 = _box(records, i, left, top, right, bottom)
            for row in range(y0, y1 + 1):
                for column in range(x0, x1 + 1):
                    light = state[row - top, column - left]
                    dx, dy = column - records[i, 0], row - records[i, 1]
                    u, v = records[i, 2] * dx + records[i, 3] * dy, records[i, 4] * dy
                    raw = records[i, 5] * math.exp(-(u * u + v * v))
                    alpha = min(raw, rules[0])
                    if light < 0 or alpha < rules[1]:
                        continue
                    after = light * (1 - alpha)
                    if after <= rules[2]:
                        state[row - top, column - left] = -light
                        unfinished -= 1
                        continue
                    pull = np.float32(0)
                    for channel in range(channels):
                        pull += d_out[row, column, channel] * values[i, channel]
                        slot[6 + channel] += alpha * light * d_out[row, column, channel]
                    behind = rest[row - top, column - left] - alpha * light * pull
                    rest[row - top, column - left] = behind
                    if raw < rules[0]:
                        ds = -alpha * (light * pull - behind / (1 - alpha))
                        slot[0] += ds
                        slot[1] += ds * u
                        slot[2] += ds * v
                        slot[3] += ds * u * u
                        slot[4] += ds * u * v
                        slot[5] += ds * v * v
                    state[row - top, column - left] = after
