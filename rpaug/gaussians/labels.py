"""Pictures of labels, and a scene's Gaussians posed for the cameras that took them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32

from rpaug.core.errors import Unsupported
from rpaug.core.sampling import frames
from rpaug.core.types import Scene
from rpaug.gaussians.gaussian_view import SHARP, standing, view_of
from rpaug.gaussians.gaussians import Placement
from rpaug.gaussians.ids_by_weight import CHANNELS
from rpaug.render.splat import Rasteriser, Rendering, Splats, View

UNKNOWN = -1  # a pixel that says nothing; 0 says that there is no instance
COVERED = 0.5  # of a pixel, from which it shows something
FRAMES = 12  # of each camera, looked at by default


@dataclass(frozen=True)
class Labelled:
    """What one camera's pixels are at one frame: instance ids, 0 for none, UNKNOWN for no statement."""

    camera: str
    t: int
    ids: Int32[np.ndarray, "h w"]


def recorded(scene: Scene, count: int = FRAMES) -> list[Labelled]:
    """The episode's own masks at `count` frames spread over it. Raises Unsupported if it has none."""
    read: dict[str, Callable[[int], np.ndarray]] = {
        name: view.ids for name, view in scene.episode.views.items() if view.ids is not None
    }
    if not read:
        raise Unsupported("this episode has no instance masks: a segment provider can make some")
    return [
        Labelled(name, t, ids(t))
        for t in frames(scene.episode.length, count)
        for name, ids in read.items()
    ]


class LabelRenderer:
    """A scene's Gaussians, drawn from any of its cameras at any time with features of one's own.

    Geometry stays as it is. One stage serves one thread at a time. Raises Unsupported for a scene
    without Gaussians.
    """

    def __init__(self, scene: Scene) -> None:
        if scene.gaussians is None:
            raise Unsupported("this scene has no Gaussians: rpaug fit, or --tier 3, makes them")
        self._scene, self._splats = scene, Splats.of(scene.gaussians)
        self._placement = Placement.of(scene.gaussians.ids, scene.bodies, scene.irradiance)
        self._views: dict[tuple[str, int], tuple[Splats, View]] = {}
        self.rasteriser = Rasteriser(SHARP)

    def draw(
        self, camera: str, t: int, features: Float32[np.ndarray, "n f"], *, surface: bool = False
    ) -> Rendering:
        """One view with these features blended; `rasteriser.backward` belongs to it afterwards."""
        splats = self.placed(camera, t).with_features(features)
        return self.rasteriser.forward(splats, self._views[camera, t][1], surface=surface)

    def placed(self, camera: str, t: int) -> Splats:
        """The Gaussians as they stand in the world at t."""
        if (camera, t) not in self._views:
            view = view_of(standing(self._scene, camera), t)
            self._views[camera, t] = (self._placement.place(self._splats, t), view)
        return self._views[camera, t][0]

    def size(self, camera: str) -> tuple[int, int]:
        """Height and width of a camera's images."""
        eye = self._scene.cameras[camera]
        return eye.height, eye.width


def mask(
    ids: Int32[np.ndarray, "n"], stage: LabelRenderer, camera: str, t: int
) -> Int32[np.ndarray, "h w"]:
    """Instance ids of one view, given one for each Gaussian; 0 where less than half of a pixel is covered."""
    labels, which = np.unique(ids, return_inverse=True)
    best = share = alpha = None
    for start in range(0, len(labels), CHANNELS):
        member = (which >= start) & (which < start + CHANNELS)
        features = np.zeros((len(ids), CHANNELS), np.float32)
        features[member, which[member] - start] = 1.0
        drawn = stage.draw(camera, t, features)
        assert drawn.features is not None
        named = labels[np.minimum(drawn.features.argmax(-1) + start, len(labels) - 1)]
        weight = drawn.features.max(-1)
        if best is None or share is None:
            best, share, alpha = named, weight, drawn.alpha
        else:
            best, share = np.where(weight > share, named, best), np.maximum(weight, share)
    if best is None or alpha is None:
        return np.zeros(stage.size(camera), np.int32)
    return np.where(alpha >= COVERED, best, 0).astype(np.int32)
