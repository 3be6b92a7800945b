"""Fit Gaussians of the static background and of the moving bodies to the recorded images of an episode."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from jaxtyping import Float, Float64, UInt8

from rpaug.errors import Unsupported
from rpaug.render.splat import Rasteriser, Splats
from rpaug.scene.descent import Descent, FitSettings, Shot
from rpaug.scene.gaussian_view import SHARP, plane_depth, standing, to_bytes, view_of
from rpaug.scene.gaussians import Placement
from rpaug.scene.irradiance import even
from rpaug.scene.sampling import frames
from rpaug.scene.seeds import seeds
from rpaug.types import Body, Gaussians, Scene

Progress = Callable[[float], None]


@dataclass(frozen=True)
class FitReport:
    """How well the Gaussians show the recorded views, in decibels of PSNR (up) and SSIM (up), means over views.

    `train` are views at times that were fitted, `held_out` at times that were not. `per_camera` is over both.
    """

    gaussians: int
    steps: int
    seconds: float
    train_db: float
    held_out_db: float | None
    per_camera_db: dict[str, float]
    per_camera_ssim: dict[str, float]
    depth_error_mm: float  # median over pixels, of the surface's depth
    seed: int
    bodies: tuple[Body, ...] = field(repr=False)  # with tracks as they settled
    drift: Mapping[str, Float64[np.ndarray, "t 4 4"]] = field(repr=False)
    irradiance: Float64[np.ndarray, "9"] = field(repr=False)


def fit(
    scene: Scene,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Gaussians, FitReport]:
    """Gaussians in their bodies' frames that show the scene as recorded, and how well they do.

    Loss: squared colour error and, weighted, squared relative error of the expected depth; Adam; views in an
    order drawn from `seed`. Tracks of bodies and poses of moving cameras give way too: the Gaussians belong
    to the report's `bodies`, `drift` and `irradiance`, and `fitted` puts all into a scene. `progress` is told the share
    done. Raises Unsupported without depth or bodies.
    """
    settings = settings or FitSettings()
    start = time.perf_counter()
    if not scene.bodies:
        raise Unsupported("fitting Gaussians needs depth and instance masks, which give the bodies")
    begun = seeds(scene)
    trained = frames(scene.episode.length, settings.train_frames)
    shots = [_shot(scene, name, t) for t in trained for name in scene.episode.views]
    descent = Descent(begun, scene, trained, settings)
    rng = np.random.default_rng(seed)
    with ThreadPoolExecutor(settings.threads) as pool:
        for step, batch in enumerate(_batches(shots, settings.steps, settings.batch, rng)):
            descent.step(batch, _cosine(step / settings.steps, settings.last_rate), pool)
            if progress and step % 25 == 0:
                progress(step / settings.steps)
    gaussians, bodies, drift = descent.result()
    shown = replace(
        scene, gaussians=gaussians, bodies=bodies, drift=drift, irradiance=descent.light
    )
    return gaussians, _judge(shown, trained, settings, seed, start)


def fitted(
    scene: Scene,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Scene, FitReport]:
    """The scene with fitted Gaussians and the tracks and camera poses they belong to, and how well they do."""
    gaussians, report = fit(scene, settings=settings, seed=seed, progress=progress)
    return (
        replace(
            scene,
            gaussians=gaussians,
            bodies=report.bodies,
            drift=report.drift,
            irradiance=report.irradiance,
        ),
        report,
    )


def _shot(scene: Scene, name: str, t: int) -> Shot:
    view = scene.episode.views[name]
    assert view.depth is not None
    depth = np.nan_to_num(view.depth(t), nan=0.0, posinf=0.0, neginf=0.0)
    return Shot(name, t, view.rgb(t).astype(np.float32) / 255, depth)


def _batches(
    shots: Sequence[Shot], steps: int, size: int, rng: np.random.Generator
) -> Iterator[list[Shot]]:
    """Views for each step, every one as often as any other, in random order."""
    order: list[int] = []
    for _ in range(steps):
        while len(order) < size:
            order += rng.permutation(len(shots)).tolist()
        yield [shots[i] for i in order[:size]]
        order = order[size:]


def _cosine(done: float, last: float) -> float:
    """From 1 to `last` as `done` goes from 0 to 1 (Loshchilov and Hutter 2017)."""
    return float(last + (1 - last) * 0.5 * (1 + np.cos(np.pi * done)))


def _judge(
    scene: Scene,
    trained: Sequence[int],
    settings: FitSettings,
    seed: int,
    start: float,
) -> FitReport:
    rest = sorted(set(range(scene.episode.length)) - set(trained))
    known = dict.fromkeys(_some(trained, settings.checked_frames), True)
    times = known | dict.fromkeys(_some(rest, settings.checked_frames), False)
    assert scene.gaussians is not None
    splats = Splats.of(scene.gaussians)
    placement = Placement.of(scene.gaussians.ids, scene.bodies, scene.irradiance)
    names = list(scene.episode.views)

    def look(at: tuple[str, int]) -> tuple[float, float, float]:
        name, t = at
        eye, placed = standing(scene, name), placement.place(splats, t)
        drawn = Rasteriser(SHARP).forward(placed, view_of(eye, t))
        depth = plane_depth(drawn, placed, eye, t)
        shot = _shot(scene, name, t)
        off = np.abs(depth - shot.depth)[(depth > 0) & (shot.depth > 0)]
        truth = to_bytes(shot.rgb)
        image = to_bytes(drawn.colour)
        return psnr(image, truth), ssim(image, truth), float(np.median(off)) if len(off) else 0.0

    views = [(name, t) for t in times for name in names]
    with ThreadPoolExecutor(settings.threads) as pool:
        found = np.array(list(pool.map(look, views))).reshape(len(times), len(names), 3)
    which = np.array(list(times.values()))
    return FitReport(
        gaussians=len(scene.gaussians),
        steps=settings.steps,
        seconds=time.perf_counter() - start,
        train_db=float(found[which, :, 0].mean()),
        held_out_db=float(found[~which, :, 0].mean()) if rest else None,
        per_camera_db=dict(zip(names, found[..., 0].mean(0).tolist(), strict=True)),
        per_camera_ssim=dict(zip(names, found[..., 1].mean(0).tolist(), strict=True)),
        depth_error_mm=1e3 * float(np.median(found[..., 2])),
        seed=seed,
        bodies=scene.bodies,
        drift=scene.drift,
        irradiance=even() if scene.irradiance is None else scene.irradiance,
    )


def _some(times: Sequence[int], most: int) -> list[int]:
    return [times[i] for i in frames(len(times), most)] if times else []


def psnr(image: UInt8[np.ndarray, "h w 3"], truth: UInt8[np.ndarray, "h w 3"]) -> float:
    """Peak signal-to-noise ratio in decibels, at most 100."""
    error = np.mean((image.astype(np.float64) - truth) ** 2)
    return float(10 * np.log10(255.0**2 / max(error, 255.0**2 * 1e-10)))


def ssim(image: UInt8[np.ndarray, "h w 3"], truth: UInt8[np.ndarray, "h w 3"]) -> float:
    """Structural similarity (Wang et al. 2004): 11x11 Gaussian window, sigma 1.5, mean over channels."""
    x, y = image.astype(np.float64), truth.astype(np.float64)

    def blur(a: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
        return cv2.GaussianBlur(a, (11, 11), 1.5)[5:-5, 5:-5]

    mx, my = blur(x), blur(y)
    vx, vy, both = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    a, b = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    value = (2 * mx * my + a) * (2 * both + b) / ((mx * mx + my * my + a) * (vx + vy + b))
    return float(value.mean()) if value.size else 1.0
