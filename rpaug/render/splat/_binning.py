"""Which Gaussians each tile must look at, front to back.

Entries of a tile are ordered by depth, equal depths by index, whatever number of threads made them. Each
entry also has a slot: slots are numbered Gaussian by Gaussian, so that the gradients of one lie together.

The Gaussians are cut into parts. Each part counts its entries in every tile, then writes them to places of
its own; then each tile is sorted by itself, in cache.
"""

import math

import numpy as np

from rpaug.core.jit import inlined, kernel
from rpaug.render.splat._pinhole import COLUMN, HALF_WIDTH, ROW, half_size
from rpaug.render.splat._simd import next_ticket

SHORT = 24  # entries: up to here insertion sort is the fastest
DIGIT = 8  # bits a pass of the radix sort
LEFT, RIGHT, TOP, BOTTOM = range(
    4
)  # columns of `spans`: first and last tile column, first and last row


@inlined
def _tiles_touched(records, i, width, height, shift, margin, spans):
    """Write a Gaussian's span of tiles; the last column lies before the first if it touches none."""
    spans[i, LEFT], spans[i, RIGHT] = 0, -1
    if not records[i, HALF_WIDTH] >= 0.0:
        return
    half_width, half_height = half_size(records, i)
    half_width, half_height = half_width + margin, half_height + margin
    column, row = records[i, COLUMN], records[i, ROW]
    # Compared as floats first: a huge splat's bounds would not fit the integers.
    if column + half_width < 0 or column - half_width > width - 1:
        return
    if row + half_height < 0 or row - half_height > height - 1:
        return
    left = math.ceil(max(column - half_width, np.float32(0)))
    right = math.floor(min(column + half_width, np.float32(width - 1)))
    top = math.ceil(max(row - half_height, np.float32(0)))
    bottom = math.floor(min(row + half_height, np.float32(height - 1)))
    if left <= right and top <= bottom:
        spans[i, LEFT], spans[i, RIGHT] = left >> shift, right >> shift
        spans[i, TOP], spans[i, BOTTOM] = top >> shift, bottom >> shift


@kernel
def count_entries(start, stop, records, width, height, shift, margin, spans, counts):
    """Fill `spans` of Gaussians start..stop and add their entries to `counts`, one number a tile.

    A tile is 2**shift pixels wide; `margin` (float32, pixels) widens every Gaussian. Returns the number of entries.
    """
    across = ((width - 1) >> shift) + 1
    counts[:] = 0
    total = 0
    for i in range(start, stop):
        _tiles_touched(records, i, width, height, shift, margin, spans)
        if spans[i, RIGHT] < 0:
            continue
        left, right = int(spans[i, LEFT]), int(spans[i, RIGHT])
        top, bottom = int(spans[i, TOP]), int(spans[i, BOTTOM])
        total += (right - left + 1) * (bottom - top + 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                counts[row * across + column] += 1
    return total


@kernel
def lay_out(counts, starts):
    """Turn counts (parts, tiles) into the place where each part's entries of a tile begin."""
    at = 0
    for tile in range(counts.shape[1]):
        starts[tile] = at
        for part in range(counts.shape[0]):
            counts[part, tile], at = at, at + counts[part, tile]
    starts[counts.shape[1]] = at


@kernel
def place_entries(
    start, stop, slot, spans, depths, across, cursors, first_slot, keys, indices, slots
):  # fmt: skip
    """Write the entries of Gaussians start..stop to their tiles, in order; `slot` is the first one's slot.

    A key holds the depth's bits, which order as positive floats do, above the entry's own place.
    """
    for i in range(start, stop):
        first_slot[i] = slot
        if spans[i, RIGHT] < 0:
            continue
        depth = np.uint64(depths[i]) << np.uint64(32)
        for row in range(int(spans[i, TOP]), int(spans[i, BOTTOM]) + 1):
            for column in range(int(spans[i, LEFT]), int(spans[i, RIGHT]) + 1):
                tile = row * across + column
                at = cursors[tile]
                cursors[tile] = at + 1
                keys[at] = depth | np.uint64(at)
                indices[at] = i
                slots[at] = slot
                slot += 1
    first_slot[stop] = slot


@inlined
def _insertion_sort(keys):
    for k in range(1, len(keys)):
        key, at = keys[k], k
        while at > 0 and keys[at - 1] > key:
            keys[at] = keys[at - 1]
            at -= 1
        keys[at] = key


@inlined
def _radix_sort(keys, spare, histogram):
    """Sort by the upper halves, stably; returns whichever of the two arrays holds the result."""
    size = 1 << DIGIT
    histogram[:] = 0
    for key in keys:
        for turn in range(histogram.shape[0]):
            histogram[turn, (key >> np.uint64(32 + DIGIT * turn)) & np.uint64(size - 1)] += 1
    for turn in range(histogram.shape[0]):
        shift, place = np.uint64(32 + DIGIT * turn), histogram[turn]
        if place[(keys[0] >> shift) & np.uint64(size - 1)] == len(keys):
            continue  # all alike in this digit, as exponents mostly are
        at = 0
        for digit in range(size):
            place[digit], at = at, at + place[digit]
        for key in keys:
            digit = (key >> shift) & np.uint64(size - 1)
            spare[place[digit]] = key
            place[digit] += 1
        keys, spare = spare, keys
    return keys


@kernel
def sort_tiles(ticket, starts, keys, spare, indices, slots, entries, slot_of):
    """Fill `entries` (Gaussians) and `slot_of`, tile by tile, nearest first; threads share `ticket`."""
    histogram = np.empty((32 // DIGIT, 1 << DIGIT), np.int32)
    while True:
        tile = next_ticket(ticket)
        if tile >= len(starts) - 1:
            return
        start, stop = starts[tile], starts[tile + 1]
        ordered = keys[start:stop]
        if stop - start <= SHORT:
            _insertion_sort(ordered)
        else:
            ordered = _radix_sort(ordered, spare[start:stop], histogram)
        for k in range(stop - start):
            at = np.int64(ordered[k] & np.uint64(0xFFFFFFFF))
            entries[start + k] = indices[at]
            slot_of[start + k] = slots[at]
