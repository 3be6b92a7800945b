"""The descent of a 4D fit: one region's Gaussians stepped against all views of one time, the rest held."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from rpaug.core.types import Gaussians4
from rpaug.gaussians import gaussians4
from rpaug.gaussians.gaussian_view import sharp_for
from rpaug.render.splat import Gradients, Splats, View, engine

FADE, SPREAD = 0.9, 0.99  # Adam's memories
PARAMETERS = ("means", "left", "right", "scales", "opacities", "sh")
BRIDGE = 4.0  # one gap away, a Gaussian that lasts for 0.6 gaps (`seeds4.LASTING`) weighs a quarter
SPLIT = 1.6  # a Gaussian split in two leaves children this much shorter (Kerbl et al. 2023)


@dataclass(frozen=True, kw_only=True)
class Rates4:
    """Step sizes: means by shares of a typical Gaussian's size, scales by factors, opacities by logits."""

    means: float = 0.1
    left: float = 1e-2
    right: float = 1e-2
    scales: float = 2e-2
    opacities: float = 0.08
    sh: float = 5e-2


@dataclass(frozen=True)
class Crop:
    """One recorded view of the region: the window around it, what it should show, and what else is there.

    `target` is the recording inside the region and the other Gaussians' own picture outside; `depth` is 0 outside.
    `weight` is 0 where something that the other Gaussians do not show may hide the region.
    """

    camera: str
    t: int
    view: View
    target: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    weight: Float32[np.ndarray, "h w"]
    rest: Splats  # all else, by covariances


@dataclass(frozen=True)
class _Moments:
    """Adam's memories of one parameter, row by row."""

    first: Float64[np.ndarray, "n c"]
    second: Float64[np.ndarray, "n c"]


@dataclass
class Descent4:
    """A fit under way: `gaussians` is where it stands."""

    gaussians: Gaussians4
    size: float  # metres: a typical Gaussian's standard deviation
    depth_weight: float = 1.0
    rates: Rates4 = field(default_factory=Rates4)
    backend: str = "auto"

    def __post_init__(self) -> None:
        self._engine = engine(self.backend, sharp_for(self.size))
        self._forget()

    def _forget(self) -> None:
        count = len(self.gaussians)
        self._steps = np.zeros(count)
        self._blame = np.zeros(count)  # how hard images pull on each middle, summed over views
        self._looks = np.zeros(count)
        self._moments = {
            name: _Moments(*(np.zeros((count, _width(self.gaussians, name))) for _ in range(2)))
            for name in PARAMETERS
        }

    def step(self, crops: Sequence[Crop], factor: float) -> float:
        """One step against crops of one time, every rate times `factor`; the mean squared error before it."""
        t = crops[0].t
        cut = gaussians4.at(self.gaussians, t)
        error, total, pulls = self._pulled(crops, cut)
        for pull in pulls:
            self._blame[cut.rows] += pull
            self._looks[cut.rows] += pull > 0
        self._descend(t, cut, total, factor)
        return error

    def bridge(self, crops: Sequence[Crop], gap: float, factor: float) -> None:
        """One step of the ways of what other frames gave, which are asked to show this frame without its own.

        `gap` is the number of frames between fitted ones. That is what they do between two frames; colors and
        opacities stay, and the nearest of them count in full.
        """
        g, t = self.gaussians, crops[0].t
        cut = gaussians4.at(g, t)
        others = np.abs(g.means[cut.rows, 3] / g.pace - t) > 0.5 * gap
        if not others.any():
            return
        cut = gaussians4.Slice(
            cut.rows[others],
            cut.means[others],
            cut.covariances[others],
            np.minimum(BRIDGE * cut.weights[others], 1.0),
        )
        _, (means, covariances, opacities, sh), _ = self._pulled(crops, cut)
        kept = self.gaussians
        self._descend(
            t, cut, (means, covariances, np.zeros_like(opacities), np.zeros_like(sh)), factor
        )
        # Adam goes on for a while without a slope.
        self.gaussians = replace(self.gaussians, opacities=kept.opacities, sh=kept.sh)

    def _pulled(
        self, crops: Sequence[Crop], cut: gaussians4.Slice
    ) -> tuple[float, tuple[np.ndarray, ...], list[Float64[np.ndarray, "m"]]]:
        """The mean squared error of crops, what they ask of a slice, and how hard each pulls on its middles."""
        g, m = self.gaussians, len(cut.rows)
        total = (np.zeros((m, 3)), np.zeros((m, 6)), np.zeros(m), np.zeros((m, *g.sh.shape[1:])))
        error, pulls = 0.0, []
        for crop in crops:
            self._engine.prepare(drawn(g, cut, crop.rest), crop.view)
            off, _, pull = self._engine.backward_squared_error(
                crop.target, crop.weight, crop.depth, self.depth_weight
            )
            error += off / len(crops)
            pulls.append(pull.image_motion[:m])
            for whole, part in zip(total, _own(pull, m), strict=True):
                whole += part
        return error, total, pulls

    def _descend(
        self, t: int, cut: gaussians4.Slice, total: Sequence[np.ndarray], factor: float
    ) -> None:
        g, rows = self.gaussians, cut.rows
        by_means, by_covariances, by_opacities, by_sh = total
        opacity = g.opacities[rows].astype(np.float64)
        pull = gaussians4.pull_back(g, t, rows, by_means, by_covariances, by_opacities * opacity)
        slopes = {
            "means": pull.means,
            "left": pull.left,
            "right": pull.right,
            "scales": pull.scales * g.scales[rows],
            "opacities": (by_opacities * cut.weights * opacity * (1 - opacity))[:, None],
            "sh": by_sh.reshape(len(rows), -1),
        }
        self._steps[rows] += 1
        steps = self._steps[rows, None]
        moved = {}
        for name, slope in slopes.items():
            rate = factor * getattr(self.rates, name) * (self.size if name == "means" else 1.0)
            old = getattr(g, name)
            value = old.copy()
            flat = value.reshape(len(value), -1)
            flat[rows] = _stepped(
                name, flat[rows], rate * self._direction(name, rows, slope, steps)
            )
            moved[name] = value
        self.gaussians = replace(g, **moved)

    def _direction(
        self,
        name: str,
        rows: Int[np.ndarray, "m"],
        slope: Float64[np.ndarray, "m c"],
        steps: Float64[np.ndarray, "m 1"],
    ) -> Float64[np.ndarray, "m c"]:
        """Adam's step of unit rate (Kingma and Ba 2015), on these rows alone: others were not looked at."""
        kept = self._moments[name]
        slope = np.where(np.isfinite(slope), slope, 0.0)
        kept.first[rows] = FADE * kept.first[rows] + (1 - FADE) * slope
        kept.second[rows] = SPREAD * kept.second[rows] + (1 - SPREAD) * slope**2
        first = kept.first[rows] / (1 - FADE**steps)
        return first / (np.sqrt(kept.second[rows] / (1 - SPREAD**steps)) + 1e-15)

    def densify(self, share: float) -> int:
        """Split the `share` of Gaussians that images pull hardest on; how many were split.

        Each becomes two, side by side along its longest axis in space; identity and all else is inherited.
        """
        blame = self._blame / np.maximum(self._looks, 1)
        worst = np.argsort(-blame, kind="stable")[: int(share * len(blame))]
        worst = worst[blame[worst] > 0]
        self.gaussians = split(self.gaussians, worst)
        self._forget()
        return len(worst)


def split(gaussians: Gaussians4, rows: Int[np.ndarray, "k"]) -> Gaussians4:
    """The Gaussians with some of them halved along the axis that is longest in space."""
    g = gaussians
    turn = gaussians4.rotations(g.left[rows], g.right[rows])
    # An axis that mostly points along time is how the Gaussian moves and lasts, not how wide it is.
    wide = g.scales[rows] * np.where(np.abs(turn[:, 3]) < 0.5, 1.0, 0.0)
    axis = wide.argmax(1)
    k = np.arange(len(rows))
    step = turn[k, :, axis] * 0.5 * wide[k, axis, None]
    scales = g.scales.copy()
    scales[rows, axis] = np.where(wide[k, axis] > 0, scales[rows, axis] / SPLIT, scales[rows, axis])
    means = g.means.copy()
    means[rows] -= step.astype(np.float32)
    names = ("left", "right", "opacities", "sh", "ids")
    more: dict[str, Any] = {
        name: np.concatenate([getattr(g, name), getattr(g, name)[rows]]) for name in names
    }
    there = means[rows] + (2 * step).astype(np.float32)
    return replace(
        g,
        means=np.concatenate([means, there]),
        scales=np.concatenate([scales, scales[rows]]),
        **more,
    )


def drawn(gaussians: Gaussians4, cut: gaussians4.Slice, rest: Splats) -> Splats:
    """A slice, first, and all else, as the rasteriser takes them."""
    rows, columns = gaussians4.UPPER
    assert rest.covariances is not None
    return Splats(
        means=np.concatenate([cut.means + gaussians.origin, rest.means.astype(np.float64)]),
        opacities=np.concatenate(
            [(gaussians.opacities[cut.rows] * cut.weights).astype(np.float32), rest.opacities]
        ),
        sh=np.concatenate([gaussians.sh[cut.rows], rest.sh]),
        covariances=np.concatenate(
            [cut.covariances[:, rows, columns].astype(np.float32), rest.covariances]
        ),
    )


def _own(pull: Gradients, m: int) -> tuple[np.ndarray, ...]:
    """What a picture asks of the slice's middles, covariances, opacities and colors."""
    assert pull.covariances is not None
    return pull.means[:m], pull.covariances[:m], pull.opacities[:m], pull.sh[:m]


def _width(gaussians: Gaussians4, name: str) -> int:
    return int(np.prod(getattr(gaussians, name).shape[1:], dtype=int))


def _stepped(
    name: str, value: Float[np.ndarray, "m c"], move: Float64[np.ndarray, "m c"]
) -> Float64[np.ndarray, "m c"]:
    """A step in the space that suits the parameter: logarithms of scales, logits of opacities."""
    if name == "scales":
        return value * np.exp(-move)
    if name == "opacities":
        inside = np.clip(value.astype(np.float64), 1e-6, 1 - 1e-6)
        return 1 / (1 + np.exp(move - np.log(inside / (1 - inside))))
    return value - move
