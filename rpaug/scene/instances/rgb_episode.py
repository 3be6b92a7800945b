"""Scenes of color images alone: what an episode without depth and masks shows, told by color and motion.

Instance ids are found, never recorded, and a stage stands in for depth: both serve the scene, and neither is written.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int32

from rpaug.core.errors import Unsupported
from rpaug.core.types import Belief, Body, Camera, CameraView, Episode, ProxyGeometry
from rpaug.scene.instances import ground_plane, modelled_depth, rgb_things
from rpaug.scene.instances.found import FoundInstances
from rpaug.scene.instances.modelled_depth import StillCamera
from rpaug.scene.instances.outlined import Outlined
from rpaug.scene.instances.rgb_things import CameraInstanceMap

if TYPE_CHECKING:
    from rpaug.providers.depth import DepthModel

SURE = 0.6  # of roles that colors tell: nothing checks them by geometry
PLAIN = 0.9  # share of the surroundings that walls and a floor cover, from which color tells table and background
KEPT = 64  # labelled frames of one camera
UNTOLD = (
    "what was moved has its surroundings' colors, and nothing tells its outline where it rested: it is no target and "
    "is left alone; record depth or masks"
)


def lacking(episode: Episode) -> bool:
    """Is this an episode of several frames without any masks, and without depth in some camera?"""
    views = episode.views.values()
    unmasked = not any(view.ids for view in views)
    return unmasked and not all(view.depth for view in views) and episode.length > 1


def find(
    episode: Episode, depth: "DepthModel | None" = None, outlined: Outlined | None = None
) -> FoundInstances:
    """Look at a `lacking` episode. Every camera gets instance ids; one that stands still gets a stage too.

    With a model of `depth` it gets that instead; what models `outlined` are instances of their own. Raises Unsupported
    for several such cameras whose places are unknown.
    """
    seen = rgb_things.find(episode, outlined)
    views = {name: _view(episode, seen, name) for name in episode.views}
    if depth is not None:
        views |= _deep(episode, seen, views, depth)
    still = np.tile(np.eye(4), (episode.length, 1, 1))
    unsteady = seen.moving | seen.manipulated | (outlined.moved if outlined else frozenset())
    bodies = tuple(
        Body(
            frozenset([instance_id]),
            still,
            "unknown" if instance_id in unsteady else "static",
            ambiguous=instance_id in unsteady,
        )
        for instance_id in sorted(seen.instance_ids)
    )
    beliefs = _beliefs(seen)
    return FoundInstances(
        replace(episode, views=views),
        bodies,
        {role: belief.instance_ids for role, belief in beliefs.items() if belief.confidence},
        photographed=True,
        beliefs=beliefs,
    )


def _beliefs(seen: CameraInstanceMap) -> dict[str, Belief]:
    """Roles by color and motion; by the gripper where that closes. What it closes on and cannot be told from support
    or surroundings makes neither of them a target: an edit of the whole would change it."""
    reason = "told by color and by what changes: there is no depth"
    found = {name: Belief(one, SURE, (reason,)) for name, one in seen.roles.items()}
    held = seen.gripped
    if held.thing is not None and held.thing in seen.manipulated:
        reason = f"the gripper closes on it in all cameras that see its end, {100 * held.share:.0f} % of it at least"
        found["manipulated"] = Belief(seen.manipulated, max(SURE, held.share), (reason,))
    elif seen.manipulated & held.rivals:
        listed = ", ".join(str(one) for one in sorted(held.rivals))
        reason = f"the gripper closes where instances {listed} lie, and color does not tell which of them it moves"
        found["manipulated"] = Belief(seen.manipulated, 0.0, (reason,))
    plain = seen.plainness
    for role in ("table", "background"):
        if role not in found:
            continue
        if plain < PLAIN:
            reason = (
                f"color alone does not tell the {role} from what stands there, and that would be painted too: walls "
                f"and a floor of few colors are only {100 * plain:.0f} % of what is around; roles.yaml settles it "
                "(rpaug inspect --write-roles begins one), or record depth or masks"
            )
            found[role] = Belief(found[role].instance_ids, 0.0, (reason,))
        elif found[role].instance_ids & held.within:
            reason = f"the gripper closes on something that has the colors of the {role}, and would be edited with it"
            found[role] = Belief(found[role].instance_ids, 0.0, (reason,))
    return found


def assumptions(episode: Episode) -> tuple[str, ...]:
    """What was assumed about the cameras of an episode that `find` looked at; empty for any other."""
    given = [
        f"{name}: {sentence}"
        for name, view in episode.views.items()
        if view.proxy is not None
        for sentence in view.proxy.assumed
    ]
    return tuple(given)


def _view(episode: Episode, seen: CameraInstanceMap, name: str) -> CameraView:
    view, part = episode.views[name], seen.cameras[name]

    @lru_cache(KEPT)
    def ids(t: int) -> Int32[np.ndarray, "h w"]:
        return seen.ids(name, t, view.rgb(t))

    drop = part.backdrop
    if drop.dead:
        given = ("shows nothing, and nothing is put into it",)
        proxy = ProxyGeometry(view.camera, None, given, blank=True)
    elif not drop.still:
        proxy = ProxyGeometry(
            view.camera, None, ("moves, so that things in it are told by their color alone",)
        )
    else:
        support = np.isin(part.resting, list(seen.support))
        around = np.isin(part.resting, list(seen.background))
        made = ground_plane.of(view.camera, support, around)
        assumed = _assumed(view.camera, episode.length)
        unknown = (UNTOLD,) if part.came is not None else ()
        proxy = ProxyGeometry(
            view.camera, made.depth, (*assumed, *unknown), unknown="".join(unknown)
        )
        view = replace(view, camera=made.camera)
    return replace(view, ids=ids, inferred=True, proxy=proxy)


def _deep(
    episode: Episode, seen: CameraInstanceMap, views: Mapping[str, CameraView], model: "DepthModel"
) -> dict[str, CameraView]:
    """The views of cameras that stand still, with the depth that a model gives."""
    still = {
        name: view for name, view in views.items() if view.proxy and view.proxy.depth is not None
    }
    lost = [name for name in still if not episode.views[name].camera.placed]
    if len(still) > 1 and lost:
        raise Unsupported(
            f"a model of depth: nothing says where {', '.join(lost)} stand to one another: give cam_to_world for each "
            f"in cameras.yaml, or name the one camera to edit there (views: [{lost[0]}])"
        )
    return {name: _modelled(episode, seen, name, view, model) for name, view in still.items()}


def _modelled(
    episode: Episode, seen: CameraInstanceMap, name: str, view: CameraView, model: "DepthModel"
) -> CameraView:
    """The view with depth of a model, on the support's plane if the model knows no metres."""
    part, recorded = seen.cameras[name], episode.views[name].camera
    assert view.ids is not None
    assert view.proxy is not None
    still = StillCamera(
        view, episode.length, part.backdrop, part.resting, sorted(seen.support), view.ids
    )
    made = modelled_depth.of(still, model, recorded)
    support, scale = np.isin(part.resting, still.support), np.float32(1)
    away = float(np.median(made.resting[support] if support.any() else made.resting))
    if model.relative and not recorded.placed:
        scale = np.float32(ground_plane.DISTANCE / away)
    spread = made.spread * away * float(scale)
    placed = ground_plane.on(recorded, support, made.resting * scale)
    focal = [s for s in view.proxy.assumed if "level support" not in s]
    given = (*focal, _scale(recorded, model.relative), _sure(spread))
    proxy = ProxyGeometry(recorded, placed.depth, given, modelled=True, spread=spread)
    return replace(view, camera=placed.camera, depth=lambda t: made.at(t) * scale, proxy=proxy)


def _scale(camera: Camera, relative: bool) -> str:
    if camera.placed:
        return "depth guessed by a model, its scale by the support at z = 0"
    if relative:
        return f"depth guessed by a model, its scale by a support {ground_plane.DISTANCE:g} m away"
    return "depth guessed by a model, its scale by the model alone"


def _sure(spread: float) -> str:
    if spread == np.inf:
        return "no support tells how far that depth may be off"
    return f"that depth may be off by {1000 * spread:.0f} mm: so far are parts of the support that the rest of it tells"


def _assumed(camera: Camera, length: int) -> tuple[str, ...]:
    given = [f"instances are found by color, and by motion against the median of {length} frames"]
    if camera.assumed:
        given.append(
            f"focal length of {camera.K[0, 0]:.0f} px assumed; cameras.yaml takes K or field_of_view"
        )
    if camera.placed:
        given.append("the support is taken to be level and at z = 0 of the world its pose is in")
    else:
        given.append(
            f"taken to look down on a level support by {np.degrees(ground_plane.TILT):.0f} degrees, from "
            f"{ground_plane.DISTANCE:g} m; cameras.yaml takes cam_to_world, z up, the support at z = 0"
        )
    return tuple(given)
