"""Adam (Kingma & Ba 2015, arXiv 1412.6980) on splats, with steps that do not depend on the scene's unit."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rpaug.render.jit import kernel
from rpaug.render.splat._threads import ranges, together
from rpaug.render.splat.settings import Gradients, Splats

PLAIN, LOGARITHM, LOGIT = range(3)  # what is stepped in: the value itself, its logarithm, its logit


@dataclass(frozen=True)
class Rates:
    """Step sizes: how far a parameter may move in one step, about.

    Means move by shares of a typical Gaussian's size, scales by factors, opacities by logits, the rest by
    its own values. A rate of 0 holds a parameter still.
    """

    means: float = 0.1
    quats: float = 1.2e-2
    scales: float = 3e-2
    opacities: float = 0.12
    sh: float = 3.5e-2  # 1e-2 of a colour: the constant harmonic is 0.28
    sh_rest: float = 1.75e-3  # higher degrees
    covariances: float = 0.0
    features: float = 1e-2


@kernel
def _update(
    start, stop, value, stepped, gradient, first, second, rates, space, fade, spread, steps
):
    """One step on rows start..stop; `rates` holds one number per column, `stepped` the value as stepped in."""
    late_first = 1.0 / (1.0 - fade**steps)
    late_second = 1.0 / (1.0 - spread**steps)
    for i in range(start, stop):
        for k in range(value.shape[1]):
            slope = gradient[i, k]
            if space == LOGARITHM:
                slope *= value[i, k]
            elif space == LOGIT:
                slope *= value[i, k] * (1 - value[i, k])
            if not math.isfinite(slope):
                slope = 0.0
            first[i, k] = fade * first[i, k] + (1 - fade) * slope
            second[i, k] = spread * second[i, k] + (1 - spread) * slope * slope
            # A tiny epsilon: gradients by metres shrink as a scene's unit grows.
            move = first[i, k] * late_first / (math.sqrt(second[i, k] * late_second) + 1e-15)
            stepped[i, k] -= rates[k] * move
            if space == LOGARITHM:
                value[i, k] = math.exp(stepped[i, k])
            elif space == LOGIT:
                value[i, k] = 1 / (1 + math.exp(-stepped[i, k]))
            else:
                value[i, k] = stepped[i, k]


@dataclass(frozen=True)
class _Group:
    value: np.ndarray  # (n, columns), float64 moments would double the memory for nothing
    stepped: np.ndarray
    first: np.ndarray
    second: np.ndarray
    rates: np.ndarray
    space: int


class Adam:
    """Steps splats downhill. `splats` is its own copy, overwritten by `step`; copy it to keep a state.

    `size` is a typical Gaussian's standard deviation in the scene's unit, the measure for means; by default
    the median over all scales (or of the roots of the covariances' diagonals).
    """

    def __init__(
        self,
        splats: Splats,
        rates: Rates | None = None,
        *,
        size: float | None = None,
        fade: float = 0.9,
        spread: float = 0.99,
        threads: int = 1,
    ) -> None:
        rates = rates or Rates()
        self._fade, self._spread, self._threads, self._steps = fade, spread, threads, 0
        if size is None:
            size = _typical_size(splats)
        rows = {"means": size * rates.means, "opacities": rates.opacities, "quats": rates.quats}
        rows |= {
            "scales": rates.scales,
            "covariances": rates.covariances,
            "features": rates.features,
        }
        self._groups: dict[str, _Group] = {}
        copies = {}
        for name in ("means", "opacities", "sh", "quats", "scales", "covariances", "features"):
            array = getattr(splats, name)
            if array is None:
                continue
            copies[name] = np.array(
                array, np.float32 if name != "means" else array.dtype, order="C"
            )
            flat = copies[name].reshape(len(splats), -1)
            if name == "sh":
                rate = np.full(flat.shape[1], rates.sh_rest)
                rate[:3] = rates.sh
            else:
                rate = np.full(flat.shape[1], rows[name])
            if rate.any():
                self._groups[name] = _group(name, flat, rate)
        self.splats = replace(splats, **copies)

    def step(self, gradients: Gradients, factor: float = 1.0) -> None:
        """One step against `gradients`, every rate times `factor` (a schedule's)."""
        self._steps += 1
        for name, group in self._groups.items():
            slope = getattr(gradients, name).reshape(group.value.shape)
            given = (
                group.value, group.stepped, slope, group.first, group.second, factor * group.rates,
                group.space, self._fade, self._spread, self._steps,
            )  # fmt: skip
            parts = ranges(len(group.value), self._threads)
            together(_update, [(*part, *given) for part in parts])


def _typical_size(splats: Splats) -> float:
    if not len(splats):
        return 1.0
    if splats.scales is not None:
        return float(np.median(splats.scales))
    assert splats.covariances is not None
    return float(np.median(np.sqrt(splats.covariances[:, [0, 3, 5]])))


def _group(name: str, flat: np.ndarray, rates: np.ndarray) -> _Group:
    space, stepped = PLAIN, flat
    if name == "scales":
        space, stepped = LOGARITHM, np.log(np.maximum(flat, np.float32(1e-30)))
    elif name == "opacities":
        inside = np.clip(flat, 1e-6, 1 - 1e-6)
        space, stepped = LOGIT, np.log(inside / (1 - inside))
    zeros = np.zeros(flat.shape, np.float32)
    return _Group(flat, stepped, zeros, zeros.copy(), rates.astype(np.float64), space)
