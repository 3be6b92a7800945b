"""Fit Gaussians to a set of images of one moment, and keep a trace of seconds against decibels."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from rpaug.core.errors import Unsupported
from rpaug.core.metrics import decibels
from rpaug.gaussians.densify import Densify, densified
from rpaug.gaussians.shots import TargetImage
from rpaug.gaussians.stops import Stop, StopCheck
from rpaug.render.splat import Adam, Gradients, Loss, Rates, Settings, Splats, engine, shared, warm

Ending = Literal["heldout", "fidelity", "iterations"]
Progress = Callable[["Checkpoint"], None]


@dataclass(frozen=True, kw_only=True)
class FrameFitSettings:
    """How a fit is done. Results do not depend on `threads`.

    `stop` is "heldout": pixels kept back have not improved for `patience` checks; "fidelity": the fitted pixels reach
    `target_db` (both as `stops.Stop` has it, and the state that was best by it is returned); or "iterations": all of
    them are made. Rates fall as a cosine over `iterations`, whichever stop ends the fit.
    """

    iterations: int = 360  # at most
    batch: int = 2  # views an iteration
    rate: float = 1.7  # factor on all of `rates`
    threads: int = 2
    loss: Loss = field(default_factory=Loss)
    stop: Ending = "heldout"
    target_db: float = 40.0
    patience: int = 3
    check_every: int = 20  # iterations
    last_rate: float = 0.03  # share of the rates left at the end
    densify: Densify | None = field(default_factory=Densify)  # None: as many as given
    keep_order: int = 1  # steps of one view that share an order of the Gaussians
    backend: str = "auto"  # numba, reference (slow), gsplat
    dtype: str = "float32"  # float64 with backend reference
    model: Settings = field(default_factory=Settings)
    rates: Rates = field(default_factory=Rates)

    def __post_init__(self) -> None:
        if self.stop not in get_args(Ending):
            raise ValueError(
                f"stop is {self.stop!r}; expected one of {', '.join(get_args(Ending))}"
            )


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
    shots: Sequence[TargetImage],
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
    rule, trace, checks = _rule(settings), list[Checkpoint](), list[StopCheck]()
    motion = np.zeros(len(splats), np.float32)
    best, kept, stopped = 0, adam.splats, "iterations"
    with ThreadPoolExecutor(crew.side_by_side) as pool:
        for step in range(settings.iterations + 1):
            if step % settings.check_every == 0 or step == settings.iterations:
                trace.append(crew.check(adam.splats, step, begun, pool))
                if progress:
                    progress(trace[-1])
                checks.append(_check(trace[-1]))
                if rule is None or rule.best(checks) == len(checks) - 1:
                    best, kept = len(trace) - 1, _copied(adam.splats)
                if rule is not None and rule.reached(checks):
                    stopped = rule.kind
                    break
            if step < settings.iterations:
                wave = 0.5 * (1 + np.cos(np.pi * step / settings.iterations))
                factor = settings.last_rate + (1 - settings.last_rate) * wave
                slopes = crew.pull(adam.splats, step, pool)
                adam.step(slopes, factor)
                motion = motion + slopes.image_motion
                if settings.densify and settings.densify.due(step, settings.iterations):
                    adam.take(*densified(adam.splats, motion, settings.densify))
                    motion = np.zeros(len(adam.splats), np.float32)
    return FrameFit(kept, tuple(trace), stopped, best)


def _rule(settings: FrameFitSettings) -> Stop | None:
    if settings.stop == "iterations":
        return None
    return Stop(
        kind=settings.stop,
        target=settings.target_db,
        every=settings.check_every,
        patience=settings.patience,
    )


def _check(point: Checkpoint) -> StopCheck:
    held_out = -np.inf if point.held_out_db is None else point.held_out_db
    return StopCheck(point.iteration, point.recorded_db, held_out)


class _Crew:
    """One engine a shot, and the threads shared among the shots of a batch."""

    def __init__(self, shots: Sequence[TargetImage], settings: FrameFitSettings) -> None:
        self._shots, self._settings = shots, settings
        largest = max(shot.view.width * shot.view.height for shot in shots)
        self.side_by_side, each = shared(settings.threads, settings.batch, largest)
        self._engines = [
            engine(
                settings.backend, settings.model, threads=each, keep_order=settings.keep_order,
                dtype=settings.dtype,
            )
            for _ in shots
        ]  # fmt: skip
        self._weights = [shot.weight for shot in shots]

    def pull(self, splats: Splats, step: int, pool: ThreadPoolExecutor) -> Gradients:
        """The batch's gradients, summed in its order: threads do not change a bit."""
        batch, loss = self._settings.batch, self._settings.loss
        chosen = [(step * batch + k) % len(self._shots) for k in range(batch)]

        def one(at: int) -> Gradients:
            shot = self._shots[at]
            self._engines[at].prepare(splats, shot.view)
            given = (loss, shot.color, self._weights[at], shot.depth)
            return self._engines[at].backward_loss(*given)[1]

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
            color = np.clip(self._engines[at].forward(splats, shot.view, surface=False).color, 0, 1)
            error = ((color.astype(np.float64) - shot.color) ** 2).mean(-1)
            fitted = ~shot.held
            sums = (error[fitted].sum(), fitted.sum(), error[shot.judged].sum(), shot.judged.sum())
            return np.array(sums, np.float64)

        error, fitted, unseen, judged = np.sum(list(pool.map(one, range(len(self._shots)))), 0)
        return Checkpoint(
            step, time.perf_counter() - begun[0], time.process_time() - begun[1], len(splats),
            decibels(error / fitted), decibels(unseen / judged) if judged else None,
        )  # fmt: skip


def _scaled(rates: Rates, factor: float) -> Rates:
    return Rates(**{name: factor * rate for name, rate in vars(rates).items()})


def _copied(splats: Splats) -> Splats:
    return replace(splats, **{k: a.copy() for k, a in vars(splats).items() if a is not None})
