"""How fast each backend renders Gaussians, and how far its images and gradients are from the float64 reference."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float32

from rpaug.core import geometry
from rpaug.core.errors import MissingExtra, RpaugError, Unsupported
from rpaug.core.types import CameraView, Episode, Gaussians
from rpaug.gaussians.gaussians import LiftedImage, joined, lifted
from rpaug.pipeline.pareto import Panel
from rpaug.render.splat import Rasteriser, Splats, View
from rpaug.render.splat.autograd import rasterise

NAMES = tuple(field.name for field in fields(Splats))
# The reference in float32 is left out unless asked for: denormal numbers slow it down a hundredfold.
ENGINES = ("numba/float32", "numba/float64", "reference/float64", "gsplat/float32")
KNOWN = (*ENGINES, "reference/float32", "gsplat/float64")
AFFORDABLE = (
    2_000_000  # pixels x Gaussians: what the reference holds in memory, about 100 bytes each
)
PATIENCE = 2.0  # seconds after which a timing is not repeated again
UNEVEN = 1e-3  # of depth, by which lifted Gaussians are put apart
CLOSE = 1e-5  # of full scale: the share of values farther off is told
PANELS = (
    Panel("forward", "forward_ms", "color_worst", "ms, forward",
          "largest color error", higher=False, logarithmic=True),
    Panel("forward and backward", "both_ms", "gradient_error", "ms, forward + backward",
          "gradients' error, relative L2", higher=False, logarithmic=True),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class RenderSetting:
    """Every size with every number of Gaussians and every engine, which is a backend with a precision."""

    sizes: tuple[tuple[int, int], ...] = ((32, 32), (128, 128), (640, 480))
    counts: tuple[int, ...] = (1_000, 10_000, 100_000)
    features: int = 0
    engines: tuple[str, ...] = ENGINES
    threads: int = 2
    repeats: int = 7

    def __post_init__(self) -> None:
        for name in self.engines:
            if name not in KNOWN:
                raise RpaugError(f"no engine is called {name!r}; there are: {', '.join(KNOWN)}")


@dataclass(frozen=True)
class RenderRow:
    """One backend on one scene; milliseconds are the fastest of the repeats, on the wall and of all threads.

    Errors are those to the float64 reference, on a crop that the reference can afford: colors of full scale 1,
    the share of values that are off by more than 1e-5, and the relative L2 distance of the gradients of the one
    parameter (means, opacities, ...) that is worst. None: not affordable.
    """

    scene: str
    width: int
    height: int
    gaussians: int
    features: int
    engine: str
    threads: int
    forward_ms: float | None
    both_ms: float | None
    forward_cpu_ms: float | None
    both_cpu_ms: float | None
    color_worst: float | None
    color_over: float | None
    gradient_error: float | None


class RenderScene(NamedTuple):
    """What is rendered; `name` begins its name for people."""

    name: str
    splats: Splats
    view: View


class Engine(NamedTuple):
    """A backend with a scene loaded: an image, and an image with the gradients of its dot product with `pull`."""

    forward: Callable[[], Float32[np.ndarray, "h w 3"]]
    both: Callable[
        [Float32[np.ndarray, "h w 3"]],
        tuple[Float32[np.ndarray, "h w 3"], dict[str, np.ndarray]],
    ]


def strewn(width: int, height: int, count: int, features: int = 0) -> RenderScene:
    """Gaussians about as large as their share of the image, strewn over depths of 0.8 to 3 m."""
    rng = np.random.default_rng(0)
    focal = 0.9 * width
    z = rng.uniform(0.8, 3.0, count)
    u, v = rng.uniform(-0.05, 1.05, (2, count)) * [[width], [height]]
    means = np.stack([(u - width / 2) / focal * z, (v - height / 2) / focal * z, z], 1)
    footprint = z / focal * math.sqrt(width * height / count)
    scales = np.exp(rng.normal(0, 0.4, (count, 3))) * footprint[:, None]
    splats = Splats(
        means.astype(np.float32),
        rng.uniform(0.1, 0.95, count).astype(np.float32),
        rng.normal(0, 0.5, (count, 1, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        scales.astype(np.float32),
        features=rng.normal(size=(count, features)).astype(np.float32) if features else None,
    )
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    return RenderScene("", splats, View(K, np.eye(4), width, height))


def strewn_scenes(setting: RenderSetting) -> list[RenderScene]:
    """Strewn Gaussians of every size and number."""
    return [
        strewn(width, height, count, setting.features)
        for width, height in setting.sizes
        for count in setting.counts
    ]


def recorded_scenes(episode: Episode, t: int, strides: Sequence[int]) -> list[RenderScene]:
    """What all cameras with depth recorded at `t`, every so-many-th pixel a Gaussian, seen from each of them.

    Each Gaussian is put up to 0.1 % nearer or farther: those of one row of pixels on a table are otherwise equally far,
    and rounding alone would say which covers which. Raises Unsupported where no camera has depth.
    """
    rng = np.random.default_rng(0)
    views = {name: view for name, view in episode.views.items() if view.depth is not None}
    if not views:
        raise Unsupported("no camera of this episode has depth: there is nothing to lift")
    found = []
    for stride in strides:
        splats = Splats.of(joined(_lifted(view, t, stride) for view in views.values()))
        for name, view in views.items():
            camera = view.camera
            centre = camera.cam_to_world[t][:3, 3]
            far = 1 + rng.uniform(-UNEVEN, UNEVEN, (len(splats), 1))
            means = (centre + far * (splats.means - centre)).astype(np.float32)
            pose = geometry.inverse(camera.cam_to_world[t])
            eye = View(camera.K, pose, camera.width, camera.height)
            found.append(RenderScene(f"{name}, ", replace(splats, means=means), eye))
    return found


def _lifted(view: CameraView, t: int, stride: int) -> Gaussians:
    assert view.depth is not None
    depth = view.depth(t)
    use = np.zeros(depth.shape, bool)
    use[::stride, ::stride] = True
    ids = np.zeros(depth.shape, np.int32) if view.ids is None else view.ids(t)
    camera = view.camera
    return lifted(
        LiftedImage(view.rgb(t), depth, ids, camera.K, camera.cam_to_world[t], use), stride
    )


def run(
    setting: RenderSetting,
    shown: Sequence[RenderScene],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[RenderRow], dict[str, str]]:
    """All rows, and why backends were skipped. Each backend is compiled before its first timing."""
    rows: list[RenderRow] = []
    skipped: dict[str, str] = {}
    for number, scene in enumerate(shown):
        truth = _RenderTruth(scene)
        for step, engine in enumerate(setting.engines):
            progress(number * len(setting.engines) + step, len(shown) * len(setting.engines))
            if engine not in skipped:
                try:
                    rows.append(_row(setting, scene, truth, engine))
                except (MissingExtra, Unsupported) as error:
                    skipped[engine] = str(error)
    progress(1, 1)
    return rows, skipped


class _RenderTruth:
    """The reference's image and gradients on a crop around the middle that it can afford."""

    def __init__(self, scene: RenderScene) -> None:
        self.view = _crop(scene.view, AFFORDABLE // max(len(scene.splats), 1))
        shape = (self.view.height, self.view.width, 3)
        self.pull = np.random.default_rng(1).normal(size=shape).astype(np.float32)
        engine = _tensors(scene.splats, self.view, "reference", "float64", 1)
        self.image, self.gradients = engine.both(self.pull)

    def errors(self, engine: Engine) -> tuple[float, float, float]:
        """Largest color error, share of values over `CLOSE`, relative L2 of the worst parameter's gradients."""
        image, gradients = engine.both(self.pull)
        off = np.abs(image.astype(np.float64) - self.image)
        apart = [
            float(np.linalg.norm(gradients[name] - true)) / max(float(np.linalg.norm(true)), 1e-300)
            for name, true in self.gradients.items()
        ]
        return float(off.max()), float((off > CLOSE).mean()), max(apart)


def _row(setting: RenderSetting, scene: RenderScene, truth: _RenderTruth, name: str) -> RenderRow:
    view, count = scene.view, len(scene.splats)
    worst, over, gradient = truth.errors(_engine(scene.splats, truth.view, name, setting.threads))
    pixels = view.width * view.height
    forward: tuple[float | None, float | None] = (None, None)
    both = forward
    if not name.startswith("reference") or pixels * count <= AFFORDABLE:
        engine = _engine(scene.splats, view, name, setting.threads)
        pull = np.ones((view.height, view.width, 3), np.float32)
        forward = _fastest(engine.forward, setting.repeats)
        both = _fastest(lambda: engine.both(pull), setting.repeats)
    return RenderRow(
        f"{scene.name}{view.width}x{view.height}, {count}", view.width, view.height, count,
        setting.features, name, setting.threads, forward[0], both[0], forward[1], both[1],
        worst, over, gradient,
    )  # fmt: skip


def _engine(splats: Splats, view: View, name: str, threads: int) -> Engine:
    backend, dtype = name.split("/")
    if backend != "numba":
        return _tensors(splats, view, backend, dtype, threads)
    # Without torch in between, and with buffers kept, as a fit uses it. float64: of the means only.
    splats = replace(splats, means=splats.means.astype(dtype))
    kernels = Rasteriser(threads=threads)

    def forward() -> np.ndarray:
        return kernels.forward(splats, view, surface=False).color

    def both(pull: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        image = forward()
        gradients = vars(kernels.backward(pull))
        return image, {name: gradients[name] for name in NAMES if gradients[name] is not None}

    return Engine(forward, both)


def _tensors(splats: Splats, view: View, backend: str, dtype: str, threads: int) -> Engine:
    """Any backend through torch, on the GPU for gsplat; images come back to the CPU, so the GPU has finished."""
    # Without a GPU the tensors stay, and the backend itself says what is missing.
    device = "cuda" if backend == "gsplat" and torch.cuda.is_available() else "cpu"
    given: dict[str, Any] = {name: getattr(splats, name) for name in NAMES}
    kind: dict[str, Any] = {"dtype": getattr(torch, dtype), "device": device}
    tensors = {
        name: None if array is None else torch.as_tensor(array).to(**kind).requires_grad_()
        for name, array in given.items()
    }

    def images() -> torch.Tensor:
        return rasterise(**tensors, view=view, backend=backend, threads=threads).color  # type: ignore[arg-type]

    def forward() -> np.ndarray:
        with torch.no_grad():
            return images().cpu().numpy()

    def both(pull: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        image = images()
        known = {name: tensor for name, tensor in tensors.items() if tensor is not None}
        found = torch.autograd.grad(
            (image * torch.as_tensor(pull).to(image)).sum(), list(known.values()), allow_unused=True
        )
        pairs = zip(known.items(), found, strict=True)
        gradients = {
            name: (torch.zeros_like(tensor) if slope is None else slope).cpu().numpy()
            for (name, tensor), slope in pairs
        }
        return image.detach().cpu().numpy(), gradients

    return Engine(forward, both)


def _crop(view: View, pixels: int) -> View:
    """The middle of the view, at most so many pixels of it."""
    shrink = min(1.0, math.sqrt(pixels / (view.width * view.height)))
    width, height = (max(1, int(side * shrink)) for side in (view.width, view.height))
    K = view.K.copy()
    K[0, 2] -= (view.width - width) // 2
    K[1, 2] -= (view.height - height) // 2
    return replace(view, K=K, width=width, height=height)


def _fastest(call: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """Milliseconds on the wall and of all threads, each the least of the repeats."""
    call()
    best = [math.inf, math.inf]
    start = time.perf_counter()
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        spent = time.perf_counter() - wall, time.process_time() - cpu
        best = [min(pair) for pair in zip(best, spent, strict=True)]
        if time.perf_counter() - start > PATIENCE:
            break
    return 1e3 * best[0], 1e3 * best[1]
