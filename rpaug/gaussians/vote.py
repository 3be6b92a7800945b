"""Labels for Gaussians by one weighted vote of all pixels: no training, no rounds.

With the geometry fixed a drawn label is a linear function of the Gaussians' labels, so the best label of each
Gaussian is the one that most of its blending weight falls on (FlashSplat, arXiv 2409.08270, eq. 6).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64, Int32

from rpaug.core.errors import Unsupported
from rpaug.core.types import Body, Scene
from rpaug.gaussians.ids_by_weight import CHANNELS, marks
from rpaug.gaussians.labels import UNKNOWN, Labelled, LabelRenderer, recorded

SEEN = 1e-3  # pixels: a Gaussian with less weight than this over all pictures keeps its label


def ballots(
    scene: Scene, pictures: Sequence[Labelled], stage: LabelRenderer | None = None
) -> tuple[Int32[np.ndarray, "c"], Float64[np.ndarray, "n c"]]:
    """The labels that occur, ascending, and how many pixels' worth of each fell on every Gaussian.

    The weight of Gaussian i at pixel p is its blending weight a_i T_i there. That is the derivative of the drawn
    feature by the Gaussian's, so the sums come out of the rasteriser's backward pass.
    """
    stage = stage or LabelRenderer(scene)
    assert scene.gaussians is not None
    found = [np.unique(picture.ids) for picture in pictures]
    labels = np.unique(np.concatenate([*found, np.zeros(0, np.int32)]))
    labels = labels[labels != UNKNOWN].astype(np.int32)
    count = np.zeros((len(scene.gaussians), len(labels)))
    blank = np.zeros((len(scene.gaussians), CHANNELS), np.float32)
    for picture, own in zip(pictures, found, strict=True):
        drawn = stage.draw(picture.camera, picture.t, blank)
        if drawn.alpha.shape != picture.ids.shape:
            raise Unsupported(
                f"labels of {picture.camera} are {picture.ids.shape}; its images are {drawn.alpha.shape}"
            )
        own = own[own != UNKNOWN]
        for start in range(0, len(own), CHANNELS):
            some = own[start : start + CHANNELS]
            gradients = stage.rasteriser.backward(features=marks(picture.ids, some))
            assert gradients.features is not None
            count[:, np.searchsorted(labels, some)] += gradients.features[:, : len(some)]
    return labels, count


def vote(
    scene: Scene, pictures: Sequence[Labelled] | None = None, stage: LabelRenderer | None = None
) -> Int32[np.ndarray, "n"]:
    """The instance id of each Gaussian by the masks (default: the recorded ones); one that no pixel shows keeps its
    own.

    A Gaussian moves with its body, so it can only take instance ids that move alike: none bleeds over time.

    Raises Unsupported without Gaussians or masks.
    """
    labels, count = ballots(scene, recorded(scene) if pictures is None else pictures, stage)
    assert scene.gaussians is not None
    if not len(labels):
        return scene.gaussians.ids.copy()
    count = np.where(_along(scene, scene.gaussians.ids, labels), count, 0.0)
    shown = count.sum(-1) > SEEN
    return np.where(shown, labels[count.argmax(-1)], scene.gaussians.ids).astype(np.int32)


def _along(
    scene: Scene, ids: Int32[np.ndarray, "n"], labels: Int32[np.ndarray, "c"]
) -> Bool[np.ndarray, "n c"]:
    """Whether each label moves as the Gaussian does: else it would be wrong as soon as the two part."""
    moving = [body for body in scene.bodies if (body.to_world != np.eye(4)).any()]
    tracks: list[np.ndarray] = []

    def track(body: Body) -> int:
        for k, known in enumerate(tracks):
            if np.array_equal(known, body.to_world):
                return k + 1
        tracks.append(body.to_world)
        return len(tracks)

    number = {instance_id: track(body) for body in moving for instance_id in body.instance_ids}
    ways, inverse = np.unique(ids, return_inverse=True)
    own = np.array([number.get(int(instance_id), 0) for instance_id in ways])[inverse]
    theirs = np.array([number.get(int(label), 0) for label in labels])
    return own[:, None] == theirs


def assigned(scene: Scene) -> Scene:
    """The scene with its Gaussians' instance ids by vote. A Gaussian stays in the frame in which it was given."""
    ids = vote(scene)
    assert scene.gaussians is not None
    return replace(scene, gaussians=replace(scene.gaussians, ids=ids))
