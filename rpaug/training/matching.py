"""How a dataset hands out recorded images: axes, range, normalisation and size, told by comparing with the recording.

Nothing is declared. A sample's image must be the recorded one up to a resize, an order of axes, and a factor and offset
per channel; what those are is found, used for the edited image, and a sample that shows anything else is refused: its
episode or frame was named wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float32

from rpaug.core.errors import Unsupported

MEAN, WORST = (
    0.02,
    0.15,
)  # of the recorded range: mean and 99th percentile of what resampling and coding change
USUAL = ((1.0, 0.0), (1 / 255, 0.0), (2 / 255, -1.0))  # bytes as they are, in 0..1, in -1..1
SAMPLED = 4096  # values compared per channel
Images = Float32[np.ndarray, "n h w c"]


@dataclass(frozen=True)
class Layout:
    """A sample's array as a stack of images: leading axes flattened, channels last; and its way back."""

    kind: type
    dtype: Any
    shape: tuple[int, ...]
    first: bool  # channels before rows

    @staticmethod
    def of(name: str, value: Any, channels: int) -> "Layout":
        """Raises Unsupported where no axis can be the channels."""
        shape = tuple(value.shape)
        if len(shape) >= 3 and shape[-1] == channels:
            return Layout(type(value), value.dtype, shape, False)
        if len(shape) >= 3 and shape[-3] == channels:
            return Layout(type(value), value.dtype, shape, True)
        if channels == 1 and len(shape) >= 2:
            return Layout(type(value), value.dtype, (*shape, 1), False)
        raise Unsupported(f"{name}: found shape {shape}; expected images with {channels} channels")

    def images(self, value: Any) -> Images:
        """The array as images, float32."""
        array = value.detach().cpu().numpy() if isinstance(value, torch.Tensor) else value
        array = np.asarray(array, np.float32).reshape(self.shape)
        array = np.moveaxis(array, -3, -1) if self.first else array
        return np.ascontiguousarray(array).reshape(-1, *array.shape[-3:])

    def back(self, images: Images, like: Any) -> Any:
        """Images as an array like the one they came from."""
        rows, columns, channels = images.shape[1:]
        array = images.reshape(*self.shape[:-3], rows, columns, channels)
        array = np.moveaxis(array, -1, -3) if self.first else array
        if isinstance(like, torch.Tensor):
            if not like.dtype.is_floating_point:
                array = np.rint(array)
            made = torch.from_numpy(np.ascontiguousarray(array)).to(like.dtype)
            return made.reshape(like.shape).to(like.device)
        array = np.rint(array) if np.issubdtype(like.dtype, np.integer) else array
        return np.ascontiguousarray(array).astype(like.dtype).reshape(like.shape)


def resized(images: Sequence[np.ndarray], size: tuple[int, int], nearest: bool = False) -> Images:
    """Images (h, w) or (h, w, c) as a float32 stack of the given rows and columns."""
    rows, columns = size
    out = []
    for image in images:
        image = np.asarray(image, np.float32)
        if image.shape[:2] != size:
            shrinks = rows * columns < image.shape[0] * image.shape[1]
            how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
            image = cv2.resize(
                image, (columns, rows), interpolation=cv2.INTER_NEAREST if nearest else how
            )
        out.append(image.reshape(rows, columns, -1))
    return np.stack(out)


def scale(
    name: str, shown: Images, recorded: Images, free: bool
) -> tuple[Float32[np.ndarray, "c"], Float32[np.ndarray, "c"]]:
    """Factor and offset per channel that turn recorded values into the sample's: 1 and 0 unless they are `free`.

    Raises Unsupported if none do.
    """
    lines = []
    for channel in range(recorded.shape[-1]):
        own, theirs = recorded[..., channel].ravel(), shown[..., channel].ravel()
        step = max(1, len(own) // SAMPLED)
        own, theirs = own[::step].astype(float), theirs[::step].astype(float)
        factor, offset = _line(own, theirs) if free else (1.0, 0.0)
        off = np.abs(own * factor + offset - theirs)
        reach = factor * max(float(np.ptp(own)), 1.0)
        if not (off.mean() <= MEAN * reach and np.quantile(off, 0.99) <= WORST * reach):
            raise Unsupported(strange(name))
        lines.append((factor, offset))
    factors, offsets = np.array(lines, np.float32).T
    return factors, offsets


def strange(name: str) -> str:
    """What is said of a sample that does not show what was recorded."""
    return (
        f"{name}: found another image than was recorded there; expected the recorded frame, at most "
        "resized, coded or normalised. Do `episode` and `frame` name the sample's own?"
    )


def _line(own: np.ndarray, theirs: np.ndarray) -> tuple[float, float]:
    """The usual factor and offset that fit best, or where none fits well, the least squares line."""
    errors = [float(np.mean(np.abs(own * a + b - theirs)) / a) for a, b in USUAL]
    return line_of(errors, (own, theirs))


def line_of(errors: Sequence[float], values: tuple[Any, Any]) -> tuple[float, float]:
    """The usual factor and offset with the least error, of 255; where that is large, the line through `values`,
    recorded and the sample's: arrays or tensors."""
    best = int(np.argmin(errors))
    own, theirs = values
    if errors[best] <= 1.0 or float(own.max() - own.min()) < 1.0:
        return USUAL[best]
    own, theirs = (
        part.cpu().numpy() if isinstance(part, torch.Tensor) else part for part in values
    )
    factor, offset = np.polyfit(own.ravel().astype(float), theirs.ravel().astype(float), 1)
    return max(float(factor), 1e-9), float(offset)
