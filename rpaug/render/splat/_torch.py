"""The engine on torch: autograd through a torch backend, on the device that the backend runs on."""

import threading
import weakref
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from rpaug.core.errors import Unsupported
from rpaug.render.splat import _reference
from rpaug.render.splat._images import HALF_COVERED
from rpaug.render.splat._reference import Images, Projected
from rpaug.render.splat.loss import Errors, Loss
from rpaug.render.splat.settings import Gradients, Rendering, Settings, Splats, View

NAMES = ("means", "opacities", "sh", "quats", "scales", "covariances", "features")
HELD_BYTES = 4 << 30  # of targets, weights and depths on the device, at most
SAMPLES = 1024  # values of an array that are compared before its copy on the device is used


class DeviceArrays:
    """Copies on a device of arrays that live on the host, for as long as they do; the longest unused go first.

    An array is known by itself, not by what it holds. Some of its values are compared all the same, and an array
    that was changed is sent again.
    """

    def __init__(self, most_bytes: int = HELD_BYTES) -> None:
        self._most, self._bytes = most_bytes, 0
        self._held: OrderedDict[tuple[Any, ...], tuple[Any, np.ndarray, Tensor]] = OrderedDict()
        self._lock = threading.RLock()  # a dying array may call `_drop` in any thread

    def of(self, array: np.ndarray, dtype: torch.dtype, device: str) -> Tensor:
        """The array's copy."""
        key = (id(array), dtype, device)
        sample = array.reshape(-1)[:: max(1, array.size // SAMPLES)]
        with self._lock:
            found = self._held.get(key)
            if found and found[0]() is array and np.array_equal(found[1], sample, equal_nan=True):
                self._held.move_to_end(key)
                return found[2]
            self._drop(key)
            copy = torch.tensor(array, dtype=dtype, device=device)
            last = weakref.ref(array, lambda _: self._drop(key))
            self._held[key] = (last, sample.copy(), copy)
            self._bytes += copy.nbytes
            while self._bytes > self._most and len(self._held) > 1:
                self._drop(next(iter(self._held)))
            return copy

    def _drop(self, key: tuple[Any, ...]) -> None:
        with self._lock:
            found = self._held.pop(key, None)
            if found:
                self._bytes -= found[2].nbytes

    def __len__(self) -> int:
        return len(self._held)


HELD = DeviceArrays()
"""One for all engines of a process: a fit's views come to whichever engine is free."""


class TorchRasteriser:
    """An `engines.SplatEngine`. `image_motion` is worked out from the gradients by the means."""

    def __init__(self, backend: str, dtype: str, settings: Settings) -> None:
        self.settings, self._gsplat = settings, None
        if backend == "gsplat":
            from rpaug.render.splat import _gsplat

            _gsplat.kernels()  # what is missing is said before a fit begins
            self._gsplat = _gsplat
        self._dtype: torch.dtype = getattr(torch, dtype)
        self._device = self._gsplat.DEVICE if self._gsplat else "cpu"

    def prepare(
        self, splats: Splats, view: View, background: Float32[np.ndarray, "3"] | float = 0.0
    ) -> None:
        self._splats, self._view = splats, view
        self._leaves: dict[str, Any] = {name: self._leaf(splats, name) for name in NAMES}
        fill = np.array(np.broadcast_to(background, 3), np.float64)
        self._images, self._surface, self._seen = self._drawn(view, fill)

    def _drawn(self, view: View, fill: np.ndarray) -> tuple[Images, Tensor | None, Projected]:
        """Images, the surface's index where the backend tells it, and what was drawn."""
        if self._gsplat:
            images, seen = self._gsplat.rasterise(
                **self._leaves, view=view, settings=self.settings, background=fill
            )
            return images, None, seen
        color = torch.as_tensor(fill, dtype=self._dtype)
        return _reference.rasterise(
            **self._leaves, view=view, settings=self.settings, background=color
        )

    def forward(
        self,
        splats: Splats,
        view: View,
        background: Float32[np.ndarray, "3"] | float = 0.0,
        surface: bool = True,
    ) -> Rendering:
        if surface and self._gsplat:
            raise Unsupported("backend gsplat tells no surface; backend numba does")
        self.prepare(splats, view, background)
        color, depth, alpha, features = (
            None if image is None else _array(image) for image in self._images
        )
        assert color is not None
        assert depth is not None
        assert alpha is not None
        index, deep = np.full(depth.shape, -1, np.int32), np.zeros(len(splats) + 1, np.float32)
        if surface and self._surface is not None:
            index = self._surface.numpy().astype(np.int32)
            deep[self._seen.rows.numpy()] = _array(self._seen.depth)
        return Rendering(
            color=color,
            depth_expected=depth,
            depth_surface=deep[index],  # its last value stands for index -1
            surface_index=index,
            alpha=alpha,
            features=features,
            nonfinite=self._seen.nonfinite,
        )

    def backward(
        self,
        color: Float32[np.ndarray, "h w 3"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
        alpha: Float32[np.ndarray, "h w"] | None = None,
        features: Float32[np.ndarray, "h w f"] | None = None,
    ) -> Gradients:
        pulled = [
            (image, torch.as_tensor(pull, dtype=image.dtype, device=image.device))
            for image, pull in zip(self._images, (color, depth, alpha, features), strict=True)
            if image is not None and pull is not None
        ]
        torch.autograd.backward([image for image, _ in pulled], [pull for _, pull in pulled])
        return self._gradients()

    def backward_loss(
        self,
        loss: Loss,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
    ) -> tuple[Errors, Gradients]:
        images = self._images
        wanted = self._held(target)
        known = torch.zeros_like(images.alpha) if depth is None else self._held(depth)
        share = torch.ones_like(images.alpha) if weight is None else self._held(weight)
        off = images.color - wanted
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
            y = torch.where(fitted, wanted, seen)
            parts["ssim"] = 1 - similarity(x, y)
        means = {name: (share * part).mean() for name, part in parts.items()}
        total = sum(getattr(loss, name) * mean for name, mean in means.items())
        assert isinstance(total, Tensor)
        total.backward()
        found = torch.stack([means[name].detach() for name in parts]).tolist()
        return Errors(**dict(zip(parts, found, strict=True))), self._gradients()

    def backward_squared_error(
        self,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
        depth_weight: float = 0.0,
    ) -> tuple[float, float, Gradients]:
        errors, gradients = self.backward_loss(Loss(depth=depth_weight), target, weight, depth)
        return errors.l2, errors.depth, gradients

    def _held(self, array: np.ndarray) -> Tensor:
        return HELD.of(array, self._dtype, self._device)

    def _leaf(self, splats: Splats, name: str) -> Tensor | None:
        array = getattr(splats, name)
        if array is None:
            return None
        # gsplat's backend takes the camera's place from the means before it rounds them.
        exact = self._gsplat and array.dtype == np.float64
        dtype = torch.float64 if exact else self._dtype
        return torch.tensor(array, dtype=dtype, device=self._device, requires_grad=True)

    def _gradients(self) -> Gradients:
        slopes: dict[str, Any] = {
            name: None if leaf is None else _gradient(leaf) for name, leaf in self._leaves.items()
        }
        slopes["image_motion"] = _motion(self._leaves["means"], slopes["means"], self._view)
        there = {name: slope for name, slope in slopes.items() if slope is not None}
        arrays = dict(zip(there, _arrays(list(there.values())), strict=True))
        return Gradients(**{name: arrays.get(name) for name in slopes})  # type: ignore[arg-type]


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().float().cpu().numpy()


def _arrays(tensors: Sequence[Tensor]) -> list[np.ndarray]:
    """Several tensors on the host, brought there at once: through pinned memory, where a GPU can write."""
    flat = torch.cat([tensor.detach().float().reshape(-1) for tensor in tensors])
    if flat.is_cuda:
        pinned = torch.empty(flat.shape, dtype=flat.dtype, pin_memory=True)
        flat = pinned.copy_(flat)
    ends = np.cumsum([tensor.numel() for tensor in tensors])[:-1]
    return [
        part.reshape(tensor.shape)
        for part, tensor in zip(np.split(flat.numpy(), ends), tensors, strict=True)
    ]


def _gradient(leaf: Tensor) -> Tensor:
    """A leaf's gradient, zeros if nothing reached it."""
    return torch.zeros_like(leaf) if leaf.grad is None else leaf.grad


def _motion(
    means: Float[Tensor, "n 3"], by_means: Float[Tensor, "n 3"], view: View
) -> Float[Tensor, "n"]:
    """|d loss / d centre on the image| as if only the centre moved with the mean, not the shape."""
    pose = torch.as_tensor(view.world_to_camera, dtype=means.dtype, device=means.device)
    focal = torch.as_tensor(np.diag(view.K)[:2].copy(), dtype=means.dtype, device=means.device)
    z = (means.detach() @ pose[2, :3] + pose[2, 3]).clamp(min=0)
    return ((by_means @ pose[:2, :3].T) * z[:, None] / focal).norm(dim=-1)


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
