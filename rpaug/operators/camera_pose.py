"""Move cameras a little, as if their mounts had been bumped."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.core.interfaces import Edit, Examples, Operator
from rpaug.core.types import Effect, Scene

Motion = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class CameraPose(Operator):
    """Turn and shift each of `camera` by one random rigid motion, held for the whole episode.

    The motion is drawn in the camera's own frame, so 2 cm is 2 cm along the image axes however the rig stands.
    Nothing in the world moves: recorded actions stay true. `camera` is a name, several names, or "static" for all
    cameras that never move. `by` and `turned` ask for one exact motion instead, in the same frame (x right, y down,
    z ahead): metres along its axes, and a rotation vector in radians.
    """

    camera: str | tuple[str, ...]
    shift: Annotated[float, Field(ge=0, le=10)] = 0.1  # metres, at most, along each axis
    turn: Annotated[float, Field(ge=0, le=3.2)] = 0.05  # radians, at most, about each axis
    by: Motion | None = None  # metres
    turned: Motion | None = None  # radians

    effect: ClassVar[Effect] = Effect.CAMERA | Effect.PIXELS
    phrases: ClassVar[tuple[str, ...]] = ("jitter {camera} [by up to {shift:length}]",)
    examples: ClassVar[Examples] = (
        ("jitter all fixed cameras by up to 3 cm", {"camera": "static", "shift": 0.03}),
        (
            "nudge the wrist cam about half a degree",
            {"camera": "wrist", "shift": 0, "turn": 0.0087},
        ),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("camera", "cameras", "viewpoint", "view", "camera pose")

    def __post_init__(self) -> None:
        for name, most in (("by", 10.0), ("turned", 3.2)):
            value = getattr(self, name)
            if value is not None and not np.abs(value).max() <= most:
                raise ValueError(f"{name}: {list(value)} is not within {-most}..{most}")

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        if self.by is not None or self.turned is not None:
            still = (0.0, 0.0, 0.0)
            motion = {"turn": list(self.turned or still), "shift": list(self.by or still)}
            return dict.fromkeys(self._names(scene), motion)
        return {
            name: {
                "turn": rng.uniform(-self.turn, self.turn, 3).tolist(),
                "shift": rng.uniform(-self.shift, self.shift, 3).tolist(),
            }
            for name in self._names(scene)
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        self._known(scene, edit)
        cameras = dict(scene.cameras)
        for name, motion in edit.items():
            bump = geometry.rigid(np.array(motion["turn"]), np.array(motion["shift"]))
            # Right-multiplied: the bump happens in the camera's frame, before the pose.
            cameras[name] = replace(cameras[name], cam_to_world=cameras[name].cam_to_world @ bump)
        return replace(scene, cameras=cameras)

    def _names(self, scene: Scene) -> list[str]:
        if self.camera == "static":
            names = [name for name, camera in scene.cameras.items() if camera.fixed]
        else:
            names = [self.camera] if isinstance(self.camera, str) else list(self.camera)
        if not names:
            raise TargetError(
                f"{self.camera!r} names no camera; there are: {', '.join(scene.cameras)}"
            )
        self._known(scene, names)
        return names

    @staticmethod
    def _known(scene: Scene, names: Iterable[str]) -> None:
        for name in names:
            if name not in scene.cameras:
                raise TargetError(
                    f"no camera is called {name!r}; there are: {', '.join(scene.cameras)}"
                )
