"""What a camera's JPEG compression leaves of an image."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import cv2
import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from rpaug.core.interfaces import Edit, Examples
from rpaug.operators.fields import Interval
from rpaug.operators.sensing import Sensing


@dataclass(frozen=True)
class JPEG:
    """Encoded and decoded again at one quality."""

    quality: int
    seed: int = 0
    cameras: tuple[str, ...] | None = None

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        done, data = cv2.imencode(
            ".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality]
        )
        assert done
        decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert decoded is not None
        return np.ascontiguousarray(decoded[..., ::-1], np.uint8)


@dataclass(frozen=True, kw_only=True)
class SensorJPEG(Sensing):
    """Draw the quality (1 worst, 100 best) from `quality`; all frames get the same."""

    quality: Interval[Annotated[int, Field(ge=1, le=100)]] = (30, 90)

    makes: ClassVar = JPEG
    asked_as: ClassVar[Mapping[str, str]] = {
        "jpeg": "low quality, bad quality, jpeg, jpg, compress, compression, jpeg artifacts, "
        "jpeg artefacts, jpeg compression, jpeg quality, quality, artifacts",
    }
    phrases: ClassVar[tuple[str, ...]] = (
        "compress the images as jpeg [with quality {quality:count} to {quality:count}]",
    )
    examples: ClassVar[Examples] = (
        ("jpeg artifacts", {}),
        ("compress at quality 40", {"quality": [40, 40]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("jpeg", "compression")
    settles: ClassVar[str] = "sensor jpeg"

    def draw(self, rng: np.random.Generator) -> Edit:
        return {"quality": int(rng.integers(self.quality[0], self.quality[1] + 1))}
