"""What a recipe's `video` says: how a video's camera is found, and what tells how long its unit is."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Pixel = Annotated[list[float], Field(min_length=2, max_length=2)]


class KnownLength(BaseModel):
    """Two places in one frame, pixels (column, row) of the recording, and how many metres lie between them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    frame: Annotated[int, Field(ge=0)]
    places: Annotated[list[Pixel], Field(min_length=2, max_length=2)]
    metres: Annotated[float, Field(gt=0)]


class VideoSettings(BaseModel):
    """Settings of structure from motion, and at most one thing that tells its scale.

    `camera_height` is metres from the support up to the camera, the median over frames. `width` is that of the images
    it looks at, `fit_width` that of those which Gaussians are fitted to.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera_height: Annotated[float, Field(gt=0, le=100)] | None = None
    known_length: KnownLength | None = None
    width: Annotated[int, Field(ge=64, le=4096)] = 640
    features: Annotated[int, Field(ge=100, le=20_000)] = 1500
    overlap: Annotated[int, Field(ge=1, le=100)] = 10
    fit_width: Annotated[int, Field(ge=64, le=4096)] = 320

    @model_validator(mode="after")
    def _one_scale(self) -> "VideoSettings":
        if self.camera_height is not None and self.known_length is not None:
            raise ValueError("camera_height and known_length both tell the scale; give one")
        return self
