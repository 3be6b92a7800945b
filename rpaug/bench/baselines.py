"""What people do without a scene: nothing, a recolouring of the mask in CIELAB, jitter of the whole image."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.scene import colours
from rpaug.types import CameraView, Episode

STRENGTH, HUE = 0.3, 0.05  # torchvision's usual ColorJitter for robot policies


def lab(episode: Episode, old_to_new: Mapping[int | None, tuple[Any, Any]]) -> Episode:
    """Each handle's pixels take the new colour's a and b, their L scaled by new over old.

    The handle None stands for all pixels, whose a and b are shifted by new minus old.
    """

    def edit(view: CameraView, t: int) -> UInt8[np.ndarray, "h w 3"]:
        image = view.rgb(t).astype(np.float32) / 255
        for handle, (old, new) in old_to_new.items():
            if handle is None:
                image = _shifted(image, old, new, chroma=1.0)
            elif view.ids is not None and (mask := view.ids(t) == handle).any():
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


def _shifted(image: Any, old: Any, new: Any, chroma: float) -> Any:
    """L scaled by new over old; a and b the new colour's, with `chroma` of what set them apart from the old one's."""
    before, after = colours.to_lab(np.array(old)), colours.to_lab(np.array(new))
    pixels = colours.to_lab(image)
    pixels[..., 0] = np.clip(pixels[..., 0] * after[0] / max(before[0], 1.0), 0, 100)
    pixels[..., 1:] = after[1:] + chroma * (pixels[..., 1:] - before[1:])
    return np.clip(colours.from_lab(pixels), 0, 1)


def _quantised(image: Any) -> UInt8[np.ndarray, "h w 3"]:
    return np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)


def _mapped(episode: Episode, edit: Any) -> Episode:
    views = {name: replace(view, rgb=partial(edit, view)) for name, view in episode.views.items()}
    return replace(episode, views=views)
