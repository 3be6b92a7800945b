"""Poses, lens and points of frames by a learned model (DUSt3R, VGGT): none by itself, one by its file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float32, Float64, UInt8

from rpaug.core.errors import Unsupported

KINDS = ("torchscript", "export")


@dataclass(frozen=True, eq=False)
class Posed:
    """What a model says of some frames, all in one world and unit of its own.

    `points[i, y, x]` is where pixel (x, y) of frame i lies in that world, `confidence` how sure that is (any scale,
    up; 0: not at all). Cameras look along +z, x right, y down; K has its pixel centres at integers.
    """

    cam_to_world: Float64[np.ndarray, "n 4 4"]
    K: Float64[np.ndarray, "n 3 3"]
    points: Float32[np.ndarray, "n h w 3"]
    confidence: Float32[np.ndarray, "n h w"]


class Poses(Protocol):
    """Looks at several frames together."""

    def __call__(self, images: UInt8[np.ndarray, "n h w 3"]) -> Posed: ...


class FromFile:
    """A model saved by `torch.jit.save` (`torchscript`) or `torch.export.save` (`export`).

    It takes (n, 3, h, w) colors in 0..1 and gives camera-to-world (n, 4, 4), K (n, 3, 3), points (n, h, w, 3) and,
    if it has any, confidence (n, h, w), as `Posed` has them. Raises Unsupported for a file that holds none, and for
    answers of another kind.
    """

    def __init__(self, kind: str, file: Path | str) -> None:
        import torch

        self._file = Path(file)
        try:
            if kind == "export":
                self._model: Any = torch.export.load(str(file)).module()
            else:
                self._model = torch.jit.load(str(file), map_location="cpu").eval()
        except Exception as error:  # torch raises whatever its unpickler does
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise Unsupported(f"{file}: no {kind} model of poses: {reason}") from None

    def __call__(self, images: UInt8[np.ndarray, "n h w 3"]) -> Posed:
        """What the model says of these frames."""
        import torch

        with torch.inference_mode():
            shown = torch.from_numpy(np.ascontiguousarray(images)).permute(0, 3, 1, 2).float()
            try:
                found = self._model(shown / 255)
            except RuntimeError as error:
                reason = str(error).splitlines()[-1]
                raise Unsupported(f"{self._file}: fails on {images.shape}: {reason}") from None
        return self._checked(found, images.shape)

    def _checked(self, found: Any, asked: tuple[int, ...]) -> Posed:
        n, h, w, _ = asked
        shapes = ((n, 4, 4), (n, 3, 3), (n, h, w, 3), (n, h, w))
        parts = list(found) if isinstance(found, tuple | list) else [found]
        given = [tuple(getattr(part, "shape", ())) for part in parts]
        if given != list(shapes[: len(given)]) or len(given) not in (3, 4):
            raise Unsupported(
                f"{self._file}: found {given}; expected poses, K, points and perhaps confidence: {list(shapes)}"
            )
        arrays = [part.detach().cpu().numpy() for part in parts]
        sure = arrays[3] if len(arrays) == 4 else np.ones((n, h, w))
        if not all(np.isfinite(one).all() for one in (*arrays[:2], sure)):
            raise Unsupported(f"{self._file}: found poses, K or confidence that are not numbers")
        poses, K, points = arrays[:3]
        return Posed(
            poses.astype(np.float64), K.astype(np.float64), points.astype(np.float32),
            sure.astype(np.float32),
        )  # fmt: skip


def poses(name: str) -> Poses:
    """The model that a recipe names: `torchscript:FILE` or `export:FILE`. Raises Unsupported."""
    kind, _, file = name.partition(":")
    if kind not in KINDS or not file:
        raise Unsupported(
            f"no model of poses is called {name!r}; there are: torchscript:FILE, export:FILE"
        )
    return FromFile(kind, file)
