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
    use = np.zeros((0, 0), np.bool_) if source.use is None else source.use
    instance_ids, factors = _gains(
        source.lifted.near, use, source.ids, source.rgb, source.K, source.cam_to_world,
        like.lifted.near, like.ids, like.rgb, like.K, like.cam_to_world, tolerance,
    )  # fmt: skip
    return replace(source, gains=Gains(instance_ids, factors))


@kernel
def _gains(
    near, use, ids, rgb, K, pose, like_near, like_ids, like_rgb, like_K, like_pose, tolerance
):
    """The instance ids that both images show somewhere, and of each per channel the median ratio there / here."""
    known, things, ratios = _ratios(
        near, use, ids, rgb, intrinsics(K), relative(pose, like_pose),
        like_near, like_ids, like_rgb, intrinsics(like_K), tolerance,
    )  # fmt: skip
    points = np.bincount(things, minlength=len(known))
    start = np.cumsum(points) - points
    gains, found = np.ones((len(known), 3), np.float32), np.empty(len(things), np.float32)
    for channel in range(3):
        end = start.copy()
        for n in range(len(things)):
            if ratios[n, channel] > 0:
                found[end[things[n]]] = ratios[n, channel]
                end[things[n]] += 1
        for k in range(len(known)):
            if end[k] - start[k] >= FEWEST:
                middle = float(np.median(found[start[k] : end[k]]))
                gains[k, channel] = min(max(middle, 1 / STRONGEST), STRONGEST)
    return known, gains


@kernel
def _ratios(near, use, ids, rgb, lens, pose, like_near, like_ids, like_rgb, like_lens, tolerance):
    """The instance ids, and of each point that both images show the place of its own among them and color there / color
    here, 0 where that says nothing."""
    most = ((near.shape[0] + STRIDE - 1) // STRIDE) * ((near.shape[1] + STRIDE - 1) // STRIDE)
    things, ratios = np.empty(most, np.int64), np.zeros((most, 3), np.float32)
    known = np.empty(most, np.int32)
    count = different = thing = 0
    for row in range(0, near.shape[0], STRIDE):
        for column in range(0, near.shape[1], STRIDE):
            here = near[row, column]
            if here <= 0.0 or (use.size and not use[row, column]):
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
            if not different or known[thing] != ids[row, column]:  # often the last one's
                thing = 0
                while thing < different and known[thing] != ids[row, column]:
                    thing += 1
                known[thing] = ids[row, column]
                different = max(different, thing + 1)
            things[count] = thing
            for channel in range(3):
                one, other = like_rgb[i, j, channel], rgb[row, column, channel]
                if one >= DARKEST and other >= DARKEST:
                    ratios[count, channel] = one / other
            count += 1
    return known[:different], things[:count], ratios[:count]
