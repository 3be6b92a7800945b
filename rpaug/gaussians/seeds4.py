"""The Gaussians a 4D fit starts from: the region's recorded surface at every fitted frame, with its motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from rpaug.core.types import Gaussians, Gaussians4, Scene
from rpaug.gaussians import gaussians4
from rpaug.gaussians.flow import flow
from rpaug.gaussians.flowing import shapes
from rpaug.gaussians.gaussians import SH0, SPREAD, LiftedImage, chosen, joined, lifted, normals

A_FRAME = 1800  # Gaussians of one frame, at most
LASTING = 0.6  # of the gap between fitted frames: standard deviation in time
SLOWEST = 0.1  # of the spacing per frame: what counts as one frame's pace where nothing moves


@dataclass(frozen=True)
class _SeedSurface:
    """What was seen at one frame, thinned."""

    t: int
    seen: Gaussians

    @property
    def points(self) -> Float64[np.ndarray, "n 3"]:
        return self.seen.means.astype(np.float64)

    @property
    def colors(self) -> Float64[np.ndarray, "n 3"]:
        return 0.5 + SH0 * self.seen.sh[:, 0].astype(np.float64)


def seeds(scene: Scene, instance_ids: frozenset[int], times: Sequence[int]) -> Gaussians4:
    """Flat Gaussians on the depth of `times`, each on its way to where the next frames show it."""
    origin = _origin(scene, instance_ids, times)
    surfaces = [s for t in times if (s := _surface(scene, instance_ids, t, origin)) is not None]
    spacing = float(np.median(np.concatenate([s.seen.scales[:, 1] for s in surfaces]))) / SPREAD
    velocities = _velocities(surfaces, spacing)
    fastest = np.concatenate([np.linalg.norm(v, axis=1) for v in velocities])
    pace = float(max(np.quantile(fastest, 0.9), SLOWEST * spacing))
    every = joined(s.seen for s in surfaces)
    gaps = np.gradient(np.array(times, float)) if len(times) > 1 else np.ones(1)
    gap = dict(zip(times, gaps.tolist(), strict=True))
    count = [len(s.seen) for s in surfaces]
    lasting = np.repeat([LASTING * gap[s.t] * pace for s in surfaces], count)
    moments = np.repeat([s.t * pace for s in surfaces], count)
    left, right, scales = gaussians4.moving(
        shapes(every.quats, every.scales), np.concatenate(velocities) / pace, lasting
    )
    f = np.float32
    return Gaussians4(
        means=np.concatenate([every.means, moments[:, None]], 1).astype(f),
        left=left.astype(f),
        right=right.astype(f),
        scales=scales.astype(f),
        opacities=every.opacities,
        sh=every.sh,
        ids=every.ids,
        origin=origin,
        pace=pace,
    )


def _pictures(scene: Scene, instance_ids: frozenset[int], t: int) -> list[LiftedImage]:
    """What each camera shows of the region, from where it truly stood."""
    found = []
    for name, view in scene.episode.views.items():
        if view.depth is None or view.ids is None:
            continue
        ids = view.ids(t)
        use = np.isin(ids, list(instance_ids))
        if use.any():
            pose_correction = (
                scene.pose_correction[name][t] if name in scene.pose_correction else np.eye(4)
            )
            pose = pose_correction @ view.camera.cam_to_world[t]
            found.append(LiftedImage(view.rgb(t), view.depth(t), ids, view.camera.K, pose, use))
    return found


def _origin(
    scene: Scene, instance_ids: frozenset[int], times: Sequence[int]
) -> Float64[np.ndarray, "3"]:
    """Somewhere near the region: the position of a camera that sees it, rounded off."""
    for t in times:
        for picture in _pictures(scene, instance_ids, t):
            depth = float(np.median(picture.depth[picture.use]))
            return picture.cam_to_world[:3, 3] + depth * picture.cam_to_world[:3, 2]
    return np.zeros(3)


def _surface(
    scene: Scene, instance_ids: frozenset[int], t: int, origin: Float64[np.ndarray, "3"]
) -> _SeedSurface | None:
    """All that cameras show of the region at t, relative to the origin, one Gaussian a cell."""
    parts = []
    for picture in _pictures(scene, instance_ids, t):
        pose = picture.cam_to_world.copy()
        pose[:3, 3] -= origin
        parts.append(
            lifted(
                LiftedImage(picture.rgb, picture.depth, picture.ids, picture.K, pose, picture.use)
            )
        )
    every = joined(parts) if parts else None
    return _SeedSurface(t, thinned(every, A_FRAME)) if every is not None and len(every) else None


def thinned(every: Gaussians, most: int) -> Gaussians:
    """One Gaussian a cell and side, that of the finest view; cells grow until at most `most` are left.

    A sheet has two sides, a cell apart or less, that light falls on differently.
    """
    every = chosen(every, np.argsort(every.scales[:, 1], kind="stable"))
    facing = normals(every.quats)
    main = np.abs(facing).argmax(1)
    side = 2 * main + (facing[np.arange(len(facing)), main] > 0)
    cell = float(np.quantile(every.scales[:, 1], 0.1)) / SPREAD
    while True:
        cells = np.concatenate([np.floor(every.means / cell).astype(np.int64), side[:, None]], 1)
        first = np.sort(np.unique(cells, axis=0, return_index=True)[1])
        if len(first) <= most:
            thin = chosen(every, first)
            wide = np.maximum(thin.scales[:, :2], SPREAD * cell)
            return Gaussians(
                thin.means, thin.quats, np.concatenate([wide, thin.scales[:, 2:]], 1),
                thin.opacities, thin.sh, thin.ids,
            )  # fmt: skip
        cell *= 1.2


def _velocities(
    surfaces: Sequence[_SeedSurface], spacing: float
) -> list[Float64[np.ndarray, "n 3"]]:
    """Metres per frame of every point: the mean of the ways from the frame before and to the frame after."""
    total = [np.zeros_like(s.points) for s in surfaces]
    count = [0] * len(surfaces)
    for forward in (True, False):
        order = range(len(surfaces)) if forward else range(len(surfaces) - 1, -1, -1)
        before: Float64[np.ndarray, 3] = np.zeros(3)
        for a, b in pairwise(order):
            here, there = surfaces[a], surfaces[b]
            frames = there.t - here.t
            guess = np.tile(before * frames, (len(here.points), 1))
            moved = (
                flow(here.points, here.colors, there.points, there.colors, guess, spacing) / frames
            )
            before = np.median(moved, 0)
            total[a] += moved
            count[a] += 1
    return [way / max(n, 1) for way, n in zip(total, count, strict=True)]
