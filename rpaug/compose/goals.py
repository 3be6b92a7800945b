"""What the edited Gaussians are to look like: the recorded cameras' images, edited where nothing blurs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32

from rpaug.compose import views
from rpaug.core.pixels import grown
from rpaug.core.types import Camera, CameraView, Scene

OUTLINE = 2  # pixels around what was edited that are judged too: Gaussians spill over outlines


@dataclass(frozen=True)
class Goal:
    """One recorded view with the edits made: colors in 0..1, depth in metres.

    `weight` is 0 where the image was invented; `judged` marks what was edited, and its outline.
    """

    camera: Camera
    name: str
    t: int
    rgb: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    weight: Float32[np.ndarray, "h w"]
    judged: Bool[np.ndarray, "h w"]


def goals(scene: Scene, times: Sequence[int], instance_ids: frozenset[int]) -> list[Goal]:
    """Every camera's view at these times: the recorded pixels painted, or surfels where bodies were moved.

    What was put in is left out, and so is light: both are laid over the Gaussians' picture.
    """
    cameras = {name: view.camera for name, view in scene.episode.views.items()}
    bodies = tuple(body for body in scene.bodies if body.mesh is None and body.soft is None)
    painted = tuple(edit for edit in scene.appearance if edit.instance_ids is not None)
    plain = replace(
        scene, cameras=cameras, bodies=bodies, appearance=painted, sensor=(), relit=None
    )
    invented: dict[tuple[str, int], Bool[np.ndarray, "h w"]] = {}

    def watch(shown: views.RenderedFrame) -> None:
        if shown.hole is not None:
            invented[shown.camera, shown.t] = shown.hole

    tier = 0 if scene.recorded_bodies is None else 1
    shown = views.edited(plain, dict.fromkeys(cameras, tier), watch)
    return [goal for t in times for goal in _at(shown.views, cameras, t, instance_ids, invented)]


def _at(
    shown: Mapping[str, CameraView],
    cameras: Mapping[str, Camera],
    t: int,
    instance_ids: frozenset[int],
    invented: Mapping[tuple[str, int], Bool[np.ndarray, "h w"]],
) -> Iterator[Goal]:
    for name, view in shown.items():
        assert view.depth is not None  # a scene of Gaussians has both
        assert view.ids is not None
        rgb, depth, ids = view.rgb(t), view.depth(t), view.ids(t)
        hole = invented.get((name, t))
        weight = np.ones(depth.shape, np.float32) if hole is None else 1 - hole.astype(np.float32)
        judged = grown(np.isin(ids, list(instance_ids)), OUTLINE) & (weight > 0)
        color = rgb.astype(np.float32) / 255
        yield Goal(cameras[name], name, t, color, depth, weight, judged)
