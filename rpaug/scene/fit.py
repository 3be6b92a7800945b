"""Fit Gaussians of the static background and of the moving bodies to the recorded images of an episode."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from rpaug.errors import Unsupported
from rpaug.render.splat import Adam, Gradients, Rasteriser, Rates, Splats
from rpaug.scene.gaussian_view import to_bytes, view_of
from rpaug.scene.gaussians import Placement
from rpaug.scene.sampling import frames
from rpaug.scene.seeds import seeds
from rpaug.types import Gaussians, Scene

Progress = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """How a fit is done. One `step` looks at `batch` views; results do not depend on `threads`."""

    steps: int = 1500
    batch: int = 2
    threads: int = 2
    train_frames: int = 40  # at most, spread over the episode; the frames between them are held out
    depth_weight: float = 0.3
    checked_frames: int = 16  # at most, of those trained on and of those held out each
    last_rate: float = 0.03  # share of the rates left at the end (cosine schedule)
    rates: Rates = field(default_factory=Rates)


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


@dataclass(frozen=True)
class _Shot:
    """One recorded view, ready to be compared."""

    camera: str
    t: int
    rgb: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]


def fit(
    scene: Scene,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Gaussians, FitReport]:
    """Gaussians in their bodies' frames that show the scene as recorded, and how well they do.

    Loss: squared colour error and, weighted, squared relative error of the expected depth; Adam; views in an
    order drawn from `seed`. `progress` is told the share done. Raises Unsupported without depth or bodies.
    """
    settings = settings or FitSettings()
    start = time.perf_counter()
    if not scene.bodies:
        raise Unsupported("fitting Gaussians needs depth and instance masks, which give the bodies")
    begun = seeds(scene)
    placement = Placement.of(begun.ids, scene.bodies)
    trained = frames(scene.episode.length, settings.train_frames)
    shots = [_shot(scene, name, t) for t in trained for name in scene.episode.views]
    adam = Adam(Splats.of(begun), settings.rates, threads=settings.threads)
    _descend(adam, placement, shots, scene, settings, seed, progress)
    fitted = _gathered(adam.splats, begun)
    report = _judge(scene, fitted, trained, settings, seed, start)
    return fitted, report


def _shot(scene: Scene, name: str, t: int) -> _Shot:
    view = scene.episode.views[name]
    assert view.depth is not None
    depth = np.nan_to_num(view.depth(t), nan=0.0, posinf=0.0, neginf=0.0)
    return _Shot(name, t, view.rgb(t).astype(np.float32) / 255, depth)


def _descend(
    adam: Adam,
    placement: Placement,
    shots: Sequence[_Shot],
    scene: Scene,
    settings: FitSettings,
    seed: int,
    progress: Progress | None,
) -> None:
    rng = np.random.default_rng(seed)
    workers = [Rasteriser() for _ in range(settings.batch)]
    order: list[int] = []
    with ThreadPoolExecutor(min(settings.threads, settings.batch)) as pool:
        for step in range(settings.steps):
            if len(order) < settings.batch:
                order += rng.permutation(len(shots)).tolist()
            batch, order = order[: settings.batch], order[settings.batch :]
            jobs = [
                pool.submit(_gradients, worker, adam.splats, placement, shots[i], scene, settings)
                for worker, i in zip(workers, batch, strict=True)
            ]
            adam.step(_mean([job.result() for job in jobs]), _cosine(step, settings))
            if progress and step % 25 == 0:
                progress(step / settings.steps)


def _gradients(
    rasteriser: Rasteriser,
    splats: Splats,
    placement: Placement,
    shot: _Shot,
    scene: Scene,
    settings: FitSettings,
) -> Gradients:
    camera = scene.episode.views[shot.camera].camera
    rasteriser.forward(placement.place(splats, shot.t), view_of(camera, shot.t), surface=False)
    _, _, gradients = rasteriser.backward_squared_error(
        shot.rgb, None, shot.depth, settings.depth_weight
    )
    return placement.pull_back(gradients, shot.t)


def _mean(several: Sequence[Gradients]) -> Gradients:
    """The mean, summed in the order of the batch: threads do not change it."""
    first, *rest = several
    for name in ("means", "opacities", "sh", "quats", "scales"):
        total = getattr(first, name)
        for other in rest:
            total += getattr(other, name)
        total /= len(several)
    return first


def _cosine(step: int, settings: FitSettings) -> float:
    wave = 0.5 * (1 + np.cos(np.pi * step / settings.steps))
    return float(settings.last_rate + (1 - settings.last_rate) * wave)


def _gathered(splats: Splats, begun: Gaussians) -> Gaussians:
    assert splats.quats is not None
    assert splats.scales is not None
    unit = splats.quats / np.maximum(np.linalg.norm(splats.quats, axis=-1, keepdims=True), 1e-12)
    return Gaussians(
        splats.means.astype(np.float32), unit, splats.scales, splats.opacities, splats.sh, begun.ids
    )


def _judge(
    scene: Scene,
    fitted: Gaussians,
    trained: Sequence[int],
    settings: FitSettings,
    seed: int,
    start: float,
) -> FitReport:
    rest = sorted(set(range(scene.episode.length)) - set(trained))
    known = dict.fromkeys(_some(trained, settings.checked_frames), True)
    times = known | dict.fromkeys(_some(rest, settings.checked_frames), False)
    placement, splats = Placement.of(fitted.ids, scene.bodies), Splats.of(fitted)
    names = list(scene.episode.views)

    def look(at: tuple[str, int]) -> tuple[float, float, float]:
        name, t = at
        camera = scene.episode.views[name].camera
        drawn = Rasteriser().forward(placement.place(splats, t), view_of(camera, t))
        shot = _shot(scene, name, t)
        both = (drawn.depth_surface > 0) & (shot.depth > 0)
        off = np.abs(drawn.depth_surface - shot.depth)[both]
        truth = to_bytes(shot.rgb)
        image = to_bytes(drawn.colour)
        return psnr(image, truth), ssim(image, truth), float(np.median(off)) if len(off) else 0.0

    views = [(name, t) for t in times for name in names]
    with ThreadPoolExecutor(settings.threads) as pool:
        found = np.array(list(pool.map(look, views))).reshape(len(times), len(names), 3)
    which = np.array(list(times.values()))
    return FitReport(
        gaussians=len(fitted),
        steps=settings.steps,
        seconds=time.perf_counter() - start,
        train_db=float(found[which, :, 0].mean()),
        held_out_db=float(found[~which, :, 0].mean()) if rest else None,
        per_camera_db=dict(zip(names, found[..., 0].mean(0).tolist(), strict=True)),
        per_camera_ssim=dict(zip(names, found[..., 1].mean(0).tolist(), strict=True)),
        depth_error_mm=1e3 * float(np.median(found[..., 2])),
        seed=seed,
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
