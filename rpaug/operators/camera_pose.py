"""Move cameras a little, as if their mounts had been bumped."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import cv2
import numpy as np
from jaxtyping import Float64
from pydantic import Field

from rpaug.core import geometry
from rpaug.core.errors import TargetError, Unsupported, there_are
from rpaug.core.interfaces import Edit, Examples, Operator
from rpaug.core.types import Effect, Scene

Motion = tuple[float, float, float]


def _bounds(given: Motion | tuple[Motion, Motion]) -> Float64[np.ndarray, "2 3"]:
    """Low and high of a motion, the same for one that is exact."""
    return np.broadcast_to(np.array(given, float), (2, 3))


@dataclass(frozen=True, kw_only=True)
class CameraPose(Operator):
    """Turn and shift each of `camera` by one random rigid motion, held for the whole episode.

    The motion is drawn in the camera's own frame, so 2 cm is 2 cm along the image axes however the rig stands.
    Nothing in the world moves: recorded actions stay true. `camera` is a name, several names, or "static" for all
    cameras that never move. `by` and `turned` ask for one exact motion instead, in the same frame (x right, y down,
    z ahead): metres along its axes, and a rotation vector in radians; two of them are low and high of what is drawn.
    With `toward` a camera that stands still then looks at that place of the world, with its upper side up as before.
    """

    camera: str | tuple[str, ...]
    shift: Annotated[float, Field(ge=0, le=10)] = 0.1  # metres, at most, along each axis
    turn: Annotated[float, Field(ge=0, le=3.2)] = 0.05  # radians, at most, about each axis
    by: Motion | tuple[Motion, Motion] | None = None  # metres
    turned: Motion | tuple[Motion, Motion] | None = None  # radians
    toward: Motion | None = None  # metres

    effect: ClassVar[Effect] = Effect.CAMERA | Effect.PIXELS
    asked_as: ClassVar[Mapping[str, str]] = {
        "rotate": "rotate, rotation, spin, twist, swing",
        "tilt": "tilt, pitch, pitched, pitching, tilted",
        "pan": "pan, yaw, swivel, turned, panned",
        "roll": "roll, rolled, clockwise, rotate about its axis, about its axis, around its axis, "
        "about its own axis, around its own axis, about the optical axis",
        "unroll": "counterclockwise, counter-clockwise, anticlockwise, anti-clockwise",
        "aim": "point, points, aim at, aims at, aim, re-aim, re-aim it at, aim it at, point at, "
        "points at, point it at, look at, looks at, looking at, pointed at, pointing at, "
        "aimed at, centered on, center it on, facing",
        "pose": "pose, the pose, the pose of, poses, the poses of",
        "axes": "in x and y, along x and y, in x and in y",
    }
    phrases: ClassVar[tuple[str, ...]] = ("jitter {camera} [by up to {shift:length}]",)
    examples: ClassVar[Examples] = (
        ("jitter all fixed cameras by up to 3 cm", {"camera": "static", "shift": 0.03, "turn": 0}),
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
            if value is not None and (np.diff(_bounds(value), axis=0) < 0).any():
                raise ValueError(f"{name}: low {value[0]} exceeds high {value[1]}")

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        names = self._names(scene)
        if self.by is None and self.turned is None and self.toward is None:
            drawn = {
                name: {
                    "turn": rng.uniform(-self.turn, self.turn, 3).tolist(),
                    "shift": rng.uniform(-self.shift, self.shift, 3).tolist(),
                }
                for name in names
            }
        else:
            turned, by = (_bounds(given or (0.0, 0.0, 0.0)) for given in (self.turned, self.by))
            motion = {"turn": rng.uniform(*turned).tolist(), "shift": rng.uniform(*by).tolist()}
            drawn = dict.fromkeys(names, motion)
        if self.toward is None:
            return drawn
        return {name: self._aimed(scene, name, motion) for name, motion in drawn.items()}

    def _aimed(self, scene: Scene, name: str, motion: Edit) -> Edit:
        """The motion with a turn after which the camera looks at `toward`: the least one, about an axis across."""
        camera = scene.cameras[name]
        if not camera.fixed:
            raise Unsupported(f"camera {name!r} moves: it cannot look at one place")
        bump = geometry.rigid(np.array(motion["turn"]), np.array(motion["shift"]))
        there = geometry.transform(
            geometry.inverse(camera.cam_to_world[0] @ bump), np.array(self.toward)
        )
        across = np.cross([0.0, 0.0, 1.0], there)
        angle = float(np.arctan2(np.linalg.norm(across), there[2]))
        axis = across / max(float(np.linalg.norm(across)), 1e-9)
        aim = bump @ geometry.rigid(angle * axis, np.zeros(3))
        return {"turn": cv2.Rodrigues(aim[:3, :3])[0][:, 0].tolist(), "shift": aim[:3, 3].tolist()}

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
                f"{self.camera!r} names no camera; {there_are(str(self.camera), scene.cameras)}"
            )
        self._known(scene, names)
        return names

    @staticmethod
    def _known(scene: Scene, names: Iterable[str]) -> None:
        for name in names:
            if name not in scene.cameras:
                raise TargetError(f"no camera is called {name!r}; {there_are(name, scene.cameras)}")
