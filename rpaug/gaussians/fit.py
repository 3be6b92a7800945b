"""Fit Gaussians of the static background and of the moving bodies to the recorded images of an episode."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from jaxtyping import Float64

from rpaug.core.ahead import in_order
from rpaug.core.errors import Unsupported
from rpaug.core.sampling import frames
from rpaug.core.types import Body, Gaussians, Scene
from rpaug.gaussians.descent import Descent, FitSettings, TargetView, cosine, shot_of
from rpaug.gaussians.fit_residuals import fit_frame_residuals
from rpaug.gaussians.judging import colors_db, fixed_cameras, judged, psnr, ssim
from rpaug.gaussians.seeds import seeds
from rpaug.gaussians.stops import StopCheck
from rpaug.scene.lighting.irradiance import even

__all__ = ["Begun", "FitReport", "FitSettings", "fit", "fitted", "psnr", "ssim"]

Progress = Callable[[float], None]
WATCHED = 2  # times looked at by each check, of those fitted and of those held out each


@dataclass(frozen=True)
class Begun:
    """Gaussians that a fit starts from; the first `held` of them stay as they are."""

    gaussians: Gaussians
    held: int = 0


@dataclass(frozen=True)
class FitReport:
    """How well the Gaussians show the recorded views, in decibels of PSNR (up) and SSIM (up), means over views.

    `train` are views at times that were fitted; `held_out` those at times that were not, before moments were fitted
    to them too. `per_camera` is over both, as finally shown; `fixed` are the means of cameras that stand still.
    """

    gaussians: int
    moments: int  # times at which the Gaussians have residuals of their own
    stop: str
    steps: int
    seconds: float
    train_db: float
    held_out_db: float | None
    fixed_db: float
    fixed_ssim: float
    per_camera_db: dict[str, float]
    per_camera_ssim: dict[str, float]
    depth_error_mm: float  # median over pixels, of the surface's depth
    seed: int
    device: str  # that fitted: cpu or cuda
    bodies: tuple[Body, ...] = field(repr=False)  # with tracks as they settled
    pose_correction: Mapping[str, Float64[np.ndarray, "t 4 4"]] = field(repr=False)
    irradiance: Float64[np.ndarray, "9"] = field(repr=False)


def fit(
    scene: Scene,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    begun: Begun | None = None,
) -> tuple[Gaussians, FitReport]:
    """Gaussians in their bodies' frames that show the scene as recorded, and how well they do.

    Loss: squared color error and, weighted, squared relative error of the expected depth; Adam; views in an
    order drawn from `seed`. Tracks of bodies and poses of moving cameras give way too: the Gaussians belong
    to the report's `bodies`, `drift` and `irradiance`, and `fitted` puts all into a scene. `progress` is told the
    share done. With the `fidelity` stop, moments at all recorded times follow until the target is met. `begun` is
    what to start from instead of seeds of all that was recorded. Raises Unsupported without depth or bodies.
    """
    settings, tell = settings or FitSettings(), progress or (lambda share: None)
    start = time.perf_counter()
    if not scene.bodies:
        raise Unsupported("fitting Gaussians needs depth and instance masks, which give the bodies")
    trained = frames(scene.episode.length, settings.train_frames)
    share = 1 / 2 if settings.stop.kind == "fidelity" else 1.0
    begun = begun or Begun(seeds(scene))
    shown, steps = _descended(
        scene, begun, trained, settings, seed, lambda done: tell(share * done)
    )
    rest = sorted(set(range(scene.episode.length)) - set(trained))
    known, unseen = _some(trained, settings.checked_frames), _some(rest, settings.checked_frames)
    found = judged(shown, [*known, *unseen], settings.threads)
    held_out = float(found[len(known) :, :, 0].mean()) if unseen else None
    if settings.stop.kind == "fidelity":
        shown, found = _refined(shown, known, unseen, found, settings, tell)
    assert shown.gaussians is not None
    fixed, names = fixed_cameras(scene), list(scene.episode.views)
    report = FitReport(
        gaussians=len(shown.gaussians),
        moments=len(shown.gaussians.frame_residuals),
        stop=settings.stop.kind,
        steps=steps,
        seconds=time.perf_counter() - start,
        train_db=float(found[: len(known), :, 0].mean()),
        held_out_db=held_out,
        fixed_db=float(found[:, fixed, 0].mean()),
        fixed_ssim=float(found[:, fixed, 1].mean()),
        per_camera_db=dict(zip(names, found[..., 0].mean(0).tolist(), strict=True)),
        per_camera_ssim=dict(zip(names, found[..., 1].mean(0).tolist(), strict=True)),
        depth_error_mm=1e3 * float(np.median(found[..., 2])),
        seed=seed,
        device="cuda" if settings.backend == "gsplat" else "cpu",
        bodies=shown.bodies,
        pose_correction=shown.pose_correction,
        irradiance=even() if shown.irradiance is None else shown.irradiance,
    )
    return shown.gaussians, report


def fitted(
    scene: Scene,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    begun: Begun | None = None,
) -> tuple[Scene, FitReport]:
    """The scene with fitted Gaussians and the tracks and camera poses they belong to, and how well they do."""
    gaussians, report = fit(scene, settings=settings, seed=seed, progress=progress, begun=begun)
    return (
        replace(
            scene,
            gaussians=gaussians,
            bodies=report.bodies,
            pose_correction=report.pose_correction,
            irradiance=report.irradiance,
        ),
        report,
    )


def _descended(
    scene: Scene,
    begun: Begun,
    trained: Sequence[int],
    settings: FitSettings,
    seed: int,
    tell: Progress,
) -> tuple[Scene, int]:
    """The scene with Gaussians of all times, and the steps it took."""
    views = scene.episode.views
    shots = list(in_order(partial(shot_of, scene.episode, n, t) for t in trained for n in views))
    descent = Descent(begun.gaussians, scene, trained, settings, begun.held)
    rng, checks, step = np.random.default_rng(seed), [], 0
    with ThreadPoolExecutor(settings.threads) as pool:
        for step, batch in enumerate(_batches(shots, settings.steps, settings.batch, rng)):
            if settings.stop.due(step):
                checks.append(_check(descent.scene(), trained, step, settings))
                if settings.stop.reached(checks):
                    return descent.scene(), step
            descent.step(batch, cosine(step / settings.steps, settings.last_rate), pool)
            if step % 25 == 0:
                tell(step / settings.steps)
    return descent.scene(), settings.steps


def _check(scene: Scene, trained: Sequence[int], step: int, settings: FitSettings) -> StopCheck:
    """A look at a few views of the fixed cameras."""
    seen = _some(trained, WATCHED)
    unseen = _some(sorted(set(range(scene.episode.length)) - set(trained)), WATCHED)
    every = colors_db(scene, [*seen, *unseen], settings.threads, settings.backend)
    found = every[:, fixed_cameras(scene)]
    recorded = float(found[: len(seen)].mean())
    return StopCheck(step, recorded, float(found[len(seen) :].mean()) if unseen else recorded)


def _refined(
    scene: Scene,
    known: Sequence[int],
    unseen: Sequence[int],
    found: Float64[np.ndarray, "times cameras 3"],
    settings: FitSettings,
    tell: Progress,
) -> tuple[Scene, Float64[np.ndarray, "times cameras 3"]]:
    """The scene with moments at every recorded time, in passes until its fixed cameras show the target."""
    fixed, everywhere = fixed_cameras(scene), range(scene.episode.length)
    for number in range(settings.moment_passes):
        recorded = float(found[:, fixed, 0].mean())
        if settings.stop.reached([StopCheck(number, recorded, recorded)]):
            break
        before = 1 + number / settings.moment_passes
        residuals = fit_frame_residuals(
            scene,
            everywhere,
            steps=settings.moment_steps,
            depth_weight=settings.depth_weight,
            threads=settings.threads,
            backend=settings.backend,
            progress=partial(_tell_part, tell, before, settings.moment_passes),
        )
        assert scene.gaussians is not None
        scene = replace(scene, gaussians=replace(scene.gaussians, frame_residuals=residuals))
        found = judged(scene, [*known, *unseen], settings.threads)
    return scene, found


def _tell_part(tell: Progress, before: float, passes: int, done: float) -> None:
    tell((before + done / passes) / 2)


def _batches(
    shots: Sequence[TargetView], steps: int, size: int, rng: np.random.Generator
) -> Iterator[list[TargetView]]:
    """Views for each step, every one as often as any other, in random order."""
    order: list[int] = []
    for _ in range(steps):
        while len(order) < size:
            order += rng.permutation(len(shots)).tolist()
        yield [shots[i] for i in order[:size]]
        order = order[size:]


def _some(times: Sequence[int], most: int) -> list[int]:
    return [times[i] for i in frames(len(times), most)] if times else []
