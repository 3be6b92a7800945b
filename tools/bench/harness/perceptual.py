"""How far an edit is from the truth to a network's eye: VGG16, LPIPS and CLIP, each where its weights are at hand."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn import functional

from rpaug.core.errors import BadInput
from rpaug.core.types import Episode
from rpaug.providers import features
from rpaug.providers.clip import Clip
from rpaug.twin import Take
from tools.bench.harness import scores

LAYERS = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")
LEAST = 32  # pixels a side of what VGG16 is shown: two cells of its last block
HIGHER = frozenset({"clip"})


@dataclass(frozen=True, kw_only=True)
class Eyes:
    """Where weights lie; None leaves a figure out. `vgg` is a state dict in torchvision's layout.

    `lpips` is a state dict of LPIPS' linear heads for VGG16 (`linK.model.1.weight`); the trunk comes from the same
    file if it holds one (`net.sliceK.N.weight`), else from `vgg`, which must then be ImageNet's. `clip` is a folder.
    """

    vgg: str | None = None
    lpips: str | None = None
    clip: str | None = None

    def open(self) -> "PerceptualMetrics":
        """Load what there is. Raises BadInput or MissingExtra for what was named and cannot be used."""
        network = features.load(Path(self.vgg)) if self.vgg else None
        heads = _lpips(Path(self.lpips), network) if self.lpips else None
        clip = Clip.load(Path(self.clip)) if self.clip else None
        return PerceptualMetrics(network, heads, clip)


@dataclass(frozen=True)
class Lpips:
    """LPIPS' trunk and the weight of each channel of `LAYERS` (Zhang et al. 2018, arXiv 1801.03924, `lin`)."""

    trunk: features.VGG16
    heads: Mapping[str, Tensor]


@dataclass(frozen=True)
class PerceptualMetrics:
    """Figures of one episode. `vgg` and `lpips` are distances, `clip` is a cosine, 1 for the same picture.

    Each camera is looked at once, two thirds through the episode, where something has moved. `vgg` is taken over the
    changed region, `lpips` and `clip` over the whole picture, as published. Cameras that nothing changed in are left
    out.
    """

    vgg: features.VGG16 | None = None
    lpips: Lpips | None = None
    clip: Clip | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """What is measured, in order."""
        return tuple(name for name in ("vgg", "lpips", "clip") if getattr(self, name) is not None)

    def measure(
        self, recorded: Take, edited: Episode, true: Take, antialias: bool
    ) -> dict[str, float]:
        """The mean of each figure over the cameras; nan where nothing changed."""
        found: dict[str, list[float]] = {name: [] for name in self.names}
        for image, goal, inside in _pairs(recorded, edited, true, antialias):
            if self.vgg:
                found["vgg"].append(_within(self.vgg, image, goal, inside))
            if self.lpips:
                found["lpips"].append(self._lpips(image, goal))
            if self.clip:
                found["clip"].append(float(self.clip.embed(image) @ self.clip.embed(goal)))
        return {name: float(np.mean(v)) if v else float("nan") for name, v in found.items()}

    def _lpips(self, image: UInt8[np.ndarray, "h w 3"], goal: UInt8[np.ndarray, "h w 3"]) -> float:
        assert self.lpips is not None
        maps = squares(self.lpips.trunk, image, goal)
        heads = self.lpips.heads
        return sum(
            float((heads[layer] * value).sum(1).mean(dtype=torch.float64))
            for layer, value in maps.items()
        )


def squares(
    network: features.VGG16, image: UInt8[np.ndarray, "h w 3"], goal: UInt8[np.ndarray, "h w 3"]
) -> dict[str, Float[Tensor, "1 c y x"]]:
    """Squared differences of features that were made unit vectors cell by cell, for each of `LAYERS`."""
    stack = torch.from_numpy(np.stack([image, goal]).astype(np.float32) / 255).permute(0, 3, 1, 2)
    with torch.no_grad():
        found = network.features(stack, LAYERS)
        unit = {name: f / (f.norm(dim=1, keepdim=True) + 1e-10) for name, f in found.items()}
    return {name: (f[:1] - f[1:]) ** 2 for name, f in unit.items()}


def _within(
    network: features.VGG16,
    image: UInt8[np.ndarray, "h w 3"],
    goal: UInt8[np.ndarray, "h w 3"],
    inside: Bool[np.ndarray, "h w"],
) -> float:
    """Mean over `LAYERS` of the squared distance, each cell weighted by its share of the region; 0 to 2."""
    rows, columns = (_span(np.any(inside, axis=axis)) for axis in (1, 0))
    share = torch.from_numpy(inside[rows, columns].astype(np.float32))[None, None]
    total = 0.0
    for value in squares(network, image[rows, columns], goal[rows, columns]).values():
        cell = functional.interpolate(share, value.shape[2:], mode="area")
        total += float((cell * value.sum(1, keepdim=True)).sum() / cell.sum())
    return total / len(LAYERS)


def _span(used: Bool[np.ndarray, "n"]) -> slice:
    """From the first used index to the last, at least `LEAST` long where the picture is."""
    where = np.flatnonzero(used)
    low, high = int(where[0]), int(where[-1]) + 1
    low = max(0, min(low, (low + high - LEAST) // 2))
    high = min(len(used), max(high, low + LEAST))
    return slice(max(0, min(low, high - LEAST)), high)


def _pairs(
    recorded: Take, edited: Episode, true: Take, antialias: bool
) -> Iterator[
    tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]
]:
    """Edited and true picture of each camera, and the changed region."""
    late = 2 * true.episode.length // 3
    for name, t, inside, _ in scores.regions(recorded, true, antialias):
        if t == late and inside.any():
            yield edited.views[name].rgb(t), true.episode.views[name].rgb(t), inside


@lru_cache(2)
def opened(eyes: Eyes) -> PerceptualMetrics:
    """`Eyes.open`, once."""
    return eyes.open()


def _lpips(where: Path, network: features.VGG16 | None) -> Lpips:
    state = features.state(where)
    heads = {}
    for number, layer in enumerate(LAYERS):
        head = state.get(f"lin{number}.model.1.weight")
        if head is None:
            head = state.get(f"lin{number}.weight")
        if head is None or head.ndim != 4 or head.shape[0] != 1 or head.shape[2:] != (1, 1):
            raise BadInput(
                where,
                f"lin{number}",
                found="nothing" if head is None else f"shape {tuple(head.shape)}",
                expected="a state dict of LPIPS for VGG16",
            )
        heads[layer] = head.float()
    whole = {
        f"features.{name.split('.', 2)[2]}": value
        for name, value in state.items()
        if name.startswith("net.slice")
    }
    if whole:
        trunk = features.imagenet(where, whole)
    elif network is None:
        raise BadInput(
            where,
            "trunk",
            found="heads alone",
            expected="LPIPS' whole state dict, or ImageNet's VGG16 beside it (--vgg)",
        )
    else:
        trunk = network
    for layer, head in heads.items():
        if head.shape[1] != len(trunk.convolutions[layer][1]):
            found = f"{head.shape[1]} channels"
            raise BadInput(where, layer, found=found, expected="as many as the trunk has")
    return Lpips(trunk, heads)
