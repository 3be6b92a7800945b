"""Every tier on the same views, with the truth beside them: error, seconds a view, seconds of preparing."""

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from rpaug.core import metrics
from rpaug.core.errors import RpaugError
from rpaug.core.types import Scene
from rpaug.gaussians import fit, fit4, gaussian_view
from rpaug.gaussians.descent import settings_for
from rpaug.gaussians.frame_fit import FrameFitSettings, fit_views
from rpaug.gaussians.shots import shots_at
from rpaug.pipeline.left_out import Sight, shown_by_surfels
from rpaug.pipeline.pareto import Panel
from rpaug.render import holes
from rpaug.render.splat import Rasteriser, Splats, warm
from rpaug.render.zbuffer import Rendered
from rpaug.scene.recorded import surfels

FAR = 0.02  # metres
ALL_SECONDS = "processor seconds, preparing and all views"
PANELS = (
    Panel("co-visible pixels", "total_seconds", "covisible_db", ALL_SECONDS, "PSNR, dB"),
    Panel("depth", "total_seconds", "depth_far_percent", ALL_SECONDS,
          "% of pixels off by more than 20 mm", higher=False, logarithmic=True),
)  # fmt: skip


@dataclass(frozen=True)
class TierView:
    """One view as a method shows it; `hole` marks what it invented."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    hole: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Spent:
    """Seconds of preparing: of the processor, all threads together, and on the wall."""

    processor: float = 0.0
    wall: float = 0.0


@dataclass(frozen=True)
class Prepared:
    """The recorded scene with all representations that are needed, and what each took; see `STAGES`."""

    kept: surfels.Surfels
    scene: Scene  # with Gaussians
    in_time: Scene  # with Gaussians in space and time beside them
    moments: Mapping[int, Splats]  # Gaussians fitted to the images of one time, by time
    spent: Mapping[str, Spent]
    counts: Mapping[str, int]  # of Gaussians


STAGES = ("surfels", "gaussians", "in_time", "moments")


@dataclass(frozen=True)
class Method:
    """A way to show a view, and which of `STAGES` it needs; `show` gives None for a view it has nothing for."""

    tier: str
    show: Callable[[Prepared, Sight], TierView | None]
    needs: tuple[str, ...] = ()


Recording = tuple[Scene, Sequence[Sight]]
"""A recorded scene, which representations are prepared from, and views of it to be shown."""


@dataclass(frozen=True)
class TierRow:
    """One method over all views of all recordings: PSNR of the mean squared error, SSIM's mean, medians of depth and
    of time.

    Depth is compared on co-visible pixels. Seconds of preparing are means over recordings; `total_seconds` is preparing
    all and showing all views.
    """

    views_of: str
    method: str
    tier: str
    recordings: int
    views: int
    all_db: float
    covisible_db: float
    ssim: float
    depth_median_mm: float
    depth_far_percent: float
    holes_percent: float
    milliseconds_a_view: float
    prepare_seconds: float
    prepare_wall_seconds: float
    total_seconds: float
    gaussians: int


def by_surfels(made: Prepared, sight: Sight) -> TierView:
    """The z-buffer, holes filled from what lies beside them."""
    drawn = shown_by_surfels(made.kept, sight)
    return TierView(drawn.image, drawn.depth, drawn.hole)


def by_gaussians(made: Prepared, sight: Sight) -> TierView:
    """The fitted Gaussians alone, holes filled from what lies beside them."""
    return _gaussians_of(made.scene, sight)


def by_gaussians_in_time(made: Prepared, sight: Sight) -> TierView:
    """The same with those in space and time for what bends."""
    return _gaussians_of(made.in_time, sight)


def _gaussians_of(scene: Scene, sight: Sight) -> TierView:
    there = replace(scene, cameras=sight.scene.cameras)
    rgb, depth, ids = gaussian_view.render_view(there, sight.name, sight.t)
    return _filled(rgb, depth, ids)


def by_moments(made: Prepared, sight: Sight) -> TierView:
    """Gaussians fitted to nothing but what all cameras recorded at that time, holes filled."""
    camera, splats = sight.scene.cameras[sight.name], made.moments[sight.t]
    view = gaussian_view.view_of(camera, sight.t)
    drawn = Rasteriser(gaussian_view.sharp(splats)).forward(splats, view)
    depth = gaussian_view.plane_depth(drawn, splats, camera, sight.t)
    ids = (drawn.surface_index >= 0).astype(np.int32)
    return _filled(gaussian_view.to_bytes(drawn.color), depth, ids)


def _filled(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
) -> TierView:
    none = depth == 0
    drawn = Rendered((rgb / 255).astype(np.float32), depth, ids, -none.astype(np.int16), none, none)
    filled = holes.fill(drawn)
    return TierView(filled.image, filled.depth, none)


def by_both(made: Prepared, sight: Sight) -> TierView:
    """Surfels, and Gaussians where no recording showed anything."""
    near, far = by_surfels(made, sight), by_gaussians(made, sight)
    use = near.hole & ~far.hole
    return TierView(
        np.where(use[..., None], far.rgb, near.rgb),
        np.where(use, far.depth, near.depth),
        near.hole & ~use,
    )


# A further representation is one more entry: what shows a view, and what it needs prepared.
METHODS: Mapping[str, Method] = {
    "surfels": Method("1", by_surfels, ("surfels",)),
    "surfels, holes from Gaussians": Method("1 and 3", by_both, ("surfels", "gaussians")),
    "Gaussians of each moment": Method("3, one moment", by_moments, ("moments",)),
    "Gaussians": Method("3", by_gaussians, ("gaussians",)),
    "Gaussians, also in time": Method("4", by_gaussians_in_time, ("gaussians", "in_time")),
}


def chosen(
    names: Sequence[str] | None, known: Mapping[str, Method] = METHODS
) -> Mapping[str, Method]:
    """The methods of these names, or all. Raises RpaugError for a name that is none."""
    for name in names or ():
        if name not in known:
            raise RpaugError(f"no method is called {name!r}; there are: {', '.join(known)}")
    return {name: known[name] for name in names} if names else known


def run(
    views_of: str,
    recordings: Iterable[Recording],
    methods: Mapping[str, Method] = METHODS,
    steps: int | None = None,
    threads: int = 2,
    progress: Callable[[], None] = lambda: None,
) -> list[TierRow]:
    """A row for each method over all recordings' views, the same for all. `steps` are of each fit of an episode.

    `progress` is called after each method with each recording.
    """
    needs = frozenset(need for method in methods.values() for need in method.needs)
    prepared: list[Prepared] = []
    measured: dict[str, list[dict[str, float]]] = {name: [] for name in methods}
    for recorded, sights in recordings:
        made = prepare(recorded, needs, sorted({sight.t for sight in sights}), steps, threads)
        prepared.append(replace(made, moments={}))
        for name, method in methods.items():
            method.show(made, sights[0])  # compiles
            found = (_measured(made, method, sight) for sight in sights)
            measured[name] += [one for one in found if one]
            progress()
    return [
        _row(views_of, name, methods[name], prepared, found)
        for name, found in measured.items()
        if found
    ]


def prepare(
    recorded: Scene, needs: Collection[str], times: Sequence[int], steps: int | None, threads: int
) -> Prepared:
    """The representations of a recorded scene that are needed, each timed."""
    spent: dict[str, Spent] = {}
    counts = dict.fromkeys(STAGES, 0)
    surfels.build(recorded)  # compiles
    with _timed(spent, "surfels"):
        kept = surfels.build(recorded)
    scene = in_time = recorded
    moments: dict[int, Splats] = {}
    if "moments" in needs:
        warm()
        with _timed(spent, "moments"):
            moments = {t: moment(recorded, t, threads) for t in times}
        counts["moments"] = round(np.mean([len(splats) for splats in moments.values()]))
    if {"gaussians", "in_time"} & set(needs):
        settings = replace(settings_for("heldout", steps=steps), threads=threads)
        with _timed(spent, "gaussians"):
            scene, _ = fit.fitted(recorded, settings=settings)
        counts["gaussians"] = len(scene.gaussians or ())
    if "in_time" in needs:
        with _timed(spent, "in_time"):
            in_time, _ = fit4.fitted(scene)
        counts["in_time"] = len(in_time.flowing or ())
    return Prepared(kept, scene, in_time, moments, spent, counts)


def moment(recorded: Scene, t: int, threads: int) -> Splats:
    """Gaussians of all that the cameras recorded at t, until pixels kept back are shown no better."""
    splats, shots = shots_at(recorded.episode, t)
    settings = FrameFitSettings(stop="heldout", model=gaussian_view.sharp(splats), threads=threads)
    return fit_views(splats, shots, settings).splats


@contextmanager
def _timed(spent: dict[str, Spent], stage: str) -> Iterator[None]:
    start, wall = time.process_time(), time.perf_counter()
    yield
    spent[stage] = Spent(time.process_time() - start, time.perf_counter() - wall)


def _measured(made: Prepared, method: Method, sight: Sight) -> dict[str, float] | None:
    start = time.thread_time()
    shown = method.show(made, sight)
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


def _row(
    views_of: str,
    name: str,
    method: Method,
    prepared: Sequence[Prepared],
    measured: list[dict[str, float]],
) -> TierRow:
    mean = {key: float(np.nanmean([one[key] for one in measured])) for key in measured[0]}
    middle = {
        key: float(np.nanmedian([one[key] for one in measured])) for key in ("depth", "seconds")
    }
    before = sum(made.spent[need].processor for made in prepared for need in method.needs)
    wall = sum(made.spent[need].wall for made in prepared for need in method.needs)
    counts = [sum(made.counts[need] for need in method.needs) for made in prepared]
    return TierRow(
        views_of=views_of,
        method=name,
        tier=method.tier,
        recordings=len(prepared),
        views=len(measured),
        all_db=metrics.psnr(mean["all"]),
        covisible_db=metrics.psnr(mean["covisible"]),
        ssim=mean["ssim"],
        depth_median_mm=1e3 * middle["depth"],
        depth_far_percent=100 * mean["far"],
        holes_percent=100 * mean["holes"],
        milliseconds_a_view=1e3 * middle["seconds"],
        prepare_seconds=before / len(prepared),
        prepare_wall_seconds=wall / len(prepared),
        total_seconds=before + mean["seconds"] * len(measured),
        gaussians=round(float(np.mean(counts))),
    )
