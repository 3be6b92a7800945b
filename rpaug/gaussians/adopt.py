"""Gaussians from elsewhere, taken into a scene: as all that it is made of, or as one more thing in it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Body, Gaussians, Scene
from rpaug.gaussians import ply
from rpaug.gaussians.gaussians import chosen, joined, moved
from rpaug.gaussians.labels import Labelled
from rpaug.gaussians.vote import vote


def adopted(scene: Scene, gaussians: Gaussians, t: int = 0) -> Scene:
    """The scene made of these Gaussians, given in its world as it stands at frame t.

    Gaussians without instance ids (all 0) get them by vote of the masks recorded at t; those of moving bodies are then
    carried into their bodies' frames. Drift and light of an earlier fit are dropped. Raises Unsupported if instance ids
    are missing and the episode has no masks.
    """
    bare = replace(scene, gaussians=gaussians, bodies=(), pose_correction={}, irradiance=None)
    if not gaussians.ids.any():
        pictures = [
            Labelled(name, t, view.ids(t))
            for name, view in scene.episode.views.items()
            if view.ids is not None
        ]
        if not pictures:
            raise Unsupported(
                "these Gaussians have no instance ids and the episode no masks to vote on"
            )
        gaussians = replace(gaussians, ids=vote(bare, pictures))
    parts, rest = [], np.ones(len(gaussians), bool)
    for body in scene.bodies:
        rows = np.isin(gaussians.ids, list(body.instance_ids))
        if rows.any() and (body.to_world != np.eye(4)).any():
            parts.append(moved(chosen(gaussians, rows), geometry.inverse(body.to_world[t])))
            rest &= ~rows
    whole = joined([chosen(gaussians, rest), *parts])
    return replace(scene, gaussians=whole, pose_correction={}, irradiance=None)


def added(
    scene: Scene,
    asset: Gaussians,
    pose: Float64[np.ndarray, "4 4"],
    instance_id: int | None = None,
) -> Scene:
    """The scene with one more thing: an asset's Gaussians, still, at `pose` in the world, under an instance id of
    its own.

    Without `instance_id` the next free one is taken. Higher harmonics are kept as they are, not turned. Raises
    TargetError for an instance id that is taken and Unsupported if the scene has no Gaussians.
    """
    if scene.gaussians is None:
        raise Unsupported("this scene has no Gaussians: rpaug fit, or --tier 3, makes them")
    taken = scene.instance_ids | set(np.unique(scene.gaussians.ids).tolist())
    number = max(taken, default=0) + 1 if instance_id is None else instance_id
    if number in taken:
        raise TargetError(f"instance id {number} is taken; {max(taken) + 1} is free")
    placed = moved(asset, pose)
    bands = max(scene.gaussians.sh.shape[1], placed.sh.shape[1])
    named = replace(placed, ids=np.full(len(placed), number, np.int32), sh=_bands(placed.sh, bands))
    before = replace(scene.gaussians, sh=_bands(scene.gaussians.sh, bands))
    still = np.tile(np.eye(4), (scene.episode.length, 1, 1))
    return replace(
        scene,
        gaussians=joined([before, named]),
        bodies=(*scene.bodies, Body(frozenset([number]), still, "static")),
    )


def from_ply(scene: Scene, path: Path, t: int = 0) -> Scene:
    """The scene made of a 3DGS file's Gaussians, which stand in its world at frame t. Raises BadInput."""
    return adopted(scene, ply.read(path), t)


def _bands(sh: np.ndarray, bands: int) -> np.ndarray:
    """Harmonics padded with zeros to more bands."""
    return np.pad(sh, ((0, 0), (0, bands - sh.shape[1]), (0, 0)))
