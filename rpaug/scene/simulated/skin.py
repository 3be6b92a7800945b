"""What a thing's surface looks like: its recorded pixels as Gaussians, one a place, as if one camera had seen it."""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int

from rpaug.errors import Unsupported
from rpaug.scene.sampling import frames
from rpaug.scene.simulated.surroundings import clear
from rpaug.scene.splats import gaussians, seeds
from rpaug.scene.splats.gaussians import SPREAD, lifted
from rpaug.types import Gaussians, Scene

VIEWS = 6  # frames that a thing's surface is gathered from
MOST_SHOWN = 20_000  # Gaussians of a thing
LONGEST = 1.5  # times its width: a pixel seen at a grazing angle does not stick out of an outline
WIDER = 1.3  # times: neighbours that were kept may be nearly two places apart
PATCH = 4  # pixels' width: what two cameras show of as large a patch is compared
FEW = 5  # patches


def surface(scene: Scene, handles: frozenset[int]) -> Gaussians:
    """The thing's Gaussians in the world of the first frame: fitted ones, or its recorded pixels.

    Raises Unsupported for what was never seen with depth.
    """
    if scene.gaussians is not None:
        placed = gaussians.placed(scene, 0)
        mine = gaussians.chosen(placed, np.isin(placed.ids, list(handles)))
        if len(mine):
            return replace(mine, moments={})
    found, views, edges = _gathered(scene, handles)
    width = float(np.median(found.scales[:, 1])) / SPREAD
    found = _evened(found, views, PATCH * width)
    inner = gaussians.chosen(found, ~edges)
    rest = gaussians.chosen(found, edges)
    if len(inner) and len(rest):
        # A pixel on the outline has some of the background in it: only where nothing else was seen.
        apart = clear(rest.means.astype(float), inner.means.astype(float), width)
        rest = gaussians.chosen(rest, apart)
    thin = seeds.thinned(gaussians.joined([inner, rest]), MOST_SHOWN)
    scales = thin.scales.copy()
    scales[:, :2] *= WIDER
    scales[:, 0] = np.minimum(scales[:, 0], LONGEST * scales[:, 1])
    return replace(thin, scales=scales)


def _gathered(
    scene: Scene, handles: frozenset[int]
) -> tuple[Gaussians, Int[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Pixels of all cameras over some frames, in the world of the first frame; of which image each is, and whether it
    is on the thing's outline there."""
    found: list[Gaussians] = []
    views: list[int] = []
    edges: list[bool] = []
    motions = {h: body for body in scene.tracked for h in body.handles & handles}
    for t in frames(scene.episode.length, VIEWS):
        for number, view in enumerate(scene.episode.views.values()):
            picture = seeds.picture_of(view, t, handles)
            if picture is None:
                continue
            deep = cv2.erode(
                picture.use.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1
            ).astype(bool)
            for use, edge in ((deep, False), (picture.use & ~deep, True)):
                part = lifted(replace(picture, use=use))
                for handle, body in motions.items():
                    mine = gaussians.chosen(part, part.ids == handle)
                    if len(mine):
                        back = body.to_world[0] @ np.linalg.inv(body.to_world[t])
                        found.append(gaussians.moved(mine, back))
                        views += [t * len(scene.episode.views) + number] * len(mine)
                        edges += [edge] * len(mine)
    if not found:
        raise Unsupported(f"simulating {sorted(handles)}: it was never seen with depth")
    return gaussians.joined(found), np.array(views), np.array(edges)


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
