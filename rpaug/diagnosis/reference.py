"""What is usual: the training recordings' first frames, and which pixels of each fixed camera show what."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from rpaug import registry
from rpaug.agents import asking
from rpaug.agents.messages import Setting
from rpaug.errors import BadInput
from rpaug.scene import keyframes
from rpaug.scene.build import build
from rpaug.types import Camera, CameraView, Episode, Robot, Scene

MOST = 10  # recordings that are looked at
FRAMES = 24  # frames of each in which roles are told
OFTEN, ALWAYS = 0.5, 0.9  # shares of the recordings in which a pixel shows something


@dataclass(frozen=True)
class First:
    """A recording's first frame in one camera: image, ids, their roles, and where the camera is, if that is known."""

    image: UInt8[np.ndarray, "h w 3"]
    ids: Int32[np.ndarray, "h w"]
    roles: Mapping[str, frozenset[int]]
    pose: Float64[np.ndarray, "4 4"] | None

    def mask(self, role: str) -> Bool[np.ndarray, "h w"]:
        """Where something in that role is seen."""
        return np.isin(self.ids, list(self.roles.get(role, ())))


@dataclass(frozen=True)
class Plate:
    """One fixed camera of the recordings: all first frames, their mean, and what most of them show where."""

    firsts: tuple[First, ...]

    @cached_property
    def mean(self) -> Float32[np.ndarray, "h w 3"]:
        """Mean colour, 0..255."""
        return np.asarray(np.mean([one.image for one in self.firsts], 0), np.float32)

    def usually(self, role: str, share: float = OFTEN) -> Bool[np.ndarray, "h w"]:
        """Where that share of the recordings shows the role."""
        return np.mean([one.mask(role) for one in self.firsts], 0) >= share

    @property
    def robot(self) -> Bool[np.ndarray, "h w"]:
        """Where the robot waits in nearly all recordings."""
        return self.usually("robot", ALWAYS)


@dataclass(frozen=True)
class Reference:
    """The recordings a policy was trained on. `scene` builds one of them, to look for targets in."""

    plates: Mapping[str, Plate]
    setting: Setting
    scene: Callable[[], Scene]
    notes: tuple[str, ...] = ()


def learn(dataset: Path, most: int = MOST) -> Reference:
    """What the recordings show, from at most `most` of them, evenly taken. Raises RpaugError."""
    adapter = registry.adapter_for(dataset)
    keys = adapter.episodes(dataset)
    if not keys:
        raise BadInput(dataset, "dataset", found="no episodes", expected="training recordings")
    taken = np.unique(np.linspace(0, len(keys) - 1, min(most, len(keys))).round().astype(int))
    firsts: dict[str, list[First]] = {}
    first = adapter.read(dataset, keys[0])
    for number in taken:
        episode = adapter.read(dataset, keys[number])
        scene = build(thinned(episode, FRAMES), with_bodies=True)
        for name, view in scene.episode.views.items():
            if view.ids is not None and view.camera.fixed:
                pose = view.camera.cam_to_world[0] if view.camera.placed else None
                firsts.setdefault(name, []).append(
                    First(view.rgb(0), view.ids(0), scene.roles, pose)
                )
    plates = {name: Plate(tuple(_alike(seen))) for name, seen in firsts.items()}
    notes = () if plates else ("the recordings' cameras move, or nothing is told apart in them",)
    return Reference(
        plates,
        asking.setting_of(first),
        cache(lambda: build(thinned(first, FRAMES), with_bodies=True)),
        notes,
    )


def _alike(firsts: list[First]) -> list[First]:
    """Those of the commonest size."""
    shapes = [one.image.shape for one in firsts]
    common = max(set(shapes), key=shapes.count)
    return [one for one in firsts if one.image.shape == common]


def thinned(episode: Episode, most: int) -> Episode:
    """The episode with at most `most` frames: the first, its key frames, and others evenly between."""
    if episode.length <= most:
        return episode
    even = np.linspace(0, episode.length - 1, most).round().astype(int).tolist()
    keys = [t for t in keyframes.find(episode.robot) if t < episode.length]
    times = np.array(sorted({*even, *keys}))
    return replace(
        episode,
        views={name: _thinned(view, times) for name, view in episode.views.items()},
        robot=_played(episode.robot, times),
        length=len(times),
    )


def _thinned(view: CameraView, times: Int32[np.ndarray, "k"]) -> CameraView:
    def at(read: Callable | None) -> Callable | None:
        return None if read is None else lambda t: read(int(times[t]))

    camera: Camera = replace(view.camera, cam_to_world=view.camera.cam_to_world[times])
    rgb = at(view.rgb)
    assert rgb is not None
    return replace(view, camera=camera, rgb=rgb, depth=at(view.depth), ids=at(view.ids))


def _played(robot: Robot, times: Int32[np.ndarray, "k"]) -> Robot:
    def at(track: np.ndarray | None) -> np.ndarray | None:
        return None if track is None else track[times]

    joints, speeds = robot.joint_positions[times], robot.joint_velocities[times]
    extra = {name: track[times] for name, track in robot.extra.items()}
    return Robot(joints, speeds, at(robot.gripper_to_world), at(robot.gripper_open), extra)
