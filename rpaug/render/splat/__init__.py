"""Draw 3D Gaussians, and carry image losses back to them.

`render` for arrays, `Rasteriser` and `Adam` for a fitting loop; `rasterise` of `autograd` for torch, which is not
imported before it is asked for.
"""

import numpy as np
from jaxtyping import Float

from rpaug.core.types import Gaussians
from rpaug.render.splat._numba import Rasteriser
from rpaug.render.splat._threads import cores, shared
from rpaug.render.splat.adam import Adam, Rates
from rpaug.render.splat.engines import SplatEngine, engine
from rpaug.render.splat.loss import Errors, Loss
from rpaug.render.splat.settings import Gradients, Rendering, Settings, Splats, View

__all__ = [
    "Adam",
    "Errors",
    "Gradients",
    "Loss",
    "Rasteriser",
    "Rates",
    "Rendering",
    "Settings",
    "SplatEngine",
    "Splats",
    "View",
    "autograd",
    "cores",
    "engine",
    "render",
    "shared",
    "warm",
]


def warm(features: int = 0) -> None:
    """Compile the CPU kernels for this many features ahead of time, or load them from the cache."""
    one = np.zeros((1, max(features, 1)), np.float32)
    splats = Splats(
        means=np.array([[0, 0, 1]], np.float32),
        opacities=np.ones(1, np.float32),
        sh=np.zeros((1, 1, 3), np.float32),
        quats=np.ones((1, 4), np.float32),
        scales=np.ones((1, 3), np.float32),
        features=one if features else None,
    )
    engine = Rasteriser()
    picture = engine.forward(splats, View(np.eye(3), np.eye(4), 1, 1))
    engine.backward_loss(Loss(), picture.color)
    Adam(splats).step(engine.backward(picture.color))


def render(
    gaussians: Splats | Gaussians,
    K: Float[np.ndarray, "3 3"],
    world_to_camera: Float[np.ndarray, "4 4"],
    width: int,
    height: int,
    *,
    features: Float[np.ndarray, "n f"] | None = None,
    background: float | Float[np.ndarray, "3"] = 0.0,
    settings: Settings | None = None,
    backend: str = "auto",
    threads: int | None = None,
) -> Rendering:
    """Images of Gaussians given in world coordinates, from one camera.

    OpenCV axes, pixel centres at integer coordinates, metres. `features` are blended like colors and replace
    those of `Splats`. `backend` is "numba" (also "auto": arrays live on the CPU), "reference" (float64, slow)
    or "gsplat" (CUDA). `threads` defaults to all cores; give 1 when views are rendered side by side.
    """
    if isinstance(gaussians, Gaussians):
        gaussians = Splats.of(gaussians)
    if features is not None:
        gaussians = gaussians.with_features(features)
    view, settings = View(K, world_to_camera, width, height), settings or Settings()
    fill = np.array(np.broadcast_to(background, 3), np.float64)
    if backend == "reference":
        from rpaug.render.splat import _reference  # only here: it brings torch

        return _reference.render(gaussians, view, settings, fill)
    if backend == "gsplat":
        from rpaug.render.splat import _gsplat

        return _gsplat.render(gaussians, view, settings, fill)
    if backend not in ("auto", "numba"):
        raise ValueError(f"backend is {backend!r}; expected auto, numba, reference or gsplat")
    return Rasteriser(settings, threads or cores()).forward(gaussians, view, fill)
