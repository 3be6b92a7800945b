"""A video's model from a learned model of poses, window by window, each joined to the one before it where they overlap.

The answer is held to itself and to what is held against any other model: a frame's points must fall on its own pixels,
and `Model.faults` must find nothing.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float64, UInt8

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.providers.poses import Posed, Poses
from rpaug.scene.video import world
from rpaug.scene.video.model import Reconstruction, believed

WINDOW, SHARED = (
    24,
    6,
)  # frames looked at together, and those of them that the window before has too
WIDTH, STEP = 518, 14  # pixels: what such models are trained on, in whole patches
GRID = 32  # points along a frame's width
SURE = 0.5  # quantile of confidence below which points are not used
NEAR = 0.05  # of depth: so near to a frame's own point another one is the same place
OFF = 0.02  # image widths that a frame's points may lie off their pixels, the median
TURNED = 1e-2  # how far a pose may be from a rotation


def reconstruct(
    frame: Callable[[int], UInt8[np.ndarray, "h w 3"]], times: Sequence[int], model: Poses
) -> Reconstruction:
    """What a learned model says of these frames. Raises Unsupported, with the numbers, where it cannot be believed."""
    first = frame(times[0])
    full = (first.shape[1], first.shape[0])
    width = min(WIDTH, full[0] // STEP * STEP)
    size = (width, max(STEP, round(width * full[1] / full[0] / STEP) * STEP))
    images = np.stack([cv2.resize(frame(t), size, interpolation=cv2.INTER_AREA) for t in times])
    given = _joined(images, model)
    _held_to_itself(given)
    found = _model(given, times, images).sized(*full)
    return believed([found], len(times))


def _joined(images: UInt8[np.ndarray, "n h w 3"], model: Poses) -> Posed:
    """What the model says of all frames in the first window's world."""
    given = model(images[:WINDOW])
    while (known := len(given.points)) < len(images):
        part = _onto(model(images[known - SHARED : known - SHARED + WINDOW]), given)
        new = _some(part, SHARED, len(part.points))
        given = Posed(*(np.concatenate([a, vars(new)[n]]) for n, a in vars(given).items()))
    return given


def _some(posed: Posed, start: int, stop: int) -> Posed:
    return Posed(*(array[start:stop] for array in vars(posed).values()))


def _onto(part: Posed, before: Posed) -> Posed:
    """A window in the world of what is known before it, by the points of the frames that both have."""
    mine = _some(part, 0, SHARED)
    theirs = _some(before, len(before.points) - SHARED, len(before.points))
    both = _used(mine) & _used(theirs)
    if both.sum() < 3:
        raise Unsupported("the model of poses: two windows share no point that it is sure of")
    motion, scale = world.aligned(
        mine.points[both].astype(float), theirs.points[both].astype(float)
    )
    poses = part.cam_to_world.copy()
    poses[:, :3, 3] *= scale
    points = geometry.transform(motion, scale * part.points.astype(np.float64))
    return Posed(motion @ poses, part.K, points.astype(np.float32), part.confidence)


def _used(posed: Posed) -> Bool[np.ndarray, "n h w"]:
    """The surer half of each frame's points."""
    sure = posed.confidence
    least = np.quantile(sure, SURE, axis=(1, 2), keepdims=True)
    return (sure >= least) & (sure > 0) & np.isfinite(posed.points).all(-1)


def _held_to_itself(posed: Posed) -> None:
    """Raises Unsupported where poses are none, or points do not fall on the pixels they are points of."""
    turn = posed.cam_to_world[:, :3, :3]
    off = np.abs(turn @ np.swapaxes(turn, 1, 2) - np.eye(3)).max()
    if off > TURNED or (np.linalg.det(turn) < 0).any():
        raise Unsupported(f"the model of poses: rotations are off by {off:.2f}")
    used = _used(posed)
    misses = [
        _missed(posed, i, used[i]) if used[i].any() else float("inf") for i in range(len(used))
    ]
    width = posed.points.shape[2]
    if (miss := float(np.median(misses))) > OFF * width:
        raise Unsupported(
            f"the model of poses: points lie {miss:.1f} of {width} pixels off the pixels they are points of"
        )


def _missed(posed: Posed, i: int, used: Bool[np.ndarray, "h w"]) -> float:
    rows, columns = np.nonzero(used)
    at, z = _seen(posed, i, posed.points[i][used].astype(np.float64))
    off = np.linalg.norm(at - np.stack([columns, rows], -1), axis=-1)
    return float(np.median(np.where(z > 0, off, np.inf)))


def _seen(
    posed: Posed, i: int, points: Float64[np.ndarray, "p 3"]
) -> tuple[Float64[np.ndarray, "p 2"], Float64[np.ndarray, "p"]]:
    """Pixel and depth of points in frame i."""
    local = geometry.transform(geometry.inverse(posed.cam_to_world[i]), points)
    z = local[:, 2]
    projected = local @ posed.K[i].T
    return projected[:, :2] / np.maximum(projected[:, 2:], 1e-9), z


def _model(
    posed: Posed, times: Sequence[int], images: UInt8[np.ndarray, "n h w 3"]
) -> Reconstruction:
    """One lens for all frames, and a grid of sure points of each, seen by all that have a like point there."""
    used, step = _used(posed), max(1, posed.points.shape[2] // GRID)
    lattice = np.zeros(used.shape, bool)
    lattice[:, step // 2 :: step, step // 2 :: step] = True
    chosen = used & lattice
    points = posed.points[chosen].astype(np.float64)
    height, width = used.shape[1:]
    own = np.nonzero(chosen)[0]
    seen = np.zeros((len(times), len(points)), bool)
    for i in range(len(times)):
        at, z = _seen(posed, i, points)
        pixel = np.rint(at).clip(-1, 1 << 20).astype(int)
        inside = (z > 0) & (pixel >= 0).all(1) & (pixel < [width, height]).all(1)
        x, y = np.where(inside[:, None], pixel, 0).T
        there = posed.points[i, y, x].astype(np.float64)
        seen[i] = inside & (np.linalg.norm(there - points, axis=1) < NEAR * np.maximum(z, 1e-9))
        seen[i] |= own == i
    K = np.median(posed.K, axis=0)
    return Reconstruction(
        times=np.array(times, np.int32), cam_to_world=posed.cam_to_world,
        focal=float((K[0, 0] + K[1, 1]) / 2), middle=(float(K[0, 2]), float(K[1, 2])), radial=0.0,
        width=width, height=height, points=points, colors=images[chosen], seen=seen,
        facts={"mapper": "pose model"},
    )  # fmt: skip
