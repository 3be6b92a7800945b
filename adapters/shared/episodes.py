"""An episode of named features and a side file: what all layouts of this kind put together in the same way."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float64
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.cameras import Beside

from rpaug import Camera, CameraView, Episode


def episode(
    key: str,
    beside: Beside,
    sizes: Mapping[str, tuple[int, int]],
    tracks: Mapping[str, Float64[np.ndarray, "t k"]],
    length: int,
    descriptions: tuple[str, ...],
    view: Callable[[str, Camera], CameraView],
    recorded: Callable[[dict[str, CameraView]], Any],
) -> Episode:
    """The episode: its views by the `sizes` of their images, cameras and robot as the side file tells them.

    `view` makes one of its name and camera, `recorded` the episode's source of all of them. Raises BadInput.
    """
    views = {
        name: view(name, cameras.camera(beside, name, size, length, tracks))
        for name, size in sizes.items()
    }
    robot = cameras.robot(beside, tracks, length)
    return Episode(key, views, robot, descriptions, length, recorded(views), rate=beside.rate)
