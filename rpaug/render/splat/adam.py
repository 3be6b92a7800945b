"""Adam (Kingma & Ba 2015, arXiv 1412.6980) on splats, with steps that do not depend on the scene's unit."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from rpaug.core.jit import inlined, kernel
from rpaug.render.splat._threads import ranges, together
from rpaug.render.splat.settings import Gradients, Splats

PLAIN, LOGARITHM, LOGIT = range(3)  # what is stepped in: the value itself, its logarithm, its logit
LARGEST = 1e18  # gradients beyond, infinite or NaN move nothing
SMALLEST = np.float32(1e-15)
PERIOD = 1024  # elements, about, for which rates are laid out: long enough for vectors


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
    sh: float = 3.5e-2  # 1e-2 of a color: the constant harmonic is 0.28
    sh_rest: float = 1.75e-3  # higher degrees
    covariances: float = 0.0
    features: float = 1e-2


@inlined
def _exp(x):
    """exp(x) to 1e-7 for |x| < 1/2, as a step is; a smooth positive rise to |x| = 2, where longer ones end."""
    x = min(max(x, np.float32(-2)), np.float32(2)) * np.float32(0.25)
    total = np.float32(1)
    for k in range(6, 0, -1):
        total = np.float32(1) + x * total * np.float32(1.0 / k)
    total *= total
    return total * total


@inlined
def _moves(slopes, first, second, rates, fade, spread, late, moves):
    """Update the moments by `slopes`; `moves` gets how far to step down."""
    late_first, late_second = late
    one = np.float32(1)
    for k in range(len(slopes)):
        slope = slopes[k] if abs(slopes[k]) <= LARGEST else np.float32(0)  # NaN compares as false
        first[k] = fade * first[k] + (one - fade) * slope
        second[k] = spread * second[k] + (one - spread) * slope * slope
        # A tiny epsilon: gradients by metres shrink as a scene's unit grows.
        moves[k] = (
            rates[k] * first[k] * late_first / (math.sqrt(second[k] * late_second) + SMALLEST)
        )


@kernel
def _update(start, stop, value, stepped, gradient, first, second, rates, space, fade, spread, late):
    """One step on elements start..stop of flat arrays; element k has the rate `rates[k % len(rates)]`.

    `stepped` holds the logits where `space` is LOGIT. `late` are the two corrections for moments that began at zero.
    Short loops over few arrays, a period of rates at a time: LLVM turns those into vectors.
    """
    period, one = len(rates), np.float32(1)
    slopes, moves = np.empty_like(rates), np.empty_like(rates)
    for begin in range(start // period * period, stop, period):
        low, high = max(begin, start), min(begin + period, stop)
        now, slope, move = value[low:high], slopes[: high - low], moves[: high - low]
        slope[:] = gradient[low:high]
        if space == LOGARITHM:
            slope *= now
        elif space == LOGIT:
            slope *= now * (one - now)
        _moves(
            slope, first[low:high], second[low:high], rates[low - begin :], fade, spread, late, move
        )
        if space == PLAIN:
            for k in range(len(now)):
                now[k] -= move[k]
        elif space == LOGARITHM:
            for k in range(len(now)):
                now[k] *= _exp(-move[k])
        else:
            logit = stepped[low:high]
            for k in range(len(now)):
                logit[k] -= move[k]
                now[k] = one / (one + math.exp(-logit[k]))


@dataclass(frozen=True)
class _Group:
    """Flat arrays: values, what is stepped in (logits; else the values), moments, and one period of rates."""

    value: np.ndarray
    stepped: np.ndarray
    first: np.ndarray
    second: np.ndarray
    rates: np.ndarray
    space: int
    columns: int


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
        self._rates, self._threads = rates or Rates(), threads
        self._fade, self._spread, self._steps = fade, spread, 0
        self._size = _typical_size(splats) if size is None else size
        self._begin(splats)

    def _begin(self, splats: Splats) -> None:
        rates, copies = self._rates, {}
        rows = vars(rates) | {"means": self._size * rates.means}
        self._groups: dict[str, _Group] = {}
        for name in ("means", "opacities", "sh", "quats", "scales", "covariances", "features"):
            array = getattr(splats, name)
            if array is None:
                continue
            copies[name] = np.array(array, order="C")
            columns = int(np.prod(array.shape[1:]))
            rate = np.full(columns, rows[name])
            if name == "sh":
                rate[3:] = rates.sh_rest
            if rate.any():
                self._groups[name] = _group(name, copies[name], rate)
        self.splats = replace(splats, **copies)

    def take(self, splats: Splats, parents: Int[np.ndarray, "m"]) -> None:
        """Go on with other splats: row i takes over the moments of the row `parents[i]` of those so far."""
        before = self._groups
        self._begin(splats)
        for name, group in self._groups.items():
            for moment in ("first", "second"):
                old = getattr(before[name], moment).reshape(-1, group.columns)
                getattr(group, moment)[:] = old[parents].ravel()

    def step(self, gradients: Gradients, factor: float = 1.0) -> None:
        """One step against `gradients`, every rate times `factor` (a schedule's)."""
        self._steps += 1
        late = tuple(1 / (1 - decay**self._steps) for decay in (self._fade, self._spread))
        for name, group in self._groups.items():
            kind = group.value.dtype.type
            slope = _flat(getattr(gradients, name), group.value.dtype)
            given = (
                group.value, group.stepped, slope, group.first, group.second,
                (factor * group.rates).astype(kind), group.space, kind(self._fade), kind(self._spread),
                (kind(late[0]), kind(late[1])),
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


def _group(name: str, array: np.ndarray, rates: np.ndarray) -> _Group:
    space, values = PLAIN, array.reshape(-1)
    stepped = values
    if name == "scales":
        space = LOGARITHM
        np.maximum(values, values.dtype.type(1e-30), out=values)
    elif name == "opacities":
        space = LOGIT
        inside = np.clip(values, 1e-6, 1 - 1e-6)
        stepped = np.log(inside / (1 - inside))
    zeros = np.zeros_like(values)
    period = np.tile(rates, -(-PERIOD // len(rates)))
    return _Group(values, stepped, zeros, zeros.copy(), period, space, len(rates))


def _flat(array: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """An array's numbers in a row, in the precision of what they step."""
    return np.require(array.reshape(-1), dtype, ["C", "A"])
