"""Tiers on the twin: views of truly moved cameras, which keep their own recording."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rpaug import twin
from rpaug.core.types import Scene
from rpaug.pipeline import speed_error
from rpaug.pipeline.left_out import Sight, sights
from rpaug.pipeline.speed_error import Method, Prepared, TierView
from rpaug.scene.build import build


def on_the_twin(task: str, seed: int, frames: int, every: int) -> tuple[Scene, list[Sight]]:
    """The scene as recorded, with bodies as rpaug tracks them, and views of truly moved cameras."""
    recorded = twin.perform(task, seed, frames=frames)
    moved = twin.perform(task, seed, frames=frames, factor="camera_pose")
    scene = build(recorded.episode, with_bodies=True)
    truths = {name: moved.episode.views[name] for name in moved.truth.bumps}
    cameras = {name: view.camera for name, view in truths.items()}
    there = replace(scene, cameras={**scene.cameras, **cameras})
    return scene, list(sights(there, truths, range(every // 2, frames, every)))


def unchanged(made: Prepared, sight: Sight) -> TierView:
    """The recorded image, as if the camera had stayed."""
    view = sight.scene.episode.views[sight.name]
    assert view.depth is not None
    depth = view.depth(sight.t)
    return TierView(view.rgb(sight.t), depth, np.zeros(depth.shape, bool))


METHODS: Mapping[str, Method] = {
    "recorded image unchanged": Method("0", unchanged),
    **speed_error.METHODS,
}
