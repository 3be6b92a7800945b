"""Identity encodings: sixteen learned numbers a Gaussian, and a linear head that tells instance ids from them.

Gaussian Grouping (Ye et al. 2023, arXiv 2312.00732), as RoboPearls uses it: cross-entropy between the drawn
encodings' softmax and 2D masks, plus the KL divergence between each Gaussian's and its neighbours' softmax.
Encodings do not depend on time. Geometry is held still.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from rpaug.core.types import Scene
from rpaug.gaussians.labels import UNKNOWN, Labelled, LabelRenderer, recorded

WIDTH = 16  # numbers an encoding has


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How encodings are learned; one of the `steps` looks at one picture."""

    steps: int = 300
    rate: float = 0.05  # Adam's, of encodings and head
    smoothness: float = 0.1  # weight of the KL term beside the cross-entropy
    neighbours: int = 5
    sampled: int = 1000  # Gaussians that the KL term looks at in one step


@dataclass(frozen=True)
class Identities:
    """What was learned: an encoding for each Gaussian, and the head, one row and one offset for each instance id."""

    encodings: Float32[np.ndarray, "n 16"]
    weight: Float32[np.ndarray, "c 16"]
    offset: Float32[np.ndarray, "c"]
    instance_ids: Int32[np.ndarray, "c"]

    def read(self, encodings: Float32[np.ndarray, "*n 16"]) -> Int32[np.ndarray, "*n"]:
        """The likeliest instance id of each encoding, drawn or a Gaussian's own."""
        return self.instance_ids[(encodings @ self.weight.T + self.offset).argmax(-1)]

    @property
    def ids(self) -> Int32[np.ndarray, "n"]:
        """The likeliest instance id of each Gaussian."""
        return self.read(self.encodings)


def learn(
    scene: Scene,
    pictures: Sequence[Labelled] | None = None,
    *,
    settings: Learning | None = None,
    seed: int = 0,
    stage: LabelRenderer | None = None,
) -> Identities:
    """Encodings and a head from masks (default: the recorded ones).

    Raises Unsupported without Gaussians or masks.
    """
    settings, stage = settings or Learning(), stage or LabelRenderer(scene)
    pictures = recorded(scene) if pictures is None else pictures
    assert scene.gaussians is not None
    found = np.unique(np.concatenate([np.unique(p.ids) for p in pictures]))
    instance_ids = found[found != UNKNOWN].astype(np.int32)
    rng = np.random.default_rng(seed)
    start = rng.normal(0, 0.1, (len(scene.gaussians), WIDTH)).astype(np.float32)
    head = rng.normal(0, WIDTH**-0.5, (len(instance_ids), WIDTH)).astype(np.float32)
    begun = Identities(start, head, np.zeros(len(instance_ids), np.float32), instance_ids)
    near = neighbours(scene.gaussians.means, settings.neighbours)
    return descend(begun, pictures, stage, near, settings=settings, rng=rng)


def descend(
    begun: Identities,
    pictures: Sequence[Labelled],
    stage: LabelRenderer,
    near: Int[np.ndarray, "n k"],
    *,
    settings: Learning,
    rng: np.random.Generator,
    rows: Int[np.ndarray, "m"] | None = None,
    head: Bool[np.ndarray, "c"] | None = None,
) -> Identities:
    """Lower cross-entropy and KL by Adam. With `rows` only those Gaussians' encodings move, and with `head` only
    those rows of the head; everything else comes back bit for bit."""
    rows = np.arange(len(begun.encodings)) if rows is None else rows
    encodings, weight, offset = (
        array.copy() for array in (begun.encodings, begun.weight, begun.offset)
    )
    free = np.ones(len(weight), np.float32) if head is None else head.astype(np.float32)
    own = encodings[rows]
    adam = _EncodingAdam([own, weight, offset])
    targets = [_classes(picture, begun.instance_ids) for picture in pictures]
    order: list[int] = []
    for step in range(settings.steps):
        order = order or rng.permutation(len(pictures)).tolist()
        at = order.pop()
        drawn = stage.draw(pictures[at].camera, pictures[at].t, encodings).features
        assert drawn is not None
        by_picture, by_weight, by_offset = entropy_pull(drawn, targets[at], weight, offset)
        pulled = stage.rasteriser.backward(features=by_picture).features
        assert pulled is not None
        by_own = pulled[rows]
        sample = rng.choice(len(rows), min(settings.sampled, len(rows)), replace=False)
        beside = encodings[near[rows[sample]]]
        by_sample, more_weight, more_offset = divergence_pull(own[sample], beside, weight, offset)
        by_own[sample] += settings.smoothness * by_sample
        by_weight = free[:, None] * (by_weight + settings.smoothness * more_weight)
        by_offset = free * (by_offset + settings.smoothness * more_offset)
        fall = 0.5 + 0.5 * np.cos(np.pi * step / settings.steps)
        adam.step([by_own, by_weight, by_offset], settings.rate * fall)
        encodings[rows] = own
    return Identities(encodings, weight, offset, begun.instance_ids)


class _EncodingAdam:
    """Adam (Kingma and Ba 2015, arXiv 1412.6980) on plain arrays, in place."""

    def __init__(self, values: Sequence[Float32[np.ndarray, "..."]]) -> None:
        self._values, self._steps = values, 0
        self._moments = [(np.zeros_like(value), np.zeros_like(value)) for value in values]

    def step(self, slopes: Sequence[Float32[np.ndarray, "..."]], rate: float) -> None:
        self._steps += 1
        late = np.sqrt(1 - 0.99**self._steps) / (1 - 0.9**self._steps)
        for value, slope, (first, second) in zip(self._values, slopes, self._moments, strict=True):
            first += np.float32(0.1) * (slope - first)
            second += np.float32(0.01) * (slope * slope - second)
            value -= np.float32(rate * late) * first / (np.sqrt(second) + np.float32(1e-15))


def entropy_pull(
    drawn: Float32[np.ndarray, "h w 16"],
    classes: Int[np.ndarray, "h w"],
    weight: Float32[np.ndarray, "c 16"],
    offset: Float32[np.ndarray, "c"],
) -> tuple[Float32[np.ndarray, "h w 16"], Float32[np.ndarray, "c 16"], Float32[np.ndarray, "c"]]:
    """Gradients of the mean cross-entropy over pixels of a class >= 0, by the drawn encodings and by the head."""
    known = classes >= 0
    features = drawn[known]
    slope = np.exp(_log_softmax(features @ weight.T + offset))
    slope[np.arange(len(slope)), classes[known]] -= 1
    slope /= max(len(slope), 1)
    out = np.zeros_like(drawn)
    out[known] = slope @ weight
    return out, slope.T @ features, slope.sum(0)


def divergence_pull(
    own: Float32[np.ndarray, "m 16"],
    beside: Float32[np.ndarray, "m k 16"],
    weight: Float32[np.ndarray, "c 16"],
    offset: Float32[np.ndarray, "c"],
) -> tuple[Float32[np.ndarray, "m 16"], Float32[np.ndarray, "c 16"], Float32[np.ndarray, "c"]]:
    """Gradients of the mean of KL(F(e_j) || F(e_i)) over Gaussians j and their neighbours i, F the head's softmax.

    The 3D term of RoboPearls' semantic loss (arXiv 2506.22756). The neighbours' side is held still.
    """
    here = _log_softmax(own @ weight.T + offset)
    there = _log_softmax(beside @ weight.T + offset).mean(1)
    share = np.exp(here)
    gap = share * (here - there)
    slope = (gap - share * gap.sum(-1, keepdims=True)) / max(len(own), 1)
    return slope @ weight, slope.T @ own, slope.sum(0)


def _log_softmax(logits: Float32[np.ndarray, "*n c"]) -> Float32[np.ndarray, "*n c"]:
    logits = logits - logits.max(-1, keepdims=True)
    return logits - np.log(np.exp(logits).sum(-1, keepdims=True))


def neighbours(means: Float32[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, "n k"]:
    """The `count` nearest others of each Gaussian, exactly, by their means as they are given."""
    points = np.ascontiguousarray(means, np.float32)
    most = min(count + 1, len(points))
    index = cv2.flann.Index(points, {"algorithm": 4})  # one k-d tree: exact
    found = index.knnSearch(points, most, params={})[0]
    return found[:, 1:] if most > 1 else found


def _classes(picture: Labelled, instance_ids: Int32[np.ndarray, "c"]) -> Int[np.ndarray, "h w"]:
    """The row of each pixel's instance id, -1 for one that is not there."""
    at = np.clip(np.searchsorted(instance_ids, picture.ids), 0, len(instance_ids) - 1)
    return np.where(instance_ids[at] == picture.ids, at, -1).astype(np.int64)


def identity_mask(
    identities: Identities, stage: LabelRenderer, camera: str, t: int
) -> Int32[np.ndarray, "h w"]:
    """The likeliest instance id of each pixel, from the drawn encodings; 0 where less than half is covered."""
    drawn = stage.draw(camera, t, identities.encodings)
    assert drawn.features is not None
    return np.where(drawn.alpha >= 0.5, identities.read(drawn.features), 0).astype(np.int32)
