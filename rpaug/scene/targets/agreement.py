"""Whether the cameras of a photographed scene agree on a thing that words or evidence told by its color.

Such an instance is a patch of one color in each camera. It may be part of what the image cuts off, and another camera
may show the same thing as something else: then an edit would change the half of it.
"""

from collections.abc import Collection

import numpy as np
from jaxtyping import Float

from rpaug.core import color_space
from rpaug.core.types import CameraView, Scene

SAME = 14.0  # CIELAB, lightness at half: what differs by less from a thing's color may be it
FEWEST = 8  # pixels
APART = ("robot", "table", "background")  # roles that a phrase means only by name


def photographed(scene: Scene) -> bool:
    """Are the scene's instances told by color alone?"""
    return any(view.proxy is not None for view in scene.episode.views.values())


def of_one_tint(scene: Scene, instance_id: int) -> bool:
    """Is an instance of a photographed scene told by its color alone, so that it has one tint? The surroundings have
    many, and so may what models outlined."""
    others = scene.roles.get("background", frozenset()).union(*scene.names.values())
    return photographed(scene) and instance_id not in others


def modelled(scene: Scene) -> bool:
    """Has every camera of a photographed scene that shows anything a depth that a model gave?"""
    proxies = [view.proxy for view in scene.episode.views.values()]
    return all(proxy is None or proxy.modelled or proxy.blank for proxy in proxies)


def apart(scene: Scene) -> frozenset[int]:
    """Instances that are robot, table or background, or may be."""
    held = [scene.roles.get(role, frozenset()) for role in APART]
    told = [one.instance_ids for role, one in scene.beliefs.items() if role in APART]
    return frozenset().union(*held, *(told if photographed(scene) else ()))


def dispute(scene: Scene, instance_ids: Collection[int], *, outlined: bool = False) -> str:
    """Why a photographed thing cannot be edited in all cameras alike; empty if nothing speaks against it.

    What models `outlined` is whole where an image's edge cuts it off, and in no camera part of table, background or
    another thing that they outlined; but they may have missed it among what is told by color.
    """
    known = apart(scene).union(*scene.names.values()) if outlined else frozenset[int]()
    views = {
        name: view
        for name, view in scene.episode.views.items()
        if view.ids is not None and view.proxy is not None and not view.proxy.blank
    }
    masks = {name: np.isin(_first(view), list(instance_ids)) for name, view in views.items()}
    for name, mask in masks.items():
        rim = int(mask[[0, -1]].sum() + mask[:, [0, -1]].sum())
        if mask.sum() >= FEWEST and rim >= 2 and not outlined:
            return f"the edge of {name} cuts it off: it may be part of something larger"
    seen = {name: mask for name, mask in masks.items() if mask.sum() >= FEWEST}
    if not seen:
        return ""
    colors = np.concatenate([views[name].rgb(0)[mask] for name, mask in seen.items()])
    middle = _lab(np.median(colors, 0))
    for name, view in views.items():
        near = np.linalg.norm(_lab(view.rgb(0)) - middle, axis=-1) < SAME
        there = _first(view)
        other = near & ~masks[name] & (there > 0) & ~np.isin(there, list(known))
        if name not in seen and other.sum() >= FEWEST:
            return f"{name} shows its color, and not it: there it may be part of something else"
    return ""


def _first(view: CameraView) -> np.ndarray:
    assert view.ids is not None
    return view.ids(0)


def _lab(rgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return color_space.to_lab(np.asarray(rgb) / 255.0) * np.array([0.5, 1.0, 1.0])
