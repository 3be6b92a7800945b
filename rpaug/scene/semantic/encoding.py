"""Identity encodings: sixteen learned numbers a Gaussian, and a linear head that tells handles from them.

Gaussian Grouping (Ye et al. 2023, arXiv 2312.00732), as RoboPearls uses it: cross-entropy between the drawn
encodings' softmax and 2D masks, plus the KL divergence between each Gaussian's and its neighbours' softmax.
Encodings do not depend on time. Geometry is held still.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float32, Int, Int32
from torch import Tensor
from torch.nn import functional

from rpaug.scene.semantic.labels import UNKNOWN, Labelled, Stage, recorded
from rpaug.types import Scene

WIDTH = 16  # numbers an encoding has


@dataclass(frozen=True, kw_only=True)
class Learning:
    """How encodings are learned; one of the `steps` looks at one picture."""

    steps: int = 300
    rate: float = 0.05  # Adam's, of encodings and head
    smoothness: float = 1.0  # weight of the KL term beside the cross-entropy
    neighbours: int = 5
    sampled: int = 1000  # Gaussians that the KL term looks at in one step


@dataclass(frozen=True)
class Identities:
    """What was learned: an encoding for each Gaussian, and the head, one row and one offset for each handle."""

    encodings: Float32[np.ndarray, "n 16"]
    weight: Float32[np.ndarray, "c 16"]
    offset: Float32[np.ndarray, "c"]
    handles: Int32[np.ndarray, "c"]

    def read(self, encodings: Float32[np.ndarray, "*n 16"]) -> Int32[np.ndarray, "*n"]:
        """The likeliest handle of each encoding, drawn or a Gaussian's own."""
        return self.handles[(encodings @ self.weight.T + self.offset).argmax(-1)]

    @property
    def ids(self) -> Int32[np.ndarray, "n"]:
        """The likeliest handle of each Gaussian."""
        return self.read(self.encodings)


def learn(
    scene: Scene,
    pictures: Sequence[Labelled] | None = None,
    *,
    settings: Learning | None = None,
    seed: int = 0,
    stage: Stage | None = None,
) -> Identities:
    """Encodings and a head from masks (default: the recorded ones).

    Raises Unsupported without Gaussians or masks.
    """
    settings, stage = settings or Learning(), stage or Stage(scene)
    pictures = recorded(scene) if pictures is None else pictures
    assert scene.gaussians is not None
    found = np.unique(np.concatenate([np.unique(p.ids) for p in pictures]))
    handles = found[found != UNKNOWN].astype(np.int32)
    rng = np.random.default_rng(seed)
    start = rng.normal(0, 0.1, (len(scene.gaussians), WIDTH)).astype(np.float32)
    head = rng.normal(0, WIDTH**-0.5, (len(handles), WIDTH)).astype(np.float32)
    begun = Identities(start, head, np.zeros(len(handles), np.float32), handles)
    near = neighbours(scene.gaussians.means, settings.neighbours)
    return descend(begun, pictures, stage, near, settings=settings, rng=rng)


def descend(
    begun: Identities,
    pictures: Sequence[Labelled],
    stage: Stage,
    near: Int[np.ndarray, "n k"],
    *,
    settings: Learning,
    rng: np.random.Generator,
    rows: Int[np.ndarray, "m"] | None = None,
    head: Bool[np.ndarray, "c"] | None = None,
) -> Identities:
    """Lower cross-entropy and KL by Adam. With `rows` only those Gaussians' encodings move, and with `head` only
    those rows of the head; everything else comes back bit for bit."""
    moved = np.arange(len(begun.encodings)) if rows is None else rows
    whole = torch.tensor(begun.encodings)
    own = whole[moved].clone().requires_grad_()
    weight = torch.tensor(begun.weight, requires_grad=True)
    offset = torch.tensor(begun.offset, requires_grad=True)
    free = torch.ones(len(begun.handles)) if head is None else torch.tensor(head, dtype=torch.float)
    descent = torch.optim.Adam([own, weight, offset], lr=settings.rate, betas=(0.9, 0.99))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(descent, settings.steps)
    targets = [torch.tensor(_classes(picture, begun.handles)) for picture in pictures]
    order: list[int] = []
    for _ in range(settings.steps):
        order = order or rng.permutation(len(pictures)).tolist()
        at = order.pop()
        with torch.no_grad():
            whole[moved] = own
        drawn = stage.draw(pictures[at].camera, pictures[at].t, whole.numpy()).features
        picture = torch.tensor(drawn, requires_grad=True)
        entropy = functional.cross_entropy(
            (picture @ weight.T + offset).flatten(0, 1), targets[at].flatten(), ignore_index=-1
        )
        sample = torch.as_tensor(rng.choice(len(moved), min(settings.sampled, len(moved)), False))
        gap = _divergence(own, whole, moved, sample, near, weight, offset)
        descent.zero_grad()
        (entropy + settings.smoothness * gap).backward()
        assert picture.grad is not None
        pulled = stage.rasteriser.backward(features=picture.grad.numpy()).features
        assert pulled is not None
        assert own.grad is not None
        own.grad += torch.as_tensor(pulled[moved])
        for part in (weight, offset):
            assert part.grad is not None
            part.grad *= free.reshape(-1, *([1] * (part.dim() - 1)))
        descent.step()
        schedule.step()
    with torch.no_grad():
        whole[moved] = own
    return Identities(
        whole.numpy(), weight.detach().numpy(), offset.detach().numpy(), begun.handles
    )


def _divergence(
    own: Tensor,
    whole: Tensor,
    moved: Int[np.ndarray, "m"],
    sample: Tensor,
    near: Int[np.ndarray, "n k"],
    weight: Tensor,
    offset: Tensor,
) -> Tensor:
    """Mean over sampled Gaussians j and neighbours i of KL(F(e_j) || F(e_i)), F the head's softmax.

    RoboPearls (arXiv 2506.22756), the 3D term of its semantic loss. Neighbours are held still.
    """
    beside = whole[torch.as_tensor(near[moved[sample.numpy()]])].detach()
    here = functional.log_softmax(own[sample] @ weight.T + offset, -1)
    there = functional.log_softmax(beside @ weight.T + offset, -1)
    return (here.exp()[:, None] * (here[:, None] - there)).sum(-1).mean()


def neighbours(means: Float32[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, "n k"]:
    """The `count` nearest others of each Gaussian, exactly, by their means as they are given."""
    points = np.ascontiguousarray(means, np.float32)
    most = min(count + 1, len(points))
    index = cv2.flann.Index(points, {"algorithm": 4})  # one k-d tree: exact
    found = index.knnSearch(points, most, params={})[0]
    return found[:, 1:] if most > 1 else found


def _classes(picture: Labelled, handles: Int32[np.ndarray, "c"]) -> Int[np.ndarray, "h w"]:
    """The row of each pixel's handle, -1 for one that is not there."""
    at = np.clip(np.searchsorted(handles, picture.ids), 0, len(handles) - 1)
    return np.where(handles[at] == picture.ids, at, -1).astype(np.int64)


def identity_mask(
    identities: Identities, stage: Stage, camera: str, t: int
) -> Int32[np.ndarray, "h w"]:
    """The likeliest handle of each pixel, from the drawn encodings; 0 where less than half is covered."""
    drawn = stage.draw(camera, t, identities.encodings)
    assert drawn.features is not None
    return np.where(drawn.alpha >= 0.5, identities.read(drawn.features), 0).astype(np.int32)
