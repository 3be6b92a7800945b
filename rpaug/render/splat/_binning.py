"""Which Gaussians each tile must look at, front to back.

Entries of a tile are ordered by depth, equal depths by index, whatever order or number of threads made them.
Each entry also has a slot: slots are numbered Gaussian by Gaussian, so that the gradients of one lie together.
"""

import math

import numpy as np

from rpaug.render.jit import inlined, kernel
from rpaug.render.splat._projection import COLUMN, HALF_WIDTH, ROW, half_size

RADIX = 11  # bits a pass: three passes sort 32-bit keys


@inlined
def _tiles_touched(records, i, width, height, tile):
    """First and last tile column, first and last tile row; the last lies before the first if there is none."""
    if not records[i, HALF_WIDTH] >= 0.0:
        return 0, -1, 0, -1
    half_width, half_height = half_size(records, i)
    left = max(math.ceil(records[i, COLUMN] - half_width), 0)
    right = min(math.floor(records[i, COLUMN] + half_width), width - 1)
    top = max(math.ceil(records[i, ROW] - half_height), 0)
    bottom = min(math.floor(records[i, ROW] + half_height), height - 1)
    if left > right or top > bottom:
        return 0, -1, 0, -1
    return left // tile, right // tile, top // tile, bottom // tile


@kernel
def count_entries(records, width, height, tile, first_slot, starts):
    """Number the slots of each Gaussian and the entries of each tile; returns how many Gaussians are seen."""
    across = (width + tile - 1) // tile
    starts[:] = 0
    total = seen = 0
    for i in range(len(records)):
        first_slot[i] = total
        left, right, top, bottom = _tiles_touched(records, i, width, height, tile)
        if right < left:
            continue
        seen += 1
        total += (right - left + 1) * (bottom - top + 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                starts[row * across + column + 1] += 1
    first_slot[len(records)] = total
    for number in range(1, len(starts)):
        starts[number] += starts[number - 1]
    return seen


@kernel
def sort_by_depth(first_slot, depths, keys, spare):
    """Indices of the Gaussians that are seen, nearest first: the low halves of the returned keys.

    A stable radix sort on the bits of a positive float32, which order as the numbers do.
    """
    mask = (1 << RADIX) - 1
    histogram = np.zeros((3, mask + 1), np.int64)
    seen = 0
    for i in range(len(depths)):
        if first_slot[i + 1] > first_slot[i]:
            depth = np.uint64(depths[i])
            keys[seen] = (depth << np.uint64(32)) | np.uint64(i)
            seen += 1
            for turn in range(3):
                histogram[turn, (depth >> np.uint64(RADIX * turn)) & np.uint64(mask)] += 1
    for turn in range(3):
        shift = np.uint64(32 + RADIX * turn)
        place = histogram[turn]
        at = 0
        for digit in range(mask + 1):
            at, place[digit] = at + place[digit], at
        for k in range(seen):
            digit = (keys[k] >> shift) & np.uint64(mask)
            spare[place[digit]] = keys[k]
            place[digit] += 1
        keys, spare = spare, keys
    return keys[:seen]


@kernel
def fill_entries(ordered, records, width, height, tile, first_slot, starts, entries, slots):
    """Deal the Gaussians, nearest first, to the tiles they touch."""
    across = (width + tile - 1) // tile
    cursor = starts.copy()
    for key in ordered:
        i = np.int64(key & np.uint64(0xFFFFFFFF))
        left, right, top, bottom = _tiles_touched(records, i, width, height, tile)
        slot = first_slot[i]
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                at = cursor[row * across + column]
                cursor[row * across + column] = at + 1
                entries[at] = i
                slots[at] = slot
                slot += 1
