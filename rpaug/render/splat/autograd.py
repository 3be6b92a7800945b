"""Splat rendering as a torch operation."""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from rpaug.render.splat import _reference
from rpaug.render.splat._numba import Rasteriser
from rpaug.render.splat._reference import Images
from rpaug.render.splat.settings import Settings, Splats, View

NAMES = ("means", "opacities", "sh", "quats", "scales", "covariances", "features")


def _array(tensor: Tensor | None) -> np.ndarray | None:
    if tensor is None:
        return None
    return tensor.detach().cpu().numpy()


class _NativeFunction(torch.autograd.Function):
    """The CPU kernels, forward and backward."""

    @staticmethod
    def forward(
        ctx: Any,
        view: View,
        settings: Settings,
        background: np.ndarray,
        threads: int,
        *tensors: Tensor | None,
    ) -> Any:
        arrays: dict[str, Any] = {
            name: _array(tensor) for name, tensor in zip(NAMES, tensors, strict=True)
        }
        for name, array in arrays.items():
            # Means keep their precision: they are rounded only after the camera's position is subtracted.
            if array is not None and name != "means":
                arrays[name] = array.astype(np.float32, copy=False)
        ctx.rasteriser = Rasteriser(settings, threads)
        ctx.kinds = [
            None if tensor is None else (tensor.dtype, tensor.device) for tensor in tensors
        ]
        images = ctx.rasteriser.forward(Splats(**arrays), view, background, surface=False)
        dtype, device = ctx.kinds[0]
        pictures = (images.color, images.depth_expected, images.alpha, images.features)
        return tuple(None if p is None else torch.as_tensor(p).to(device, dtype) for p in pictures)

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor | None) -> Any:
        gradients = ctx.rasteriser.backward(*(_array(pull) for pull in pulls))
        results = (getattr(gradients, name) for name in NAMES)
        moved = (
            None if result is None else torch.as_tensor(result).to(kind[1], kind[0])
            for result, kind in zip(results, ctx.kinds, strict=True)
        )
        return None, None, None, None, *moved


def rasterise(
    means: Float[Tensor, "n 3"],
    opacities: Float[Tensor, "n"],
    sh: Float[Tensor, "n k 3"],
    view: View,
    *,
    quats: Float[Tensor, "n 4"] | None = None,
    scales: Float[Tensor, "n 3"] | None = None,
    covariances: Float[Tensor, "n 6"] | None = None,
    features: Float[Tensor, "n f"] | None = None,
    background: float | Float[np.ndarray, "3"] = 0.0,
    settings: Settings | None = None,
    backend: str = "auto",
    threads: int = 1,
) -> Images:
    """Render tensors into tensors: color, expected depth, alpha, features; gradients flow back.

    Shapes, units and conventions are those of `Splats` and `Rendering`. `backend` is "numba", "reference",
    "gsplat", or "auto": gsplat for tensors on a CUDA device, numba otherwise. Raises MissingExtra or
    Unsupported where gsplat cannot run.
    """
    settings = settings or Settings()
    tensors = (means, opacities, sh, quats, scales, covariances, features)
    fill = np.array(np.broadcast_to(background, 3), np.float64)
    if backend == "auto":
        backend = "gsplat" if means.is_cuda else "numba"
    if backend == "gsplat":
        from rpaug.render.splat import _gsplat

        return _gsplat.rasterise(*tensors, view, settings, fill)[0]
    if backend == "reference":
        color = torch.as_tensor(fill, dtype=means.dtype)
        return _reference.rasterise(*tensors, view, settings, color)[0]
    if backend != "numba":
        raise ValueError(f"backend is {backend!r}; expected auto, numba, reference or gsplat")
    return Images(*_NativeFunction.apply(view, settings, fill, threads, *tensors))
