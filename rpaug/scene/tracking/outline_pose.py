"""Where a camera stands, by the robot's outline: its known shape is brought onto the masks that show it, without depth.

The shape is drawn, and both outlines are laid on each other: each boundary pixel of either has its signed distance to
the other, and how that changes with the camera is known from the surface point on the drawn outline (Rosenhahn et al.
2007). Gauss-Newton lets go of what hides the robot and of what a mask has beside it (weights of Geman and McClure 1985,
their scale from the distances themselves). Both outlines are taken on one raster, so that its steps cancel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core import geometry
from rpaug.core.types import Mesh
from rpaug.render import mesh

DAMPED = 1e-3  # of the curvature, to begin with
STILL = 1e-5  # metres, radians: a smaller step is the last
LARGE = 2.5  # times the median misfit: one so large is an outlier (Geman and McClure 1985)
LEAST = 0.3  # pixels: the scale of residuals is never taken for less
SMOOTH = 0.7  # pixels: a mask's steps are smoothed by this before it is made finer
LINEAR = 6**-0.5  # pixels: what interpolation between pixels smooths by
ROUNDS = 8  # of one scale
SETTLED, LOST = 12, 1.3  # steps at the end, and how much worse one may make it
LEAST_FIRM = 0.05
FEWEST = 12  # pixels of an outline that is looked at
Pose = Float64[np.ndarray, "4 4"]
Mask = Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class OutlinedFrame:
    """One time: where each of the robot's meshes is in the world, and the pixels that show the robot.

    `blur` is how much the mask's outline was smoothed, in pixels: corners are rounded, and drawn ones as well.
    """

    parts: tuple[tuple[Mesh, Pose], ...]
    mask: Mask
    blur: float = 0.0

    def sized(self, side: int) -> "OutlinedFrame":
        """The same with a mask whose longer side has so many pixels; a finer one is smooth between its pixels."""
        factor = side / max(self.mask.shape)
        size = tuple(max(8, round(factor * one)) for one in self.mask.shape[::-1])
        share: Any = self.mask.astype(np.float32)
        if factor > 1:
            share = cv2.GaussianBlur(share, (0, 0), SMOOTH, borderType=cv2.BORDER_REPLICATE)
        way = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
        blur = factor * float(np.hypot(SMOOTH, LINEAR)) if factor > 1 else 0.0
        return replace(self, mask=cv2.resize(share, size, interpolation=way) > 0.5, blur=blur)


@dataclass(frozen=True)
class OutlineLens:
    """Intrinsics; `known` if the source states them, else the focal length is worked out too."""

    K: Float64[np.ndarray, "3 3"]
    known: bool = True

    def scaled(self, shape: tuple[int, ...], to: tuple[int, ...]) -> "OutlineLens":
        """Those of an image of another size (h, w)."""
        x, y = to[1] / shape[1], to[0] / shape[0]
        turned = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])
        return replace(self, K=turned @ self.K)

    def zoomed(self, factor: float) -> "OutlineLens":
        """The same with a focal length `factor` times as long."""
        return replace(self, K=self.K * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]]))


@dataclass(frozen=True)
class SolvedPose:
    """A camera by outlines, the curvature about it, and each frame's slope there; a step is (turn, shift, zoom).

    `centre` is the point of the camera's frame that steps turn about, `cost` the robust misfit of a
    boundary pixel and `scale` what is large among misfits, in pixels. `firm` is the share of the curvature that is
    left where outliers pull the other way.
    """

    cam_to_world: Pose
    lens: OutlineLens
    cost: float
    scale: float
    centre: Float64[np.ndarray, "3"]
    curvature: Float64[np.ndarray, "p p"]
    firm: float
    slopes: Float64[np.ndarray, "t p"]

    def spread(self) -> tuple[float, float]:
        """Standard errors of the camera's place (metres) and direction (radians): what a frame's masks are off by pulls
        it, whatever else is off in that frame with it (the sandwich of Huber 1967, one frame a cluster)."""
        frames, unknown = self.slopes.shape
        inverse = np.linalg.pinv(self.firm * self.curvature)
        more = frames / max(frames - 1, 1)
        cov = more * inverse @ (self.slopes.T @ self.slopes) @ inverse
        x, y, z = self.centre
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        moves = np.zeros((3, unknown))
        moves[:, :3], moves[:, 3:6] = -cross, -np.eye(3)
        place = float(np.sqrt(max(np.trace(moves @ cov @ moves.T), 0)))
        return place, float(np.sqrt(max(np.trace(cov[:3, :3]), 0)))


def solve(
    frames: Sequence[OutlinedFrame],
    lens: OutlineLens,
    start: Pose,
    widths: Sequence[float] = (2.0, 1.0),
) -> SolvedPose:
    """The camera nearest to `start` that brings the drawn outlines onto the masks (Levenberg 1944).

    What counts as an outlier is taken anew for each of `widths`, and so many times as far off: wide ones reach farther.
    """
    now = _linearised(frames, lens, start)
    for width in widths:
        now = _linearised(frames, now.lens, now.cam_to_world)
        now = _linearised(frames, now.lens, now.cam_to_world, width * now.scale)
        damping = DAMPED
        for _ in range(ROUNDS):
            curvature = now.curvature + damping * np.diag(np.diag(now.curvature) + 1e-9)
            step = -np.linalg.lstsq(curvature, now.slopes.sum(0), rcond=None)[0]
            pose, zoomed = _moved(now, step)
            tried = _linearised(frames, zoomed, pose, now.scale)
            if tried.cost < now.cost:
                now, damping = tried, damping / 4
            else:
                damping = max(damping, 0.01) * 8
            if np.abs(step).max() < STILL or damping > 1e3:
                break
    return _settled(frames, now)


def _settled(frames: Sequence[OutlinedFrame], now: SolvedPose) -> SolvedPose:
    """Where the slopes cancel: a cost of whole pixels is jagged, and its least place is none in particular."""
    for _ in range(SETTLED):
        step = -np.linalg.lstsq(now.curvature, now.slopes.sum(0), rcond=None)[0]
        pose, lens = _moved(now, step)
        tried = _linearised(frames, lens, pose)
        if tried.cost > LOST * now.cost:
            break
        now = tried
        if np.abs(step).max() < STILL:
            break
    return now


def overlaps(
    frames: Sequence[OutlinedFrame], lens: OutlineLens, cam_to_world: Pose
) -> Float64[np.ndarray, "t"]:
    """Intersection over union of drawn and recorded outline, frame by frame."""
    out = []
    for frame in frames:
        drawn = drawn_depth(frame, lens, cam_to_world) > 0
        out.append((drawn & frame.mask).sum() / max((drawn | frame.mask).sum(), 1))
    return np.array(out)


def drawn_depth(
    frame: OutlinedFrame, lens: OutlineLens, cam_to_world: Pose
) -> Float64[np.ndarray, "h w"]:
    """Depth of the robot as the camera would see it alone."""
    return mesh.depths(frame.parts, lens.K, cam_to_world, frame.mask.shape[::-1])


def _moved(at: SolvedPose, step: Float64[np.ndarray, "p"]) -> tuple[Pose, OutlineLens]:
    turn = np.eye(4)
    turn[:3, :3] = geometry.rotation(step[:3])
    turn[:3, 3] = at.centre - turn[:3, :3] @ at.centre + step[3:6]
    lens = at.lens if at.lens.known else at.lens.zoomed(float(np.exp(np.clip(step[6], -0.3, 0.3))))
    return geometry.inverse(turn @ geometry.inverse(at.cam_to_world)), lens


def _linearised(
    frames: Sequence[OutlinedFrame],
    lens: OutlineLens,
    cam_to_world: Pose,
    scale: float | None = None,
) -> SolvedPose:
    """What all frames say of a pose; the scale of their residuals is shared, their own where none is given."""
    depths = [drawn_depth(frame, lens, cam_to_world) for frame in frames]
    seen = [geometry.unproject(depth, lens.K)[depth > 0] for depth in depths]
    points = np.concatenate(seen)
    centre = points.mean(0) if len(points) else np.array([0.0, 0.0, 1.0])
    unknown = 6 if lens.known else 7
    each = [_frame(one, depth, lens, centre) for one, depth in zip(frames, depths, strict=True)]
    every = np.concatenate([off for off, _ in each]) if each else np.zeros(0)
    if not len(every):
        return SolvedPose(
            cam_to_world,
            lens,
            np.inf,
            1.0,
            centre,
            np.eye(unknown),
            1.0,
            np.zeros((len(frames), unknown)),
        )
    scale = scale or max(LEAST, LARGE * float(np.median(np.abs(every))))
    curvature, slopes = np.zeros((unknown, unknown)), np.zeros((len(frames), unknown))
    for t, (off, J) in enumerate(each):
        weight = (1 + (off / scale) ** 2) ** -2
        curvature += (J * weight[:, None]).T @ J
        slopes[t] = J.T @ (weight * off)
    part = (every / scale) ** 2
    cost = scale * float(np.mean(part / (1 + part)))
    firm = float(np.sum((1 - 3 * part) / (1 + part) ** 3) / np.sum((1 + part) ** -2))
    return SolvedPose(
        cam_to_world, lens, cost, scale, centre, curvature, max(firm, LEAST_FIRM), slopes
    )


def _frame(
    frame: OutlinedFrame,
    depth: Float64[np.ndarray, "h w"],
    lens: OutlineLens,
    centre: Float64[np.ndarray, "3"],
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n p"]]:
    """Signed distances of both outlines' pixels to the other outline, and how they change with the camera."""
    mask, drawn = frame.mask, depth > 0
    if frame.blur and drawn.any():
        drawn, depth = _rounded(drawn, depth, frame.blur)
    unknown = 6 if lens.known else 7
    ours, theirs = _boundary(drawn), _boundary(mask)
    if ours.sum() < FEWEST or theirs.sum() < FEWEST:
        return np.zeros(0), np.zeros((0, unknown))
    to_mask, to_drawn = _signed(mask), _signed(drawn)
    rows, columns = np.nonzero(ours)
    motion = _motion(rows, columns, depth[ours], lens, centre)
    off = to_mask[ours] - to_drawn[ours]
    towards = np.einsum("nk,nkp->np", _gradient(to_mask)[ours], motion)
    _, label = cv2.distanceTransformWithLabels(
        (~ours).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros(label.max() + 1, int)
    place[label[ours]] = np.arange(len(rows))
    nearest = place[label[theirs]]
    back = to_drawn[theirs] - to_mask[theirs]
    away = -np.einsum("nk,nkp->np", _gradient(to_drawn)[theirs], motion[nearest])
    return np.concatenate([off, back]), np.concatenate([towards, away])


def _rounded(
    drawn: Mask, depth: Float64[np.ndarray, "h w"], blur: float
) -> tuple[Mask, Float64[np.ndarray, "h w"]]:
    """A drawn outline smoothed as the mask's is, and the depth of what is nearest where that reaches beyond it."""
    edge = cv2.BORDER_REPLICATE
    made = cv2.GaussianBlur(drawn.astype(np.float32), (0, 0), blur, borderType=edge) > 0.5
    beyond = made & ~drawn
    if not beyond.any():
        return made, depth
    _, label = cv2.distanceTransformWithLabels(
        (~drawn).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    known = np.zeros(label.max() + 1)
    known[label[drawn]] = depth[drawn]
    return made, np.where(beyond, known[label], depth)


def _boundary(mask: Mask) -> Mask:
    """Pixels of a mask beside others; the image's edge is no boundary."""
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    inner = cv2.erode(mask.astype(np.uint8), cross, borderType=cv2.BORDER_REPLICATE)
    return mask & (inner == 0)


def _signed(mask: Mask) -> Float64[np.ndarray, "h w"]:
    """Pixels to the mask's boundary, negative inside."""
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    return (np.maximum(outside - 0.5, 0) - np.maximum(inside - 0.5, 0)).astype(np.float64)


def _gradient(signed: Float64[np.ndarray, "h w"]) -> Float64[np.ndarray, "h w 2"]:
    """Unit directions (right, down) in which a distance grows."""
    smooth = cv2.GaussianBlur(signed, (0, 0), 1.0)
    down, right = np.gradient(smooth)
    along = np.stack([right, down], -1)
    return along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-6)


def _motion(
    rows: np.ndarray,
    columns: np.ndarray,
    depth: Float64[np.ndarray, "n"],
    lens: OutlineLens,
    centre: Float64[np.ndarray, "3"],
) -> Float64[np.ndarray, "n 2 p"]:
    """Pixels (right, down) that surface points move by, for each unit of a step."""
    K = lens.K
    point = geometry.lifted(columns.astype(float), rows.astype(float), depth, K)
    x, y, z = point.T
    across = np.zeros((len(point), 2, 3))
    across[:, 0, 0], across[:, 0, 2] = K[0, 0] / z, -K[0, 0] * x / z**2
    across[:, 1, 1], across[:, 1, 2] = K[1, 1] / z, -K[1, 1] * y / z**2
    arm = point - centre
    turned = np.zeros((len(point), 3, 3))  # of turn x arm
    turned[:, 0, 1], turned[:, 0, 2] = arm[:, 2], -arm[:, 1]
    turned[:, 1, 0], turned[:, 1, 2] = -arm[:, 2], arm[:, 0]
    turned[:, 2, 0], turned[:, 2, 1] = arm[:, 1], -arm[:, 0]
    steps = [across @ turned, across]
    if not lens.known:
        zoom = np.stack([columns - K[0, 2], rows - K[1, 2]], 1).astype(float)
        steps.append(zoom[..., None])
    return np.concatenate(steps, -1)
