"""Depth from one image: none by itself, a model where one is named, by a folder, a hub's id or a TorchScript file."""

from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from rpaug.core.errors import Unsupported
from rpaug.providers.models import IMAGENET, STANDARD, Loaded, load, picture, preprocessor

FILES = ("torchscript", "torchscript-inverse")
FARTHEST = 1e4  # metres: so far is what a network sees at no inverse depth at all
KINDS = {
    "depth_anything": "DepthAnythingForDepthEstimation",
    "prompt_depth_anything": "PromptDepthAnythingForDepthEstimation",
    "depth_pro": "DepthProForDepthEstimation",
    "zoedepth": "ZoeDepthForDepthEstimation",
    "dpt": "DPTForDepthEstimation",
    "glpn": "GLPNForDepthEstimation",
}


class DepthModel(Protocol):
    """Depth of every pixel along the camera's axis, in metres; `relative` if only up to one factor an image.

    `known` is depth that a sensor saw, 0 where it saw nothing: only models that take it look at it.
    """

    relative: bool

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], known: Float32[np.ndarray, "h w"] | None = None
    ) -> Float32[np.ndarray, "h w"]: ...


class Transformer:
    """A depth network of transformers, shown images of the size and colors that stand beside its weights.

    Depth Anything V2 (Yang et al. 2024, arXiv 2406.09414), Prompt Depth Anything (Lin et al. 2024, arXiv 2412.14015),
    Depth Pro (Bochkovskii et al. 2024, arXiv 2410.02073), ZoeDepth (Bhat et al. 2023, arXiv 2302.12288), DPT (Ranftl et
    al. 2021, arXiv 2103.13413), GLPN (Kim et al. 2022, arXiv 2201.07436).
    """

    def __init__(self, loaded: Loaded) -> None:
        self._model, self._kind = loaded.model, loaded.kind
        given = preprocessor(loaded.folder)
        self._size = _sides(given.get("size"), loaded)
        square = loaded.kind == "depth_pro"
        self._keeps = bool(given.get("keep_aspect_ratio", not square))
        self._step = int(given.get("ensure_multiple_of") or _step(loaded))
        usual = IMAGENET if loaded.kind.endswith("depth_anything") else STANDARD
        self._norm = given.get("image_mean", usual[0]), given.get("image_std", usual[1])
        kind = getattr(self._model.config, "depth_estimation_type", None)
        self.relative = kind == "relative" or (kind is None and loaded.kind == "dpt")

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], known: Float32[np.ndarray, "h w"] | None = None
    ) -> Float32[np.ndarray, "h w"]:
        """The depth map of one image."""
        import torch

        height, width = image.shape[:2]
        size = self._fitting(height, width)
        shown = torch.from_numpy(picture(image, size, size, self._norm)).to(self._model.device)
        more = {}
        if self._kind == "prompt_depth_anything" and known is not None and (known > 0).any():
            more["prompt_depth"] = torch.from_numpy(known[None, None]).to(self._model.device)
        with torch.inference_mode():
            found = self._model(pixel_values=shown, **more)
        made = found.predicted_depth.float().cpu().numpy().reshape(found.predicted_depth.shape[-2:])
        if self._kind == "depth_pro":
            made = _metres(made, found.field_of_view)
        elif self.relative:
            made = 1 / np.maximum(made, made.max() / FARTHEST if made.max() > 0 else 1.0)
        if not np.isfinite(made).all():
            raise Unsupported(f"{self._kind}: found depths that are no numbers")
        return cv2.resize(
            np.ascontiguousarray(made), (width, height), interpolation=cv2.INTER_LINEAR
        ).astype(np.float32)

    def _fitting(self, height: int, width: int) -> tuple[int, int]:
        """The image's sides as the network takes them: both of them the least change that keeps its shape, if it does,
        in whole steps of its patches (DPT's way)."""
        tall, wide = self._size[0] / height, self._size[1] / width
        if self._keeps:
            tall = wide = wide if abs(1 - wide) < abs(1 - tall) else tall
        step = self._step
        return (
            max(step, round(tall * height / step) * step),
            max(step, round(wide * width / step) * step),
        )


def _sides(given: Any, loaded: Loaded) -> tuple[int, int]:
    """Height and width that a preprocessor's `size` says, else those of the network's own backbone."""
    if isinstance(given, dict) and {"height", "width"} <= given.keys():
        return int(given["height"]), int(given["width"])
    if isinstance(given, int):
        return given, given
    backbone = getattr(loaded.model.config, "backbone_config", None)
    side = getattr(backbone, "image_size", None) or getattr(loaded.model.config, "image_size", 384)
    sides = side if isinstance(side, list | tuple) else (side, side)
    return int(sides[0]), int(sides[-1])


def _step(loaded: Loaded) -> int:
    config = loaded.model.config
    patch = getattr(config, "patch_size", None)
    return int(patch) if isinstance(patch, int) else 32


def _metres(inverse: Float32[np.ndarray, "h w"], view: Any) -> Float32[np.ndarray, "h w"]:
    """Depth Pro's canonical inverse depth in metres, by the field of view that it tells, degrees."""
    factor = 1.0
    if view is not None:
        factor = 2 * np.tan(0.5 * np.radians(float(view.reshape(-1)[0])))  # width over focal length
    return (1 / np.clip(inverse * factor, 1 / FARTHEST, FARTHEST)).astype(np.float32)


class TorchScript:
    """A model saved by `torch.jit`: takes (1, 3, h, w) colors in 0..1 and gives as many depths, in any leading shape.

    With `inverse` it gives 1 / depth up to a factor, as models of relative depth do. Raises Unsupported for a file
    that holds none, and for answers of another size.
    """

    def __init__(self, file: Path | str, inverse: bool = False) -> None:
        import torch

        self.relative, self._file = inverse, Path(file)
        try:
            self._model = torch.jit.load(str(file), map_location="cpu").eval()
        except (RuntimeError, ValueError, OSError) as error:
            reason = str(error).splitlines()[0]
            raise Unsupported(f"{file}: no TorchScript model of depth: {reason}") from None

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], known: Float32[np.ndarray, "h w"] | None = None
    ) -> Float32[np.ndarray, "h w"]:
        """The depth map of one image."""
        import torch

        with torch.inference_mode():
            shown = torch.from_numpy(np.ascontiguousarray(image)).permute(2, 0, 1)[None].float()
            found = self._model(shown / 255)
        if not isinstance(found, torch.Tensor) or found.numel() != image.shape[0] * image.shape[1]:
            raise Unsupported(
                f"{self._file}: expected one depth for each of {image.shape[1]}x{image.shape[0]} pixels"
            )
        depth = found.reshape(image.shape[:2]).float().numpy()
        return (1 / np.maximum(depth, 1e-6) if self.relative else depth).astype(np.float32)


def depth(name: str, device: str = "cpu") -> DepthModel:
    """The model of that name: a folder, an id of the hub, `torchscript:FILE` (metres) or `torchscript-inverse:FILE`
    (1 / depth). Raises Unsupported, MissingExtra."""
    kind, _, file = name.partition(":")
    if kind in FILES and file:
        return TorchScript(file, inverse=kind == "torchscript-inverse")
    return Transformer(load(name, KINDS, "a model of depth (models: depth)", device))
