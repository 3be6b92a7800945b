"""What nobody ever saw behind edited bodies, painted once and shown alike to all cameras at all times.

What another camera or time saw of the background is no hole. The rest is painted in the view that shows most of it,
lifted to surfels, and drawn into the other views, where only what is still missing is painted in turn. Its depth
continues the surfaces around the hole; where one plane explains what is seen of a surface there, that very plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from rpaug.core import pixels
from rpaug.core.types import Camera
from rpaug.providers.inpaint import paint
from rpaug.render import holes, zbuffer
from rpaug.render.zbuffer import Rendered, Source
from rpaug.scene.recorded.plates import Plate, among

FEWEST = 2  # pixels: a hole smaller than this is left to the filling of single views
RING = 12  # pixels around a hole that tell the surfaces which it continues
MARGIN = 24  # pixels around a hole that its texture is painted from
EXPLAINED = 0.8  # share of a surface's pixels around a hole that lie on one plane, if it is one
QUICK = "smooth"  # what is painted in every frame: no wedges, a hundredth of the time of `fsr`
FLAT = 0.02  # of depth: so near to its plane lies a support whose depth was worked out from images
THROUGH = 1.15  # times the support's distance from which something is behind it
PASSES = 3  # of the plane's fit, each on what the last explains


@dataclass(frozen=True)
class Background:
    """One camera's background without the edited bodies, what they hid of it, and which pixels nobody saw."""

    camera: Camera
    drawn: Rendered
    behind: Bool[np.ndarray, "h w"]
    hole: Bool[np.ndarray, "h w"]


def patches(
    plates: dict[str, tuple[Camera, Plate]],
    others: Sequence[Source],
    edited: frozenset[int],
    method: str,
    tolerance: float,
) -> tuple[Source, ...]:
    """Surfels for what lies unseen behind the `edited` instance ids in the fixed cameras, painted by `method`.

    `others` are recordings of static things from other cameras, the edited ones left out.
    """
    found: list[Source] = []
    left = dict(plates)
    while left:
        views = {
            name: background(camera, plate, plates, (*others, *found), edited, tolerance)
            for name, (camera, plate) in left.items()
        }
        best = max(views, key=lambda name: int(views[name].hole.sum()))
        if views[best].hole.sum() < FEWEST:
            break
        found.append(zbuffer.lift(_painted(views[best], method, tolerance), tolerance))
        del left[best]
    return tuple(found)


def background(
    camera: Camera,
    plate: Plate,
    plates: dict[str, tuple[Camera, Plate]],
    others: Sequence[Source],
    edited: frozenset[int],
    tolerance: float,
    painted: int = 0,
) -> Background:
    """One fixed camera's background from all plates and the `others`; the last `painted` of those are no recordings."""

    def rest(one: Plate) -> Source:
        return replace(one.source, use=one.known & ~among(one.ids, edited))

    sources = [rest(plate), *(rest(one) for _, one in plates.values() if one is not plate), *others]
    drawn = zbuffer.render(
        camera.K, camera.cam_to_world[0], (camera.width, camera.height), sources,
        witness=plate.source, tolerance=tolerance,
    )  # fmt: skip
    behind = plate.known & among(plate.ids, edited)
    hole = drawn.hole | (drawn.source >= len(sources) - painted)
    return Background(camera, drawn, behind, hole & behind)


def _painted(view: Background, method: str, tolerance: float) -> Source:
    """The view's hole as a recording: depth and instance ids continued, colors painted thing by thing."""
    filled = holes.fill(view.drawn)
    known = ~view.drawn.hole & (view.drawn.depth > 0)
    depth = filled.depth.copy()
    rgb = filled.image
    for instance_id in np.unique(filled.ids[view.hole]).tolist():
        here = view.hole & (filled.ids == instance_id)
        around = pixels.grown(here, RING) & known & (filled.ids == instance_id)
        plane = _plane(depth, around, tolerance)
        if plane is not None:
            continued = _on(plane, here.shape)
            good = here & (continued > 0)
            depth[good] = 1 / continued[good]
        rgb = np.where(
            here[..., None], _texture(rgb, here, known & (filled.ids == instance_id), method), rgb
        )
    return Source(
        K=view.camera.K, cam_to_world=view.camera.cam_to_world[0], rgb=rgb, depth=depth,
        ids=filled.ids, use=view.hole, carved=True,
    )  # fmt: skip


def closed(
    drawn: Rendered, recorded: Int32[np.ndarray, "h w"], support: frozenset[int]
) -> tuple[Rendered, Bool[np.ndarray, "h w"]]:
    """A view with its support painted where, within the outline that its own image `recorded` shows of that, nothing or
    something far behind it is drawn; and where that is. Depth worked out from images leaves gaps in a table."""
    own = (drawn.source == 0) & among(recorded, support) & (drawn.depth > 0)
    plane = _plane(drawn.depth, own, FLAT)
    if plane is None:
        return drawn, np.zeros_like(own)
    outline, corners = np.zeros(own.shape, np.uint8), np.argwhere(own)[:, ::-1].astype(np.int32)
    cv2.fillConvexPoly(outline, cv2.convexHull(corners), 1)
    near = _on(plane, own.shape)
    through = drawn.hole | ((drawn.source != 0) & (near * drawn.depth > THROUGH))
    through &= (outline > 0) & (near > 0)
    if not through.any():
        return drawn, through
    shown = among(drawn.ids, support) & (drawn.depth > 0) & ~through
    rgb = _texture(drawn.image, through, shown, QUICK).astype(np.float32) / np.float32(255)
    most = np.bincount(drawn.ids[own]).argmax()
    return replace(
        drawn,
        rgb=np.where(through[..., None], rgb, drawn.rgb),
        depth=np.where(through, 1 / np.maximum(near, 1e-9), drawn.depth).astype(np.float32),
        ids=np.where(through, most, drawn.ids).astype(np.int32),
        hole=drawn.hole & ~through,
    ), through


def _plane(
    depth: Float32[np.ndarray, "h w"], around: Bool[np.ndarray, "h w"], tolerance: float
) -> Float64[np.ndarray, "3"] | None:
    """1/z = a x + b y + c of the pixels `around`, if most of them lie on one plane."""
    rows, columns = np.nonzero(around)
    if len(rows) < 6:
        return None
    near = 1 / depth[rows, columns].astype(np.float64)
    terms = np.stack([columns, rows, np.ones(len(rows))], -1).astype(np.float64)
    use = np.ones(len(rows), bool)
    for _ in range(PASSES):
        plane = np.linalg.lstsq(terms[use], near[use], rcond=None)[0]
        off = np.abs(terms @ plane - near) / near
        use = off <= max(tolerance, float(np.quantile(off, 0.5)))
    explained = float((np.abs(terms @ plane - near) <= tolerance * near).mean())
    return plane if explained >= EXPLAINED else None


def _on(plane: Float64[np.ndarray, "3"], shape: tuple[int, int]) -> Float64[np.ndarray, "h w"]:
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return plane[0] * columns + plane[1] * rows + plane[2]


def _texture(
    rgb: UInt8[np.ndarray, "h w 3"],
    hole: Bool[np.ndarray, "h w"],
    same: Bool[np.ndarray, "h w"],
    method: str,
) -> UInt8[np.ndarray, "h w 3"]:
    """The hole painted from what is seen of the same thing alone.

    Other things, and a frame around the image, take its nearest colors first, so that no hole lies at a border; and no
    color is painted that is not seen.
    """
    wide = [np.pad(plane, MARGIN) for plane in (hole, same)]
    rows, columns = np.nonzero(pixels.grown(wide[0], MARGIN))
    window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    gap, known = (plane[window] for plane in wide)
    if not known.any():
        return rgb
    colors = np.pad(rgb, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)))[window]
    painted = paint(method, pixels.filled(colors, known), gap)
    low, high = colors[known].min(0), colors[known].max(0)
    out = rgb.copy()
    out[hole] = np.clip(painted[gap], low, high)
    return out
