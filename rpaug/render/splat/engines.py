"""What a fit draws with: the CPU kernels, or torch, on the CPU for reference and on a GPU by gsplat."""

from typing import Protocol

import numpy as np
from jaxtyping import Float32

from rpaug.core.errors import Unsupported
from rpaug.render.splat._numba import Rasteriser
from rpaug.render.splat.loss import Errors, Loss
from rpaug.render.splat.settings import Gradients, Rendering, Settings, Splats, View

BACKENDS = ("auto", "numba", "reference", "gsplat")


class SplatEngine(Protocol):
    """Renders one view after another; a backward pass belongs to the latest view. One thread at a time.

    Arrays come and go as numpy. Targets, weights and depths are not to be changed in place while a fit goes on: on a
    GPU they are sent once.
    """

    def prepare(
        self, splats: Splats, view: View, background: Float32[np.ndarray, "3"] | float = 0.0
    ) -> None:
        """Draw, for a backward pass alone: no image is handed out."""
        ...

    def forward(
        self,
        splats: Splats,
        view: View,
        background: Float32[np.ndarray, "3"] | float = 0.0,
        surface: bool = True,
    ) -> Rendering:
        """Draw. Raises Unsupported where the surface is asked for and gsplat draws, which tells none."""
        ...

    def backward(
        self,
        color: Float32[np.ndarray, "h w 3"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
        alpha: Float32[np.ndarray, "h w"] | None = None,
        features: Float32[np.ndarray, "h w f"] | None = None,
    ) -> Gradients:
        """Gradients by the splats, from those by the images."""
        ...

    def backward_loss(
        self,
        loss: Loss,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
    ) -> tuple[Errors, Gradients]:
        """Errors of the images and the loss's gradients; what counts is said at `Rasteriser.backward_loss`."""
        ...

    def backward_squared_error(
        self,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
        depth_weight: float = 0.0,
    ) -> tuple[float, float, Gradients]:
        """`backward_loss` of squared errors: that of color, that of depth, and the gradients."""
        ...


def engine(
    backend: str = "auto",
    settings: Settings | None = None,
    *,
    threads: int = 1,
    keep_order: int = 1,
    dtype: str = "float32",
) -> SplatEngine:
    """An engine on the CPU kernels ("numba", "auto"), on torch ("reference", either dtype) or on CUDA ("gsplat").

    `threads` and `keep_order` are the CPU kernels' alone. Raises Unsupported for a backend that does not compute in
    `dtype`, Unsupported or MissingExtra for one that cannot run here.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend is {backend!r}; expected {', '.join(BACKENDS)}")
    if dtype not in ("float32", "float64"):
        raise ValueError(f"dtype is {dtype!r}; expected float32 or float64")
    if dtype != "float32" and backend != "reference":
        raise Unsupported(f"backend {backend} computes in float32; backend reference in {dtype}")
    if backend in ("auto", "numba"):
        return Rasteriser(settings, threads, keep_order)
    from rpaug.render.splat._torch import TorchRasteriser  # only here: it brings torch

    return TorchRasteriser(backend, dtype, settings or Settings())
