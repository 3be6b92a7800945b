"""Whether the cameras of a photographed scene agree on a thing that words or evidence told by its color.

Such an instance is a patch of one color in each camera. It may be part of what the image cuts off, and another camera
may show the same thing as something else: then an edit would change the half of it.
"""

from collections.abc import Collection, Mapping
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float

from rpaug.core import color_space
from rpaug.core.types import CameraView, Scene

SAME = 14.0  # CIELAB, lightness at half: what differs by less from a thing's color may be it
LIKE = 20.0  # the same of a whole instance: a small one's color is mixed with that of what is around it
FEWEST = 8  # pixels
APART = ("robot", "table", "background")  # roles that a phrase means only by name


def photographed(scene: Scene) -> bool:
    """Are the scene's instances told by color alone?"""
    return any(view.proxy is not None for view in scene.episode.views.values())


def told(scene: Scene) -> bool:
    """Did rpaug tell the scene's things itself: in color images, or in a video?"""
    return photographed(scene) or scene.back is not None


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
    return frozenset().union(*(playing(scene, role) for role in APART))


def playing(scene: Scene, role: str) -> frozenset[int]:
    """Instances that have a role; in color images and videos, whose things rpaug told, also those that may have it."""
    held, doubted = scene.roles.get(role, frozenset()), scene.beliefs.get(role)
    if doubted is None or not told(scene):
        return held
    return held | doubted.instance_ids


def dispute(
    scene: Scene,
    instance_ids: Collection[int],
    *,
    outlined: bool = False,
    besides: Collection[int] = frozenset(),
) -> str:
    """Why a photographed thing that words or a role tell cannot be edited in all cameras alike; empty if nothing speaks
    against it. `besides` are instances that are edited as well.

    What models `outlined` is whole where an image's edge cuts it off, and in no camera part of table, background or
    another thing that they outlined; but they may have missed it among what is told by color.
    """
    known = apart(scene).union(*scene.names.values()) if outlined else frozenset[int]()
    cut = "" if outlined else cut_off(scene, instance_ids)
    return cut or split(scene, instance_ids, known, besides)


def cut_off(scene: Scene, instance_ids: Collection[int]) -> str:
    """Why a photographed thing may be part of a larger one: an image's edge cuts it off; empty where none does."""
    for name, mask in _seen(scene, instance_ids).items():
        if mask[[0, -1]].sum() + mask[:, [0, -1]].sum() >= 2:
            return f"the edge of {name} cuts it off: it may be part of something larger"
    return ""


def split(
    scene: Scene,
    instance_ids: Collection[int],
    known: Collection[int] = frozenset(),
    besides: Collection[int] = frozenset(),
) -> str:
    """Why a photographed instance is not known to be the same thing in all cameras that show it; empty if nothing
    speaks against it. `known` are instances that it is no part of, `besides` others that are edited as well."""
    seen = _seen(scene, instance_ids)
    if not seen:
        return ""
    known = frozenset(known).union(besides)
    for name, other in missed(scene, instance_ids, known, besides).items():
        it = "part of something else" if other is None else f"instance {other}"
        return f"{name} shows its color, and not it: there it may be {it}"
    alone = len(instance_ids) == 1 and not scene.roles.get("manipulated", frozenset()) & {
        *instance_ids
    }
    return _rival(scene, seen, apart(scene).union(instance_ids, known)) if alone else ""


def missed(
    scene: Scene,
    instance_ids: Collection[int],
    known: Collection[int] = frozenset(),
    besides: Collection[int] = frozenset(),
) -> dict[str, int | None]:
    """By camera that may show a photographed thing as something else: the instance that it is most like there, None
    where it may be part of one.

    An instance that stands beside the thing in another camera is not it; one of `besides` is edited if it is.
    """
    seen, views = _seen(scene, instance_ids), scene.episode.views
    if not seen:
        return {}
    colors = np.concatenate([views[name].rgb(0)[mask] for name, mask in seen.items()])
    middle = _lab(np.median(colors, 0))
    looks = [_look(views[name], mask)[0] for name, mask in seen.items()]
    told = apart(scene).union(known, *(_large(views[name]) for name in seen))
    found: dict[str, int | None] = {}
    for name, mask in _masks(scene, instance_ids).items():
        if name in seen:
            continue
        view, there = views[name], _first(views[name])
        near = np.linalg.norm(_lab(view.rgb(0)) - middle, axis=-1) < SAME
        other = near & ~mask & (there > 0) & ~np.isin(there, list(known))
        unlike = {
            one: min(np.linalg.norm(_look(view, there == one)[0] - look) for look in looks)
            for one in _large(view)
            if one in besides or one not in told
        }
        nearest = min(unlike, key=lambda one: unlike[one], default=None)
        if nearest is not None and unlike[nearest] < LIKE and nearest not in besides:
            found[name] = nearest
        elif other.sum() >= FEWEST:
            found[name] = None
    return found


def _rival(
    scene: Scene, seen: Mapping[str, Bool[np.ndarray, "h w"]], known: Collection[int]
) -> str:
    """Why another instance of one camera may as well be what another camera shows of it: a patch of one color is told
    from camera to camera by color and size alone."""
    for name, other in permutations(seen, 2):
        own = _look(scene.episode.views[name], seen[name])
        view = scene.episode.views[other]
        gap, there = _gap(own, _look(view, seen[other])), _first(view)
        for instance_id in sorted(_large(view).difference(known)):
            look = _look(view, there == instance_id)
            if np.linalg.norm(look[0] - own[0]) < SAME and _gap(own, look) <= gap:
                return (
                    f"instance {instance_id} of {other} is as much like what {name} shows of it: color and size do "
                    "not tell which of them it is"
                )
    return ""


def _look(view: CameraView, mask: Bool[np.ndarray, "h w"]) -> tuple[Float[np.ndarray, "3"], float]:
    """The middle color of a patch, and its share of the image."""
    return _lab(np.median(view.rgb(0)[mask], 0)), float(mask.mean())


def _gap(
    one: tuple[Float[np.ndarray, "3"], float], other: tuple[Float[np.ndarray, "3"], float]
) -> float:
    """How unlike two patches are, in color and size."""
    return float(np.linalg.norm(one[0] - other[0]) + abs(np.log(one[1] / other[1])))


def _masks(scene: Scene, instance_ids: Collection[int]) -> dict[str, Bool[np.ndarray, "h w"]]:
    """Where the cameras whose instances were told by color show some of them at first."""
    return {
        name: np.isin(_first(view), list(instance_ids))
        for name, view in scene.episode.views.items()
        if view.ids is not None and view.proxy is not None and not view.proxy.blank
    }


def _seen(scene: Scene, instance_ids: Collection[int]) -> dict[str, Bool[np.ndarray, "h w"]]:
    """The same of cameras that show more than a few pixels."""
    masks = _masks(scene, instance_ids)
    return {name: mask for name, mask in masks.items() if mask.sum() >= FEWEST}


def _large(view: CameraView) -> frozenset[int]:
    """Instances of which a camera shows more than a few pixels at first."""
    found = zip(*np.unique(_first(view), return_counts=True), strict=True)
    return frozenset(int(one) for one, count in found if one > 0 and count >= FEWEST)


def _first(view: CameraView) -> np.ndarray:
    assert view.ids is not None
    return view.ids(0)


def _lab(rgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return color_space.to_lab(np.asarray(rgb) / 255.0) * np.array([0.5, 1.0, 1.0])
