"""Every tier on the same views, with the truth beside them: error, seconds a view, seconds of preparing."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rpaug.bench import metrics, moved
from rpaug.bench.moved import Sight
from rpaug.bench.pareto import Panel
from rpaug.errors import RpaugError
from rpaug.render import holes
from rpaug.render.zbuffer import Rendered
from rpaug.scene import fit, gaussian_view, surfels
from rpaug.scene.descent import settings_for
from rpaug.types import Scene

FAR = 0.02  # metres
ALL_SECONDS = "processor seconds, preparing and all views"
PANELS = (
    Panel("co-visible pixels", "total_seconds", "covisible_db", ALL_SECONDS, "PSNR, dB"),
    Panel("depth", "total_seconds", "depth_far_percent", ALL_SECONDS,
          "% of pixels off by more than 20 mm", higher=False, logarithmic=True),
)  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """One view as a method shows it; `hole` marks what it invented."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    hole: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Prepared:
    """The recorded scene with both carriers, and the processor seconds that each took."""

    scene: Scene  # with Gaussians
    kept: surfels.Surfels
    surfels_seconds: float
    fit_seconds: float
    fit_wall_seconds: float
    gaussians: int


@dataclass(frozen=True)
class Method:
    """A way to show a view, and what of `Prepared` it needs; `show` gives None for a view it has nothing for."""

    tier: str
    show: Callable[[Prepared, Sight], Shown | None]
    surfels: bool = False
    gaussians: bool = False


@dataclass(frozen=True)
class Row:
    """One method over all views of one set: PSNR of the mean squared error, SSIM's mean, medians of depth and of time.

    Depth is compared on co-visible pixels. `total_seconds` is preparing and showing all the views.
    """

    views_of: str
    method: str
    tier: str
    views: int
    all_db: float
    covisible_db: float
    ssim: float
    depth_median_mm: float
    depth_far_percent: float
    holes_percent: float
    milliseconds_a_view: float
    prepare_seconds: float
    prepare_wall_seconds: float | None
    total_seconds: float
    gaussians: int


def unchanged(made: Prepared, sight: Sight) -> Shown | None:
    """The recorded image, as if the camera had stayed; nothing for a camera that was left out."""
    view = sight.scene.episode.views.get(sight.name)
    if view is None:
        return None
    assert view.depth is not None
    depth = view.depth(sight.t)
    return Shown(view.rgb(sight.t), depth, np.zeros(depth.shape, bool))


def by_surfels(made: Prepared, sight: Sight) -> Shown:
    """The z-buffer, holes filled from what lies beside them."""
    drawn = moved.shown_by_surfels(made.kept, sight)
    return Shown(drawn.image, drawn.depth, drawn.hole)


def by_gaussians(made: Prepared, sight: Sight) -> Shown:
    """The fitted Gaussians alone, holes filled from what lies beside them."""
    there = replace(made.scene, cameras=sight.scene.cameras)
    rgb, depth, ids = gaussian_view.render_view(there, sight.name, sight.t)
    none = depth == 0
    drawn = Rendered((rgb / 255).astype(np.float32), depth, ids, -none.astype(np.int16), none)
    filled = holes.fill(drawn)
    return Shown(filled.image, filled.depth, none)


def by_both(made: Prepared, sight: Sight) -> Shown:
    """Surfels, and Gaussians where no recording showed anything."""
    near, far = by_surfels(made, sight), by_gaussians(made, sight)
    use = near.hole & ~far.hole
    return Shown(
        np.where(use[..., None], far.rgb, near.rgb),
        np.where(use, far.depth, near.depth),
        near.hole & ~use,
    )


# A further carrier is one more entry: what shows a view, and what it needs prepared.
METHODS: Mapping[str, Method] = {
    "recorded image unchanged": Method("0", unchanged),
    "surfels": Method("1", by_surfels, surfels=True),
    "surfels, holes from Gaussians": Method("1 and 3", by_both, surfels=True, gaussians=True),
    "Gaussians": Method("3", by_gaussians, gaussians=True),
}


def check(methods: Sequence[str]) -> None:
    """Raises RpaugError for a name that is none."""
    for name in methods:
        if name not in METHODS:
            raise RpaugError(f"no method is called {name!r}; there are: {', '.join(METHODS)}")


def run(
    views_of: str,
    recorded: Scene,
    sights: Sequence[Sight],
    methods: Sequence[str] = tuple(METHODS),
    steps: int | None = None,
    threads: int = 2,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Row]:
    """A row for each method over all sights. `recorded` is what carriers are prepared from; `steps` are of the fit."""
    check(methods)
    made = prepare(recorded, any(METHODS[name].gaussians for name in methods), steps, threads)
    rows = []
    for number, name in enumerate(methods):
        progress(number, len(methods))
        METHODS[name].show(made, sights[0])  # compiles
        measured = [found for sight in sights if (found := _measured(made, name, sight))]
        if measured:
            rows.append(_row(views_of, name, made, measured))
    progress(len(methods), len(methods))
    return rows


def prepare(recorded: Scene, gaussians: bool, steps: int | None, threads: int) -> Prepared:
    """Both carriers of a recorded scene, timed."""
    surfels.build(recorded)  # compiles
    start = time.process_time()
    kept = surfels.build(recorded)
    took = time.process_time() - start
    if not gaussians:
        return Prepared(recorded, kept, took, 0.0, 0.0, 0)
    settings = settings_for("heldout", steps=steps)
    start, wall = time.process_time(), time.perf_counter()
    scene, _ = fit.fitted(recorded, settings=replace(settings, threads=threads))
    spent, waited = time.process_time() - start, time.perf_counter() - wall
    assert scene.gaussians is not None
    return Prepared(scene, kept, took, spent, waited, len(scene.gaussians))


def _measured(made: Prepared, name: str, sight: Sight) -> dict[str, float] | None:
    start = time.thread_time()
    shown = METHODS[name].show(made, sight)
    seconds = time.thread_time() - start
    if shown is None:
        return None
    assert sight.true.depth is not None
    true, depth = sight.true.rgb(sight.t), sight.true.depth(sight.t)
    squared = ((shown.rgb.astype(float) - true) ** 2).mean(-1)
    seen = sight.covisible & (depth > 0)
    off = np.abs(shown.depth.astype(float) - depth)[seen]
    return {
        "all": float(squared.mean()),
        "covisible": float(squared[sight.covisible].mean()) if sight.covisible.any() else np.nan,
        "ssim": float(metrics.ssim(shown.rgb, true).mean()),
        "depth": float(np.median(off)) if len(off) else np.nan,
        "far": float((off > FAR).mean()) if len(off) else np.nan,
        "holes": float(shown.hole.mean()),
        "seconds": seconds,
    }


def _row(views_of: str, name: str, made: Prepared, measured: list[dict[str, float]]) -> Row:
    method = METHODS[name]
    mean = {key: float(np.nanmean([one[key] for one in measured])) for key in measured[0]}
    middle = {
        key: float(np.nanmedian([one[key] for one in measured])) for key in ("depth", "seconds")
    }
    before = made.surfels_seconds * method.surfels + made.fit_seconds * method.gaussians
    return Row(
        views_of=views_of,
        method=name,
        tier=method.tier,
        views=len(measured),
        all_db=metrics.psnr(mean["all"]),
        covisible_db=metrics.psnr(mean["covisible"]),
        ssim=mean["ssim"],
        depth_median_mm=1e3 * middle["depth"],
        depth_far_percent=100 * mean["far"],
        holes_percent=100 * mean["holes"],
        milliseconds_a_view=1e3 * middle["seconds"],
        prepare_seconds=before,
        prepare_wall_seconds=made.fit_wall_seconds if method.gaussians else None,
        total_seconds=before + mean["seconds"] * len(measured),
        gaussians=made.gaussians if method.gaussians else 0,
    )
