"""What a thing's surface looks like: its recorded pixels as Gaussians, one a place, as if one camera had seen it."""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int, UInt8

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.sampling import frames
from rpaug.core.types import Gaussians, Scene
from rpaug.gaussians import gaussians, seeds
from rpaug.gaussians.gaussians import SPREAD, lifted

VIEWS = 6  # frames that a thing's surface is gathered from
MOST_SHOWN = 20_000  # Gaussians of a thing
LONGEST = 1.5  # times its width: a pixel seen at a grazing angle does not stick out of an outline
UNDER = 0.003  # metres behind the thing's own surface: what no camera could see at first
PATCH = 4  # pixels' width: what two cameras show of as large a patch is compared
FEW = 5  # patches


def surface(scene: Scene, instance_ids: frozenset[int]) -> Gaussians:
    """The thing's Gaussians in the world of the first frame: fitted ones, or its recorded pixels.

    Raises Unsupported for what was never seen with depth.
    """
    if scene.gaussians is not None:
        placed = gaussians.placed(scene, 0)
        mine = gaussians.chosen(placed, np.isin(placed.ids, list(instance_ids)))
        if len(mine):
            return replace(mine, frame_residuals={})
    found, views = _gathered(scene, instance_ids)
    shows = ~_inside(found, scene, instance_ids)
    if shows.any():
        found, views = gaussians.chosen(found, shows), views[shows]
    width = float(np.median(found.scales[:, 1])) / SPREAD
    thin = seeds.thinned(_evened(found, views, PATCH * width), MOST_SHOWN)
    scales = thin.scales.copy()
    scales[:, 0] = np.minimum(scales[:, 0], LONGEST * scales[:, 1])
    return replace(thin, scales=scales)


def _gathered(scene: Scene, instance_ids: frozenset[int]) -> tuple[Gaussians, Int[np.ndarray, "n"]]:
    """Pixels of all cameras over some frames, in the world of the first frame, and of which image each is."""
    found: list[Gaussians] = []
    views: list[int] = []
    motions = {h: body for body in scene.tracked for h in body.instance_ids & instance_ids}
    for t in frames(scene.episode.length, VIEWS):
        for number, view in enumerate(scene.episode.views.values()):
            picture = seeds.picture_of(view, t, instance_ids)
            if picture is None:
                continue
            part = lifted(replace(picture, rgb=_unmixed(picture.rgb, picture.use)))
            for instance_id, body in motions.items():
                mine = gaussians.chosen(part, part.ids == instance_id)
                if len(mine):
                    back = body.to_world[0] @ np.linalg.inv(body.to_world[t])
                    found.append(gaussians.moved(mine, back))
                    views += [t * len(scene.episode.views) + number] * len(mine)
    if not found:
        raise Unsupported(f"simulating {sorted(instance_ids)}: it was never seen with depth")
    return gaussians.joined(found), np.array(views)


def _unmixed(
    rgb: UInt8[np.ndarray, "h w 3"], use: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The image with pixels on the outline, which have some of the background in them, in the color just inside."""
    deep = cv2.erode(use.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    weight = cv2.boxFilter(deep.astype(np.float32), -1, (3, 3), normalize=False)[..., None]
    total = cv2.boxFilter(rgb * deep[..., None].astype(np.float32), -1, (3, 3), normalize=False)
    edge = (use & ~deep)[..., None] & (weight > 0.5)
    return np.where(edge, np.rint(total / np.maximum(weight, 1)), rgb).astype(np.uint8)


def _inside(found: Gaussians, scene: Scene, instance_ids: frozenset[int]) -> Bool[np.ndarray, "n"]:
    """Which points no camera can see for the thing itself while it is as at first: the inside of a drawer opened later.

    Beside a surface they would stick out of it.
    """
    hidden, seen = np.zeros(len(found), bool), np.zeros(len(found), bool)
    for t in frames(scene.episode.length, VIEWS):
        moved = [
            b.instance_ids for b in scene.tracked if not np.allclose(b.to_world[t], b.to_world[0])
        ]
        rows = np.flatnonzero(~np.isin(found.ids, list(frozenset().union(*moved))))
        points = found.means[rows].astype(float)
        for view in scene.episode.views.values():
            if view.depth is None or view.ids is None:
                continue
            camera = view.camera
            local = geometry.local_points(points, camera, t)
            v, u, within = geometry.in_image(local, camera.K, (camera.height, camera.width))
            u, v = u[within], v[within]
            behind = view.depth(t)[v, u] + UNDER < local[within, 2]
            seen[rows[within]] |= ~behind
            hidden[rows[within]] |= behind & np.isin(view.ids(t)[v, u], list(instance_ids))
    return hidden & ~seen


def _evened(every: Gaussians, views: Int[np.ndarray, "n"], patch: float) -> Gaussians:
    """The same surface in the tones of one image for each side that it faces.

    Cameras see a surface in different tones, and times do under a robot's shadow; where images overlap, each is
    shifted by how much it is off, in the median over patches, the one that shows most of that side.
    """
    _, image = np.unique(views, return_inverse=True)
    normals = _normals(every)
    side = np.abs(normals).argmax(1)
    side = 2 * side + (np.take_along_axis(normals, side[:, None], 1)[:, 0] > 0)
    rows = np.column_stack([np.floor(every.means / patch).astype(int), side, every.ids])
    keys, place = np.unique(rows, axis=0, return_inverse=True)
    place = place.ravel()
    count = np.zeros((image.max() + 1, len(keys)))
    total = np.zeros((*count.shape, 3))
    np.add.at(count, (image, place), 1)
    np.add.at(total, (image, place), every.sh[:, 0])
    mean = total / np.maximum(count, 1)[..., None]
    shift = np.zeros((len(count), 6, 3))
    for face in range(6):
        here = keys[:, 3] == face
        best = count[:, here].sum(1).argmax()
        for other in range(len(count)):
            both = here & (count[best] > 0) & (count[other] > 0)
            if both.sum() >= FEW:
                shift[other, face] = np.median(mean[best, both] - mean[other, both], axis=0)
    sh = every.sh.copy()
    sh[:, 0] += shift[image, side]
    return replace(every, sh=sh)


def _normals(every: Gaussians) -> Float64[np.ndarray, "n 3"]:
    """The thinnest axis of each Gaussian, the third as `lifted` makes them."""
    w, x, y, z = (every.quats / np.linalg.norm(every.quats, axis=1, keepdims=True)).T.astype(float)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], -1)
