"""What a fit asks of a backend: the image of some splats, and a loss's gradients by them."""

from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from rpaug.core.errors import Unsupported
from rpaug.render.splat._images import HALF_COVERED
from rpaug.render.splat._numba import Rasteriser
from rpaug.render.splat.autograd import NAMES, rasterise
from rpaug.render.splat.loss import Errors, Loss
from rpaug.render.splat.settings import Gradients, Settings, Splats, View

BACKENDS = ("auto", "numba", "reference", "gsplat")


class Worker(Protocol):
    """Serves one view of a fit; one thread at a time."""

    def look(self, splats: Splats, view: View) -> Float32[np.ndarray, "h w 3"]:
        """The image."""
        ...

    def pull(
        self,
        splats: Splats,
        view: View,
        loss: Loss,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
    ) -> tuple[Errors, Gradients]:
        """Errors of the image, and the loss's gradients; arguments are those of `Rasteriser.backward_loss`."""
        ...


def worker(
    backend: str = "auto",
    dtype: str = "float32",
    settings: Settings | None = None,
    threads: int = 1,
    keep_order: int = 1,
) -> Worker:
    """A worker on the CPU kernels ("numba", "auto"), on torch ("reference", either dtype) or on CUDA ("gsplat").

    `keep_order` is the CPU kernels' alone. Raises Unsupported for a backend that does not compute in `dtype`, or
    that cannot run here.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend is {backend!r}; expected {', '.join(BACKENDS)}")
    if dtype not in ("float32", "float64"):
        raise ValueError(f"dtype is {dtype!r}; expected float32 or float64")
    if backend == "reference":
        return _Torch(backend, dtype, settings or Settings())
    if dtype != "float32":
        raise Unsupported(f"backend {backend} computes in float32; backend reference in {dtype}")
    if backend == "gsplat":
        return _Torch(backend, dtype, settings or Settings())
    return _NativeBackend(settings, threads, keep_order)


class _NativeBackend:
    """The CPU kernels."""

    def __init__(self, settings: Settings | None, threads: int, keep_order: int) -> None:
        self._engine = Rasteriser(settings, threads, keep_order)

    def look(self, splats: Splats, view: View) -> Float32[np.ndarray, "h w 3"]:
        return self._engine.forward(splats, view, surface=False).color

    def pull(
        self,
        splats: Splats,
        view: View,
        loss: Loss,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
    ) -> tuple[Errors, Gradients]:
        self._engine.forward(splats, view, surface=False)
        return self._engine.backward_loss(loss, target, weight, depth)


class _Torch:
    """Autograd through a torch backend. `image_motion` is worked out from the gradients by the means."""

    def __init__(self, backend: str, dtype: str, settings: Settings) -> None:
        device = "cuda" if backend == "gsplat" else "cpu"
        self._kind: dict[str, Any] = {"dtype": getattr(torch, dtype), "device": device}
        self._backend, self._settings = backend, settings

    def look(self, splats: Splats, view: View) -> Float32[np.ndarray, "h w 3"]:
        with torch.no_grad():
            images = self._images({name: self._leaf(splats, name) for name in NAMES}, view)
        return images.color.cpu().numpy().astype(np.float32)

    def pull(
        self,
        splats: Splats,
        view: View,
        loss: Loss,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
    ) -> tuple[Errors, Gradients]:
        leaves = {name: self._leaf(splats, name) for name in NAMES}
        images = self._images(leaves, view)
        known = torch.zeros_like(images.alpha) if depth is None else self._tensor(depth)
        share = torch.ones_like(images.alpha) if weight is None else self._tensor(weight)
        off = images.color - self._tensor(target)
        counted = (known > 0) & (images.alpha >= HALF_COVERED)
        far = (images.depth - known) / torch.where(known > 0, known, 1.0)
        parts = {
            "l2": (off**2).mean(-1),
            "l1": off.abs().mean(-1),
            "ssim": torch.zeros_like(known),
            "depth": torch.where(counted, far, 0.0) ** 2,
        }
        if loss.ssim > 0:
            seen = images.color.detach()
            fitted = (share > 0)[..., None]
            x = torch.where(fitted, images.color, seen)
            y = torch.where(fitted, self._tensor(target), seen)
            parts["ssim"] = 1 - similarity(x, y)
        means = {name: (share * part).mean() for name, part in parts.items()}
        total = sum(getattr(loss, name) * mean for name, mean in means.items())
        assert isinstance(total, Tensor)
        total.backward()
        slopes: dict[str, Any] = {
            name: None if leaf is None else _gradient(leaf) for name, leaf in leaves.items()
        }
        motion = _motion(splats, view, slopes["means"])
        errors = Errors(**{name: mean.item() for name, mean in means.items()})
        return errors, Gradients(**slopes, image_motion=motion)

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(array, **self._kind)

    def _leaf(self, splats: Splats, name: str) -> Tensor | None:
        array = getattr(splats, name)
        return None if array is None else self._tensor(array).detach().clone().requires_grad_()

    def _images(self, leaves: dict[str, Any], view: View) -> Any:
        return rasterise(**leaves, view=view, settings=self._settings, backend=self._backend)


def _motion(splats: Splats, view: View, by_means: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """|d loss / d centre on the image| as if only the centre moved with the mean, not the shape."""
    turn, shift = view.world_to_camera[:3, :3], view.world_to_camera[:3, 3]
    z = np.maximum(splats.means @ turn[2] + shift[2], 0)
    sideways = (by_means @ turn[:2].T) * z[:, None] / np.diag(view.K)[:2]
    return np.linalg.norm(sideways, axis=-1).astype(np.float32)


def _gradient(leaf: Tensor) -> np.ndarray:
    """A leaf's gradient, zeros if nothing reached it."""
    return (torch.zeros_like(leaf) if leaf.grad is None else leaf.grad).cpu().numpy()


def similarity(x: Float[Tensor, "h w 3"], y: Float[Tensor, "h w 3"]) -> Float[Tensor, "h w"]:
    """SSIM around each pixel of two images in 0..1, the mean of the channels (Wang et al. 2004), zeros beyond."""
    taps = torch.exp(-0.5 * ((torch.arange(11, dtype=x.dtype, device=x.device) - 5) / 1.5) ** 2)
    taps = taps / taps.sum()

    def blurred(image: Tensor) -> Tensor:
        planes = image.permute(2, 0, 1)[:, None]
        across = torch.nn.functional.conv2d(planes, taps.view(1, 1, 1, -1), padding=(0, 5))
        return torch.nn.functional.conv2d(across, taps.view(1, 1, -1, 1), padding=(5, 0))[:, 0]

    a, b = blurred(x), blurred(y)
    spread_x, spread_y = blurred(x * x) - a * a, blurred(y * y) - b * b
    alike, varied = 2 * a * b + 1e-4, 2 * (blurred(x * y) - a * b) + 9e-4
    return (alike * varied / ((a * a + b * b + 1e-4) * (spread_x + spread_y + 9e-4))).mean(0)
