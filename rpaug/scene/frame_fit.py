"""Fit Gaussians to a set of images of one moment, and keep a trace of seconds against decibels."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from rpaug.errors import Unsupported
from rpaug.render.splat import Adam, Gradients, Loss, Rates, Settings, Splats, warm
from rpaug.render.splat.workers import worker
from rpaug.scene.shots import Shot

OPTIMISERS, STOPS = ("adam",), ("heldout", "fidelity", "iterations")
Progress = Callable[["Checkpoint"], None]


@dataclass(frozen=True, kw_only=True)
class FrameFitSettings:
    """How a fit is done. Results do not depend on `threads`.

    `stop` is "heldout": pixels kept back have not improved for `patience` checks, and the best state is
    returned; "fidelity": the fitted pixels reach `target_db`; or "iterations": all of them are made. Rates fall as a
    cosine over `iterations`, whichever stop ends them.
    """

    iterations: int = 360  # at most
    optimiser: str = "adam"
    batch: int = 2  # views an iteration
    rate: float = 1.7  # factor on all of `rates`
    threads: int = 2
    loss: Loss = field(default_factory=Loss)
    stop: str = "heldout"
    target_db: float = 40.0
    patience: int = 3
    check_every: int = 20  # iterations
    last_rate: float = 0.03  # share of the rates left at the end
    keep_order: int = 1  # steps of one view that share an order of the Gaussians
    backend: str = "auto"  # numba, reference (slow), gsplat
    dtype: str = "float32"  # float64 with backend reference
    model: Settings = field(default_factory=Settings)
    rates: Rates = field(default_factory=Rates)

    def __post_init__(self) -> None:
        for name, value, known in (
            ("optimiser", self.optimiser, OPTIMISERS),
            ("stop", self.stop, STOPS),
        ):
            if value not in known:
                raise ValueError(f"{name} is {value!r}; expected one of {', '.join(known)}")


@dataclass(frozen=True)
class Checkpoint:
    """Where a fit stood: seconds since it began, on the wall and of all its threads; PSNR over all shots.

    `recorded_db` is over the fitted pixels, `held_out_db` over those kept back for judging, None if there are none.
    """

    iteration: int
    seconds: float
    processor_seconds: float
    gaussians: int
    recorded_db: float
    held_out_db: float | None


@dataclass(frozen=True)
class FrameFit:
    """The Gaussians, how the fit went, and which rule ended it ("iterations" if none did)."""

    splats: Splats
    trace: tuple[Checkpoint, ...]
    stopped: str
    best: int  # index into `trace` of the state returned


def fit_views(
    splats: Splats,
    shots: Sequence[Shot],
    settings: FrameFitSettings | None = None,
    progress: Progress | None = None,
) -> FrameFit:
    """Lower the loss of `splats` over the fitted pixels of all shots; `progress` is told of each checkpoint.

    Seconds begin after the kernels are compiled and include the checks. Raises Unsupported for stop "heldout" without
    pixels to judge by, and for a backend that cannot run here.
    """
    settings = settings or FrameFitSettings()
    if settings.stop == "heldout" and not any(shot.judged.any() for shot in shots):
        raise Unsupported(
            "stop heldout needs pixels that are kept back; others: fidelity, iterations"
        )
    if settings.backend in ("auto", "numba"):
        warm()
    begun = time.perf_counter(), time.process_time()
    crew = _Crew(shots, settings)
    adam = Adam(splats, _scaled(settings.rates, settings.rate), threads=settings.threads)
    trace: list[Checkpoint] = []
    best, kept, stopped = 0, adam.splats, "iterations"
    with ThreadPoolExecutor(crew.side_by_side) as pool:
        for step in range(settings.iterations + 1):
            if step % settings.check_every == 0 or step == settings.iterations:
                trace.append(crew.check(adam.splats, step, begun, pool))
                if progress:
                    progress(trace[-1])
                if settings.stop != "heldout" or _held_out(trace[-1]) >= _held_out(trace[best]):
                    best, kept = len(trace) - 1, _copied(adam.splats)
                if _reached(settings, trace, best):
                    stopped = settings.stop
                    break
            if step < settings.iterations:
                wave = 0.5 * (1 + np.cos(np.pi * step / settings.iterations))
                factor = settings.last_rate + (1 - settings.last_rate) * wave
                adam.step(crew.pull(adam.splats, step, pool), factor)
    return FrameFit(kept, tuple(trace), stopped, best)


def _held_out(point: Checkpoint) -> float:
    return -np.inf if point.held_out_db is None else point.held_out_db


def _reached(settings: FrameFitSettings, trace: list[Checkpoint], best: int) -> bool:
    if settings.stop == "fidelity":
        return trace[-1].recorded_db >= settings.target_db
    return settings.stop == "heldout" and len(trace) - 1 - best >= settings.patience


class _Crew:
    """One worker a shot, and the threads shared among the shots of a batch."""

    def __init__(self, shots: Sequence[Shot], settings: FrameFitSettings) -> None:
        self._shots, self._settings = shots, settings
        self.side_by_side = min(settings.batch, settings.threads)
        each = max(1, settings.threads // self.side_by_side)
        self._workers = [
            worker(settings.backend, settings.dtype, settings.model, each, settings.keep_order)
            for _ in shots
        ]
        self._weights = [shot.weight for shot in shots]

    def pull(self, splats: Splats, step: int, pool: ThreadPoolExecutor) -> Gradients:
        """The batch's gradients, summed in its order: threads do not change a bit."""
        batch, loss = self._settings.batch, self._settings.loss
        chosen = [(step * batch + k) % len(self._shots) for k in range(batch)]

        def one(at: int) -> Gradients:
            shot = self._shots[at]
            given = (shot.view, loss, shot.colour, self._weights[at], shot.depth)
            return self._workers[at].pull(splats, *given)[1]

        first, *rest = pool.map(one, chosen)
        for other in rest:
            for name, total in vars(first).items():
                if total is not None:
                    np.add(total, getattr(other, name), out=total)
        return first

    def check(
        self, splats: Splats, step: int, begun: tuple[float, float], pool: ThreadPoolExecutor
    ) -> Checkpoint:
        """PSNR over the fitted and over the judged pixels of all shots together."""

        def one(at: int) -> np.ndarray:
            shot = self._shots[at]
            colour = np.clip(self._workers[at].look(splats, shot.view), 0, 1)
            error = ((colour.astype(np.float64) - shot.colour) ** 2).mean(-1)
            fitted = ~shot.held
            sums = (error[fitted].sum(), fitted.sum(), error[shot.judged].sum(), shot.judged.sum())
            return np.array(sums, np.float64)

        error, fitted, unseen, judged = np.sum(list(pool.map(one, range(len(self._shots)))), 0)
        return Checkpoint(
            step, time.perf_counter() - begun[0], time.process_time() - begun[1], len(splats),
            decibels(error / fitted), decibels(unseen / judged) if judged else None,
        )  # fmt: skip


def decibels(squared_error: float) -> float:
    """PSNR of a mean squared error of colours in 0..1; at most 120."""
    return float(-10 * np.log10(max(squared_error, 1e-12)))


def _scaled(rates: Rates, factor: float) -> Rates:
    return Rates(**{name: factor * rate for name, rate in vars(rates).items()})


def _copied(splats: Splats) -> Splats:
    return replace(splats, **{k: a.copy() for k, a in vars(splats).items() if a is not None})
