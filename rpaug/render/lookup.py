"""Colors of drawn pixels, looked up where their points were recorded."""

import numpy as np

from rpaug.core.jit import inlined, kernel
from rpaug.render.pinhole import NEAR, map_pixel

ENOUGH = 0.3  # of the taps' weight must be on the same thing, or its nearest pixel counts alone
BLENDED = 3  # sources whose colors are averaged at most, where the first does not show the place
COARSE = 2.0  # times as coarse as what won a pixel: such a recording is not averaged with it
ON_PIXEL = 1e-6  # pixels: closer to a pixel's centre than this takes that pixel's color unblended


@kernel
def add_color(
    rgb, ids, near, use, instance_ids, factors, lens, back, target, index, tolerance, places, nearest, source, pixel,
    stretch, won, out, total,
):  # fmt: skip
    """Add this source's color to each of the pixels at `places` (rows, columns) that it won, or that another won and
    it shows too.

    `stretch` is the length that the winner's recorded pixel has in the view. No `use` given, all pixels are used.
    """
    across, along, found = np.empty(4), np.empty(4), np.empty(3)
    height, width = ids.shape
    for v, u in places:
        winner = source[v, u]
        if winner != index and total[v, u] >= BLENDED:
            continue
        instance_id = won[v, u]
        x, y, ahead = map_pixel(u, v, nearest[v, u], target, back, lens)
        if winner == index:
            row, column = pixel[v, u] // width, pixel[v, u] % width
        else:
            if not ahead > NEAR or not (-0.5 < x < width - 0.5 and -0.5 < y < height - 0.5):
                continue
            if target[0] * ahead > COARSE * stretch[v, u] * lens[0]:
                continue
            row, column = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
            off = abs(near[row, column] * ahead - nearest[v, u])
            if (
                (use.size and not use[row, column])
                or ids[row, column] != instance_id
                or off > tolerance * nearest[v, u]
            ):
                continue
        if abs(x - column) < ON_PIXEL and abs(y - row) < ON_PIXEL:
            for channel in range(3):
                found[channel] = rgb[row, column, channel] / 255.0
        else:
            _between(rgb, ids, x, y, row, column, across, along, found)
        gain = -1
        for k in range(len(instance_ids)):
            if instance_ids[k] == instance_id:
                gain = k
        for channel in range(3):
            scale = factors[gain, channel] if gain >= 0 else 1.0
            out[v, u, channel] += min(max(found[channel] * scale, 0.0), 1.0)
        total[v, u] += 1.0


@kernel
def _between(rgb, ids, x, y, row, column, across, along, found):
    """Color in 0..1 at (x, y) between pixels, from those of the same thing as pixel (row, column) alone."""
    height, width = ids.shape
    j, i = int(np.floor(x)), int(np.floor(y))
    _cubic(x - j, across)
    _cubic(y - i, along)
    total = red = green = blue = 0.0
    for a in range(4):
        for b in range(4):
            r, c = i - 1 + a, j - 1 + b
            if not (0 <= r < height and 0 <= c < width) or ids[r, c] != ids[row, column]:
                continue  # another thing's color would make a halo
            weight = along[a] * across[b]
            total += weight
            red += weight * rgb[r, c, 0]
            green += weight * rgb[r, c, 1]
            blue += weight * rgb[r, c, 2]
    if total < ENOUGH:
        total = 1.0
        red, green, blue = (
            1.0 * rgb[row, column, 0],
            1.0 * rgb[row, column, 1],
            1.0 * rgb[row, column, 2],
        )
    found[0], found[1], found[2] = (
        red / (255.0 * total),
        green / (255.0 * total),
        blue / (255.0 * total),
    )


@inlined
def _cubic(offset, weights):
    """Catmull-Rom weights of the four pixels around a position (Keys 1981, a = -1/2)."""
    for k in range(4):
        d = abs(offset + 1.0 - k)
        if d < 1.0:
            weights[k] = (1.5 * d - 2.5) * d * d + 1.0
        else:
            weights[k] = ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0
