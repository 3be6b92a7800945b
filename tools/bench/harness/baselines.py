"""What people do without a scene: nothing, colors in the mask or the whole image, pictures painted, scaled, pasted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, Int32, UInt8

from rpaug.core import color_space
from rpaug.core.pixels import filled
from rpaug.core.types import CameraView, Episode, Mesh
from rpaug.providers import inpaint
from rpaug.render import mesh as triangles
from rpaug.twin.look import Extra

FINE = 8000.0  # steps to a metre in which depth is inpainted
STRENGTH, HUE = 0.3, 0.05  # torchvision's usual ColorJitter for robot policies


def lab(episode: Episode, old_to_new: Mapping[int | None, tuple[Any, Any]]) -> Episode:
    """Each instance id's pixels take the new color's a and b, their L scaled by new over old.

    The instance id None stands for all pixels, whose a and b are shifted by new minus old.
    """

    def edit(view: CameraView, t: int) -> UInt8[np.ndarray, "h w 3"]:
        image = view.rgb(t).astype(np.float32) / 255
        for instance_id, (old, new) in old_to_new.items():
            if instance_id is None:
                image = _shifted(image, old, new, chroma=1.0)
            elif view.ids is not None and (mask := view.ids(t) == instance_id).any():
                image[mask] = _shifted(image[mask], old, new, chroma=0.0)
        return _quantised(image)

    return _mapped(episode, edit)


def jitter(episode: Episode, seed: int) -> Episode:
    """Brightness, contrast, saturation and hue of all images moved by one draw."""
    rng = np.random.default_rng(seed)
    bright, contrast, saturation = rng.uniform(1 - STRENGTH, 1 + STRENGTH, 3)
    hue = rng.uniform(-HUE, HUE)

    def edit(view: CameraView, t: int) -> UInt8[np.ndarray, "h w 3"]:
        image = np.clip(view.rgb(t).astype(np.float32) / 255 * np.float32(bright), 0, 1)
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        image = np.clip(contrast * image + (1 - contrast) * grey.mean(), 0, 1)
        image = np.clip(saturation * image + (1 - saturation) * grey[..., None], 0, 1)
        hsv = cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2HSV)
        hsv[..., 0] = (hsv[..., 0] + 360 * hue) % 360
        return _quantised(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB))

    return _mapped(episode, edit)


def painted(episode: Episode, gone: frozenset[int]) -> Episode:
    """Each picture's masks of these instance ids inpainted by themselves, color and depth; instance ids from
    beside.
    """
    return _each(episode, lambda view, t: _painted(_planes(view, t), gone))


def scaled(episode: Episode, instance_id: int, scale: float) -> Episode:
    """The instance id's pixels scaled in each picture about the middle of their lower edge, over the picture
    inpainted.
    """

    def edit(view: CameraView, t: int) -> Planes:
        rgb, depth, ids = _planes(view, t)
        behind = _painted((rgb, depth, ids), frozenset({instance_id}))
        rows, columns = np.nonzero(ids == instance_id)
        if not len(rows):
            return rgb, depth, ids
        foot, middle = float(rows.max()) + 0.5, (float(columns.min()) + float(columns.max())) / 2
        height, width = ids.shape
        y, x = np.mgrid[:height, :width].astype(float)
        i = np.rint(foot + (y - foot) / scale).astype(int).clip(0, height - 1)
        j = np.rint(middle + (x - middle) / scale).astype(int).clip(0, width - 1)
        here = ids[i, j] == instance_id
        return (
            np.where(here[..., None], rgb[i, j], behind[0]),
            np.where(here, depth[i, j], behind[1]),
            np.where(here, ids[i, j], behind[2]),
        )

    return _each(episode, edit)


def pasted(episode: Episode, extras: Sequence[Extra]) -> Episode:
    """Things drawn where they truly stand, in the colors they come in, over whatever is there."""

    def edit(view: CameraView, t: int) -> Planes:
        rgb, depth, ids = (plane.copy() for plane in _planes(view, t))
        for extra in extras:
            mesh = Mesh(extra.points, extra.normals, extra.uv, extra.faces, extra.image)
            camera = view.camera
            size = camera.width, camera.height
            seen = triangles.draw(mesh, extra.pose, camera.K, camera.cam_to_world[t], size)
            rgb[seen.hit] = _quantised(seen.albedo[seen.hit])
            depth[seen.hit], ids[seen.hit] = seen.depth[seen.hit], extra.handle
        return rgb, depth, ids

    return _each(episode, edit)


Planes = tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]


def _planes(view: CameraView, t: int) -> Planes:
    assert view.depth is not None
    assert view.ids is not None
    return view.rgb(t), view.depth(t), view.ids(t)


def _painted(planes: Planes, gone: frozenset[int]) -> Planes:
    rgb, depth, ids = planes
    hole = np.isin(ids, list(gone))
    if not hole.any() or hole.all():
        return planes
    fine = np.clip(depth * FINE, 0, 65535).astype(np.uint16)
    near = cv2.inpaint(fine, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA).astype(np.float32) / FINE
    return inpaint.paint("fsr", rgb, hole), np.where(hole, near, depth), filled(ids, ~hole)


def _each(episode: Episode, edit: Callable[[CameraView, int], Planes]) -> Episode:
    def changed(view: CameraView) -> CameraView:
        made = lru_cache(2)(partial(edit, view))
        return replace(
            view,
            rgb=lambda t: made(t)[0],
            depth=lambda t: made(t)[1],
            ids=lambda t: made(t)[2],
        )

    return replace(episode, views={name: changed(view) for name, view in episode.views.items()})


def _shifted(image: Any, old: Any, new: Any, chroma: float) -> Any:
    """L scaled by new over old; a and b the new color's, with `chroma` of what set them apart from the old one's."""
    before, after = color_space.to_lab(np.array(old)), color_space.to_lab(np.array(new))
    pixels = color_space.to_lab(image)
    pixels[..., 0] = np.clip(pixels[..., 0] * after[0] / max(before[0], 1.0), 0, 100)
    pixels[..., 1:] = after[1:] + chroma * (pixels[..., 1:] - before[1:])
    return np.clip(color_space.from_lab(pixels), 0, 1)


def _quantised(image: Any) -> UInt8[np.ndarray, "h w 3"]:
    return np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)


def _mapped(episode: Episode, edit: Any) -> Episode:
    views = {name: replace(view, rgb=partial(edit, view)) for name, view in episode.views.items()}
    return replace(episode, views=views)
