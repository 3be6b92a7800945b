"""Colors of one image made to match another's, thing by thing, where both show the same points.

What two cameras record of one point differs by what depends on where one looks from: highlights, a lamp on the camera,
exposure. A factor per thing and channel, the median over the points that both see, takes most of it away, so that no
seam shows where one recording ends and another begins.
"""

from dataclasses import replace

import numpy as np

from rpaug.core.jit import kernel
from rpaug.render.pinhole import NEAR, intrinsics, map_pixel, relative
from rpaug.render.zbuffer import Gains, Source

STRIDE = 2  # pixels: every other one in each direction is compared
FEWEST = 12  # points both must see of a thing, or it stays as it is
STRONGEST = 1.6  # factor either way; what differs by more is not light
DARKEST = 8  # of 255: darker channels say nothing about a factor


def matched(source: Source, like: Source, tolerance: float) -> Source:
    """`source` with gains, per thing, that bring its colors to what `like` shows of the same points.

    Points are the same where depths agree to `tolerance` of depth and ids are equal. Both sources are lifted.
    """
    assert source.lifted is not None
    assert like.lifted is not None
    near = source.lifted.near
    use = np.ones(near.shape, bool) if source.use is None else source.use
    instance_ids, ratios = _ratios(
        near, use, source.ids, source.rgb, intrinsics(source.K),
        relative(source.cam_to_world, like.cam_to_world),
        like.lifted.near, like.ids, like.rgb, intrinsics(like.K), tolerance,
    )  # fmt: skip
    return replace(source, gains=Gains(*_medians(instance_ids, ratios)))


@kernel
def _medians(instance_ids, ratios):
    """The instance ids, and of each per channel the median ratio; 0 among the ratios says nothing."""
    known = np.unique(instance_ids)
    gains = np.ones((len(known), 3), np.float32)
    found = np.empty(len(instance_ids), np.float32)
    for k in range(len(known)):
        for channel in range(3):
            count = 0
            for row in range(len(instance_ids)):
                if instance_ids[row] == known[k] and ratios[row, channel] > 0:
                    found[count] = ratios[row, channel]
                    count += 1
            if count >= FEWEST:
                middle = float(np.median(found[:count]))
                gains[k, channel] = min(max(middle, 1 / STRONGEST), STRONGEST)
    return known, gains


@kernel
def _ratios(near, use, ids, rgb, lens, pose, like_near, like_ids, like_rgb, like_lens, tolerance):
    """Handle, and color there / color here of each point that both images show."""
    most = ((near.shape[0] + STRIDE - 1) // STRIDE) * ((near.shape[1] + STRIDE - 1) // STRIDE)
    instance_ids, ratios = np.zeros(most, np.int32), np.zeros((most, 3), np.float32)
    count = 0
    for row in range(0, near.shape[0], STRIDE):
        for column in range(0, near.shape[1], STRIDE):
            here = near[row, column]
            if here <= 0.0 or not use[row, column]:
                continue
            x, y, ahead = map_pixel(column, row, here, lens, pose, like_lens)
            if not ahead > NEAR:
                continue
            j, i = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
            if not (0 <= i < like_near.shape[0] and 0 <= j < like_near.shape[1]):
                continue
            if like_ids[i, j] != ids[row, column]:
                continue
            if abs(like_near[i, j] * ahead - here) > tolerance * here:
                continue
            instance_ids[count] = ids[row, column]
            for channel in range(3):
                one, other = like_rgb[i, j, channel], rgb[row, column, channel]
                if one >= DARKEST and other >= DARKEST:
                    ratios[count, channel] = one / other
            count += 1
    return instance_ids[:count], ratios[:count]
