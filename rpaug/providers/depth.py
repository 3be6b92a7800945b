"""Depth from one image: none by itself, a model where its file is named."""

from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float32, UInt8

from rpaug.core.errors import Unsupported


class DepthModel(Protocol):
    """Depth of every pixel along the camera's axis, in metres; `relative` if only up to one factor an image."""

    relative: bool

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]: ...


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

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
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


def depth(name: str) -> DepthModel:
    """The model that a recipe names: `torchscript:FILE` or `torchscript-inverse:FILE`. Raises Unsupported."""
    kind, _, file = name.partition(":")
    if kind not in ("torchscript", "torchscript-inverse") or not file:
        raise Unsupported(
            f"no model of depth is called {name!r}; there are: torchscript:FILE (metres),"
            " torchscript-inverse:FILE (1 / depth)"
        )
    return TorchScript(file, inverse=kind == "torchscript-inverse")
