"""Seconds of fitting Gaussians to one moment against how well they show it: recorded pixels, and held-out ones."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

from rpaug.core.errors import MissingExtra, RpaugError, Unsupported
from rpaug.core.types import Episode
from rpaug.gaussians.densify import Densify
from rpaug.gaussians.frame_fit import FrameFit, FrameFitSettings, fit_views
from rpaug.gaussians.shots import shots_at
from rpaug.pipeline.pareto import Panel

OPTIMISERS = {"adam": None, "adam, splitting": Densify()}
ENGINES = ("numba/float32", "reference/float64", "reference/float32", "gsplat/float32")
PANELS = (
    Panel("recorded pixels", "processor_seconds", "recorded_db", "processor seconds", "PSNR, dB"),
    Panel("held-out pixels that another camera sees", "processor_seconds", "held_out_db",
          "processor seconds", "PSNR, dB"),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FitSetting:
    """Every combination is one fit; every `strides`-th pixel of each row and column begins as a Gaussian."""

    strides: tuple[int, ...] = (2, 4)
    iterations: tuple[int, ...] = (60, 160, 360)
    optimisers: tuple[str, ...] = tuple(OPTIMISERS)
    engines: tuple[str, ...] = ENGINES[:1]
    hold_out: float = 0.1  # of the pixels
    threads: int = 2

    def __post_init__(self) -> None:
        for kind, given, known in (
            ("optimiser", self.optimisers, tuple(OPTIMISERS)),
            ("engine", self.engines, ENGINES),
        ):
            for name in given:
                if name not in known:
                    raise RpaugError(f"no {kind} is called {name!r}; there are: {', '.join(known)}")


@dataclass(frozen=True)
class FitRow:
    """One fit. Seconds exclude compiling and reading: on the wall, and of the processor, all threads together.

    Decibels are PSNR over all cameras' pixels together at the end; `held_out_best_db` is the best that the held-out
    pixels were on the way, `held_out_best_seconds` when.
    """

    name: str
    stride: int
    iterations: int
    optimiser: str
    engine: str
    gaussians: int
    seconds: float
    processor_seconds: float
    recorded_db: float
    held_out_db: float | None
    held_out_best_db: float | None
    held_out_best_seconds: float | None


def run(
    setting: FitSetting,
    episode: Episode,
    t: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[FitRow], list[dict[str, Any]], dict[str, str]]:
    """All rows, the trace of each, and why engines were skipped. Raises Unsupported without depth."""
    rows: list[FitRow] = []
    traces: list[dict[str, Any]] = []
    skipped: dict[str, str] = {}
    asked = list(product(setting.engines, setting.strides, setting.optimisers, setting.iterations))
    for number, (engine, stride, optimiser, iterations) in enumerate(asked):
        progress(number, len(asked))
        if engine in skipped:
            continue
        splats, shots = shots_at(episode, t, stride=stride, hold_out=setting.hold_out)
        backend, dtype = engine.split("/")
        settings = FrameFitSettings(
            iterations=iterations, stop="iterations", threads=setting.threads,
            densify=OPTIMISERS[optimiser], backend=backend, dtype=dtype,
        )  # fmt: skip
        try:
            found = fit_views(splats, shots, settings)
        except (MissingExtra, Unsupported) as error:
            skipped[engine] = str(error)
            continue
        rows.append(_row(found, stride, iterations, optimiser, engine))
        traces.append({"name": rows[-1].name, "trace": [asdict(point) for point in found.trace]})
    progress(len(asked), len(asked))
    return rows, traces, skipped


def _row(found: FrameFit, stride: int, iterations: int, optimiser: str, engine: str) -> FitRow:
    last = found.trace[-1]
    judged = [(p.held_out_db, p.seconds) for p in found.trace if p.held_out_db is not None]
    best = max(judged, default=(None, None))
    return FitRow(
        f"{engine}, stride {stride}, {optimiser}", stride, iterations, optimiser, engine,
        last.gaussians, last.seconds, last.processor_seconds, last.recorded_db, last.held_out_db,
        best[0], best[1],
    )  # fmt: skip
