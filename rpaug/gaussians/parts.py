"""Parts that a recipe's targets ask for: told apart once, then known to every tier under instance ids of their own."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from threading import Lock

import numpy as np
from jaxtyping import Int32

from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import CameraView, Scene
from rpaug.gaussians.distil import PartPrompt, detected, tell_apart
from rpaug.gaussians.labels import LabelRenderer
from rpaug.gaussians.seeds import seeds
from rpaug.providers.detect import detector
from rpaug.providers.segment import segmenter
from rpaug.scene.targets import targets
from rpaug.scene.targets.targets import Target

Ids = Callable[[int], Int32[np.ndarray, "h w"]]


def given(scene: Scene, wanted: Sequence[Target]) -> Scene:
    """The scene in which each wanted target's part has the instance id `target.part.handle`, in masks as in Gaussians.

    A recorded pixel of the whole is the part's where most of its light comes from the part's Gaussians. A scene
    without Gaussians is lifted for the purpose and stays without. Raises TargetError where a part cannot be found,
    Unsupported without masks and depth.
    """
    for target in wanted:
        assert target.part is not None
        if target.part.instance_id not in scene.instance_ids:
            scene = _with_part(scene, target)
    return scene


def _with_part(scene: Scene, target: Target) -> Scene:
    part = target.part
    assert part is not None
    whole = targets.find(scene, target.model_copy(update={"part": None}))
    if part.camera not in scene.episode.views:
        known = ", ".join(scene.episode.views)
        raise TargetError(f"{target}: no camera is called {part.camera!r}; there are: {known}")
    if part.instance_id > min(view.most_id for view in scene.episode.views.values()):
        raise Unsupported(
            f"{target}: its part would be instance {part.instance_id}, which the masks cannot hold"
        )
    if part.frame >= scene.episode.length:
        raise TargetError(f"{target}: frame {part.frame} of {scene.episode.length}")
    if not all(view.depth and view.ids for view in scene.episode.views.values()):
        raise Unsupported(f"{target}: a part finer than the masks needs masks and depth")
    based = scene if scene.gaussians is not None else replace(scene, gaussians=seeds(scene))
    if part.box is not None:
        prompt = PartPrompt(part.camera, part.frame, part.box)
    else:
        assert part.words is not None
        assert part.detector is not None
        finder = detector(part.detector)
        prompt = detected(based, whole, part.words, finder, part.camera, part.frame)
    found = tell_apart(
        based, whole, prompt, segmenter(part.segmenter), instance_id=part.instance_id
    )
    if not found.finer:
        raise TargetError(f"{target}: the box is that of the whole target; leave `part` out")
    views = {
        name: _finer(found.scene, name, view, whole, part.instance_id)
        for name, view in scene.episode.views.items()
    }
    made = found.scene if scene.gaussians is not None else replace(found.scene, gaussians=None)
    return replace(made, episode=replace(scene.episode, views=views))


def _finer(
    scene: Scene, name: str, view: CameraView, whole: frozenset[int], instance_id: int
) -> CameraView:
    """The recorded view whose masks know the part."""
    assert view.ids is not None
    assert scene.gaussians is not None
    read: Ids = view.ids
    stage, lock = LabelRenderer(replace(scene, cameras={name: view.camera})), Lock()
    both = np.isin(scene.gaussians.ids, [instance_id, *whole])
    features = np.zeros((len(both), 16), np.float32)
    features[:, 0], features[:, 1] = scene.gaussians.ids == instance_id, both

    def ids(t: int) -> Int32[np.ndarray, "h w"]:
        recorded = read(t)
        inside = np.isin(recorded, list(whole))
        if not inside.any():
            return recorded
        with lock:  # a stage serves one thread at a time
            drawn = stage.draw(name, t, features).features
        assert drawn is not None
        return np.where(
            inside & (drawn[..., 0] > 0.5 * drawn[..., 1]), instance_id, recorded
        ).astype(np.int32)

    return replace(view, ids=ids)
