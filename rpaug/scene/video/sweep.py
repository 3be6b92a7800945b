"""Depth of every frame from its neighbours: planes swept through the scene, and what is plain filled from its borders.

Plane sweeping after Collins (1996), with normalised cross-correlation of 5x5 windows; the better half of the
neighbours counts, so that what hides a place in some of them does no harm (Kang, Szeliski and Chai 2001). Depth that
neighbours contradict is dropped. Gaps are closed by weighted least squares along color edges (Min et al. 2014).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from rpaug.core import geometry
from rpaug.core.jit import kernel
from rpaug.scene.video.frame import reduced, reduced_lens
from rpaug.scene.video.patches import patches

WINDOW = 5
NOISE = np.float32(4.0)  # squared grey levels: two levels
UNSEEN = np.float32(0.3)  # of a window that another image does not show: then it tells nothing
STEPS = 64  # planes, evenly apart in 1 / depth
NEIGHBOURS = 6
WIDTH = 192  # pixels, about: of the images that are swept
BETWEEN = (2.0, 25.0)  # degrees between views of a point that tell its depth
SURE = 0.55  # correlation from which on a plane is believed
AGREE = 0.06  # of depth: neighbours confirm it
FEW, BROAD = 12, 0.01  # trusted pixels, and share of the image, of a patch that may be flat
DRAWS = 100  # of three points each
PLANAR = 0.03  # of depth: what is nearer to a plane lies on it
MOSTLY = 0.5  # of a patch's trust lies on its plane
BEYOND = 1.6
SMOOTH = 60.0  # of the filling, in grey levels


@dataclass(frozen=True, eq=False)
class SweepImage:
    """A small pinhole image with its camera."""

    rgb: UInt8[np.ndarray, "h w 3"]
    grey: Float32[np.ndarray, "h w"]
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]


def shot(
    image: UInt8[np.ndarray, "h w 3"],
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    width: int = WIDTH,
) -> SweepImage:
    """An image made small enough to be swept."""
    small, lens = reduced(image, width), reduced_lens(K, image.shape[1], image.shape[0], width)
    grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return SweepImage(small, grey, lens, cam_to_world)


def depths(
    shots: Sequence[SweepImage],
    spans: Sequence[tuple[float, float]],
    sparse: Sequence[Float32[np.ndarray, "h w"]],
    progress: Callable[[float], None] = lambda share: None,
) -> list[Float32[np.ndarray, "h w"]]:
    """Depth of every shot, everywhere. `spans` bound it; `sparse` has what is known beforehand, 0 elsewhere."""
    raw = []
    beside = [neighbours(shots, i, float(np.median(span))) for i, span in enumerate(spans)]
    for i, one in enumerate(shots):
        raw.append(swept(one, [shots[j] for j in beside[i]], spans[i]))
        progress(0.8 * (i + 1) / len(shots))
    made = []
    for i, one in enumerate(shots):
        depth, sure = raw[i]
        others = beside[i]
        votes = np.zeros(depth.shape, np.float32)
        for j in others:
            votes += _confirmed(one, depth, shots[j], raw[j][0])
        trust = np.where((sure > SURE) & (votes >= min(2, len(others))), sure**2, 0).astype(
            np.float32
        )
        known = sparse[i] > 0
        trust = np.where(known, np.float32(4), trust)
        given = np.where(known, sparse[i], depth)
        made.append(filled(one.rgb, *flattened(patches(one.rgb), given, trust)))
        progress(0.8 + 0.2 * (i + 1) / len(shots))
    return made


def neighbours(shots: Sequence[SweepImage], i: int, reach: float) -> list[int]:
    """The shots nearest in place whose rays to what is `reach` ahead differ enough and that look at it too."""
    own = shots[i].cam_to_world
    at = own[:3, 3] + reach * own[:3, 2]
    found = []
    for j, other in enumerate(shots):
        if j == i:
            continue
        a, b = at - own[:3, 3], at - other.cam_to_world[:3, 3]
        cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
        angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        turned = np.degrees(np.arccos(np.clip(own[:3, 2] @ other.cam_to_world[:3, 2], -1, 1)))
        if turned < 45 and angle < BETWEEN[1]:
            found.append((angle < BETWEEN[0], abs(angle - 8) + turned / 4 + abs(i - j) / 20, j))
    return [j for _, _, j in sorted(found)[:NEIGHBOURS]]


def swept(
    one: SweepImage, near: Sequence[SweepImage], span: tuple[float, float]
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Depth by the best plane, and how well it correlates."""
    height, width = one.grey.shape
    planes = 1 / np.linspace(1 / span[1], 1 / span[0], STEPS)
    scores = np.full((STEPS, height, width), -1, np.float32)
    mean, spread = _moments(one.grey)
    for k, z in enumerate(planes):
        found = np.stack([_correlated(one, mean, spread, other, z) for other in near])
        if len(found):
            scores[k] = _largest(found, max(1, (len(found) + 1) // 2)).mean(0)
    at = scores.argmax(0)
    top = np.take_along_axis(scores, at[None], 0)[0]
    below = np.take_along_axis(scores, np.maximum(at - 1, 0)[None], 0)[0]
    above = np.take_along_axis(scores, np.minimum(at + 1, STEPS - 1)[None], 0)[0]
    curve = below + above - 2 * top
    shift = np.where(
        np.abs(curve) > 1e-6, (below - above) / (2 * np.where(curve == 0, 1, curve)), 0
    )
    step = (1 / span[0] - 1 / span[1]) / (STEPS - 1)
    inverse = 1 / span[1] + step * (at + np.clip(shift, -0.5, 0.5))
    # A plain window fits anywhere: what the other planes score says how much the best one is worth.
    plain = np.quantile(scores, 0.8, axis=0)
    sure = np.where((at > 0) & (at < STEPS - 1) & (top - plain > 0.05), top, 0)
    return (1 / inverse).astype(np.float32), sure.astype(np.float32)


def _largest(values: Float32[np.ndarray, "n h w"], count: int) -> Float32[np.ndarray, "m h w"]:
    """The largest `count` of each pixel, in falling order: faster than sorting them all."""
    rows = list(values)
    for i in range(count):
        for j in range(i + 1, len(rows)):
            rows[i], rows[j] = np.maximum(rows[i], rows[j]), np.minimum(rows[i], rows[j])
    return np.stack(rows[:count])


def _moments(grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean = cv2.boxFilter(grey, -1, (WINDOW, WINDOW))
    square = cv2.boxFilter(grey * grey, -1, (WINDOW, WINDOW))
    return mean, np.sqrt(np.maximum(square - mean * mean, 0) + NOISE)


def _correlated(
    one: SweepImage, mean: np.ndarray, spread: np.ndarray, other: SweepImage, z: float
) -> Float32[np.ndarray, "h w"]:
    """Correlation with another shot seen through the plane at depth z; -1 where it was not seen."""
    way = geometry.inverse(other.cam_to_world) @ one.cam_to_world
    plane = way[:3, :3] + np.outer(way[:3, 3], [0, 0, 1 / z])
    through = other.K @ plane @ np.linalg.inv(one.K)
    size = (one.grey.shape[1], one.grey.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(other.grey, through, size, flags=flags, borderValue=-1e4)
    out = np.empty_like(seen)
    correlation(one.grey, mean, spread, np.asarray(seen), out)
    return out


@kernel
def correlation(
    grey: Float32[np.ndarray, "h w"],
    mean: Float32[np.ndarray, "h w"],
    spread: Float32[np.ndarray, "h w"],
    seen: Float32[np.ndarray, "h w"],
    out: Float32[np.ndarray, "h w"],
) -> None:
    """Correlation of each pixel's window in two images, of the first of which `mean` and `spread` are known; -1 where
    the other one, negative where it shows nothing, shows too little. Images are mirrored at their borders."""
    height, width = grey.shape
    half, share = WINDOW // 2, np.float32(1 / WINDOW**2)
    shown, square, both, missing = np.empty((4, width + 2 * half), np.float32)
    for r in range(height):
        shown[:], square[:], both[:], missing[:] = 0, 0, 0, 0
        for k in range(r - half, r + half + 1):
            row = min(abs(k), 2 * (height - 1) - k)
            for c in range(width):
                value = max(seen[row, c], np.float32(0))
                shown[c + half] += value
                square[c + half] += value * value
                both[c + half] += grey[row, c] * value
                missing[c + half] += np.float32(seen[row, c] < 0)
        for sums in (shown, square, both, missing):
            for k in range(1, half + 1):
                sums[half - k] = sums[half + k]
                sums[width + half - 1 + k] = sums[width + half - 1 - k]
        for c in range(width):
            total, squares, product, unseen = shown[c], square[c], both[c], missing[c]
            for k in range(1, WINDOW):
                total += shown[c + k]
                squares += square[c + k]
                product += both[c + k]
                unseen += missing[c + k]
            there = total * share
            wide = np.sqrt(max(squares * share - there * there, np.float32(0)) + NOISE)
            found = (product * share - mean[r, c] * there) / (spread[r, c] * wide)
            out[r, c] = np.float32(-1) if unseen * share > UNSEEN else found


def _confirmed(
    one: SweepImage, depth: np.ndarray, other: SweepImage, theirs: np.ndarray
) -> np.ndarray:
    """Where another shot's depth says the same of the same point."""
    local = geometry.unproject(depth.astype(np.float64), one.K)
    way = geometry.inverse(other.cam_to_world) @ one.cam_to_world
    there = geometry.transform(way, local)
    row, column, inside = geometry.in_image(there, other.K, theirs.shape)
    z = np.maximum(there[..., 2], 1e-9)
    return inside & (np.abs(theirs[row, column] - z) < AGREE * z)


def flattened(
    patch: Int32[np.ndarray, "h w"], depth: np.ndarray, trust: Float32[np.ndarray, "h w"]
) -> tuple[np.ndarray, Float32[np.ndarray, "h w"]]:
    """Depth and trust with each patch laid on the plane of what is trusted in it, if that lies on one.

    On a plane 1 / depth is linear in the pixel's place (Scharstein and Szeliski 2002, on segments). What is trusted and
    lies off its patch's plane by more than PLANAR stays as it is.
    """
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    place = np.stack([columns / depth.shape[1], rows / depth.shape[1], np.ones(depth.shape)], -1)
    inverse = 1 / np.maximum(depth, 1e-9)
    depth, trust = depth.copy(), trust.copy()
    rng = np.random.default_rng(0)
    for number in range(int(patch.max()) + 1):
        mine = patch == number
        known = mine & (trust > 0)
        if known.sum() < FEW or mine.sum() < BROAD * mine.size:
            continue
        at, value, weight = place[known], inverse[known], trust[known].astype(float)
        drawn = rng.integers(len(at), size=(DRAWS, 3))
        try:
            tried = np.linalg.solve(at[drawn] + 1e-9 * np.eye(3), value[drawn][..., None])[..., 0]
        except np.linalg.LinAlgError:
            continue
        off = np.abs(at @ tried.T / value[:, None] - 1)
        share = ((off < PLANAR) * weight[:, None]).sum(0) / weight.sum()
        inside = off[:, share.argmax()] < PLANAR
        if share.max() < MOSTLY:
            continue
        root = np.sqrt(weight[inside])[:, None]
        plane = np.linalg.lstsq(at[inside] * root, value[inside] * root[:, 0], rcond=None)[0]
        laid = place @ plane
        span = np.quantile(value[inside], [0.02, 0.98])
        # A plane is followed a little beyond what was seen of it, no farther.
        usable = mine & (laid > span[0] / BEYOND) & (laid < span[1] * BEYOND)
        apart = known & (np.abs(laid * depth - 1) > PLANAR) & (trust > SURE)
        usable &= ~apart
        depth = np.where(usable, 1 / np.where(usable, laid, 1), depth)
        trust = np.where(usable, np.float32(1), trust)
    return depth, trust


def filled(
    rgb: UInt8[np.ndarray, "h w 3"], depth: np.ndarray, trust: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"]:
    """Depth everywhere: what is trusted, spread along surfaces of one color."""
    inverse = np.where(trust > 0, 1 / np.maximum(depth, 1e-9), 0).astype(np.float32)
    unit = float(np.median(inverse[trust > 0])) if (trust > 0).any() else 1.0
    spread = cv2.ximgproc.createFastGlobalSmootherFilter(rgb, 900.0, SMOOTH / 4)
    weight = spread.filter(trust)
    value = spread.filter(trust * inverse / unit)
    wide = cv2.ximgproc.createFastGlobalSmootherFilter(rgb, 90000.0, SMOOTH)
    far, base = wide.filter(trust * inverse / unit), wide.filter(trust)
    rough = far / np.maximum(base, 1e-6)
    share = weight / (weight + 0.02)
    made = share * value / np.maximum(weight, 1e-9) + (1 - share) * rough
    return (1 / (unit * np.maximum(made, 1e-3))).astype(np.float32)
