"""Static surfaces that an episode takes over from another one of the same place, where both recordings agree.

What stands still in front of cameras that stand still is the same in every episode of a place, but for what was
rearranged. So one episode, the *founder*, is fitted by itself; others *borrow* its static Gaussians, held as they
are, and fit only what disagrees or is missing.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

from rpaug.core import geometry
from rpaug.core.types import Camera, CameraView, Episode, Gaussians, Scene
from rpaug.gaussians.gaussian_view import plane_depth, sharp, view_of
from rpaug.gaussians.gaussians import chosen, joined
from rpaug.gaussians.seeds import seeds
from rpaug.gaussians.store import Borrowed
from rpaug.render.splat import Rasteriser, Splats
from rpaug.scene.recorded import surfels
from rpaug.scene.recorded.plates import Plate

SAME_DEPTH = 0.02  # of depth: nearer than that is one surface
ALIKE = 0.05  # of display color, mean over 3x3 pixels: the founder's fit shows its own plates to about 0.01
COVERED = 0.98  # of the light stopped: less is a gap to be filled
SMOOTH = (
    0.02  # of display color: borrowed Gaussians without their neighbours are darker at their rims
)
RIM = 2  # pixels around what disagrees where nothing is borrowed: Gaussians there reach over
PIXELS, METRES = 1e-3, 1e-5  # to which cameras of one place agree


def place(episode: Episode) -> str | None:
    """What tells a place: a hash of all cameras that stand still, by name; None if there is none to tell it by."""
    digest, found = hashlib.sha256(), False
    for name, view in sorted(episode.views.items()):
        camera = view.camera
        if camera.fixed and not camera.assumed:
            found = True
            pose = np.rint(camera.cam_to_world[0] / METRES).astype(np.int64)
            inside = np.rint(camera.K / PIXELS).astype(np.int64)
            digest.update(f"{name}\0{camera.width}x{camera.height}".encode())
            digest.update(pose.tobytes() + inside.tobytes())
    return digest.hexdigest()[:32] if found else None


def borrowed(scene: Scene, key: str, donor: Scene) -> Borrowed:
    """The founder's static Gaussians that what the fixed cameras recorded here confirms and nothing contradicts.

    `founder` is the other scene as fitted, stored under `key`. A camera confirms a Gaussian where its plate shows
    that surface in the color that the founder's render has; it contradicts one whose surface has another
    color here, or that it looks through. Instance ids are those of the plates, since they differ between episodes.
    """
    assert donor.gaussians is not None
    static = frozenset().union(*(b.instance_ids for b in donor.bodies if b.motion == "static"))
    rows = np.flatnonzero(np.isin(donor.gaussians.ids, list(static))).astype(np.int32)
    donated = chosen(donor.gaussians, rows)
    ids, refuted = np.zeros(len(rows), np.int32), np.zeros(len(rows), bool)
    for plate, camera in _plates(scene):
        good, _ = _agrees(donated, plate, camera, ALIKE)
        inner = cv2.erode(good.astype(np.uint8), np.ones((3, 3)), iterations=RIM) > 0
        seen = _Seen.of(donated.means, plate, camera)
        confirmed = seen.shown & inner[seen.r, seen.c]
        ids = np.where((ids == 0) & confirmed, plate.ids[seen.r, seen.c], ids)
        refuted |= seen.through | (seen.shown & ~good[seen.r, seen.c])
    kept = (ids != 0) & ~refuted
    mine = chosen(donated, kept)
    return Borrowed(
        key, rows[kept], replace(mine, ids=ids[kept].astype(np.int32), frame_residuals={})
    )


def begun(scene: Scene, donated: Borrowed) -> Gaussians:
    """What a fit starts from: the borrowed Gaussians, then seeds of all that they do not show."""
    own = seeds(scene)
    seen_at_all, gap = np.zeros(len(own), bool), np.zeros(len(own), bool)
    for plate, camera in _plates(scene):
        good, alpha = _agrees(donated.gaussians, plate, camera, SMOOTH)
        covered = good & (alpha > COVERED)
        seen = _Seen.of(own.means, plate, camera)
        mine = seen.shown & (plate.ids[seen.r, seen.c] == own.ids)
        seen_at_all |= mine
        gap |= mine & ~covered[seen.r, seen.c]
    still = frozenset().union(*(b.instance_ids for b in scene.bodies if b.motion == "static"))
    static = np.isin(own.ids, list(still))
    return joined([donated.gaussians, chosen(own, ~(static & seen_at_all & ~gap))])


@dataclass(frozen=True)
class _Seen:
    """Where points fall in a plate: pixel, whether it shows them, and whether it looks through them."""

    r: Int[np.ndarray, "n"]
    c: Int[np.ndarray, "n"]
    shown: Bool[np.ndarray, "n"]
    through: Bool[np.ndarray, "n"]

    @staticmethod
    def of(points: Float32[np.ndarray, "n 3"], plate: Plate, camera: Camera) -> "_Seen":
        local = geometry.local_points(points.astype(np.float64), camera, 0)
        r, c, inside = geometry.in_image(local, camera.K, (camera.height, camera.width))
        z, inside = local[:, 2], inside & plate.known[r, c]
        tolerance = SAME_DEPTH * z
        # Beside an outline the pixel next door may be the one that counts.
        nearest = cv2.erode(
            np.where(plate.known, plate.depth, 0).astype(np.float32), np.ones((3, 3))
        )
        return _Seen(
            r,
            c,
            inside & (np.abs(plate.depth[r, c] - z) < tolerance),
            inside & (z < nearest[r, c] - tolerance),
        )


def _agrees(
    gaussians: Gaussians, plate: Plate, camera: Camera, alike: float
) -> tuple[Bool[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Where a render of the Gaussians shows the plate's surface in its colors, and how much light they stop."""
    splats = Splats.of(gaussians)
    drawn = Rasteriser(sharp(splats)).forward(splats, view_of(camera, 0))
    depth = plane_depth(drawn, splats, camera, 0)
    known = plate.known & (depth > 0)
    near = np.abs(depth - plate.depth) < SAME_DEPTH * plate.depth
    off = np.abs(drawn.color - plate.rgb.astype(np.float32) / 255).max(-1)
    # Over the neighbours that are of one surface: single pixels are noise, and outlines are no contradiction.
    weight = cv2.blur((known & near).astype(np.float32), (3, 3))
    mean = cv2.blur(np.where(known & near, off, 0).astype(np.float32), (3, 3)) / np.maximum(
        weight, 1e-6
    )
    return known & near & (mean < alike), drawn.alpha


def _plates(scene: Scene) -> Iterator[tuple[Plate, Camera]]:
    for name, plate in surfels.plates_of(scene)[1].items():
        view: CameraView = scene.episode.views[name]
        yield plate, view.camera
