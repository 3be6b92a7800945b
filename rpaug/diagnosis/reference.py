"""What is usual: the training recordings' first frames, and which pixels of each fixed camera show what.

Recordings of several tasks are told apart by their instructions, and a rollout is held against those of its own task:
what is strange for one may be what another is about.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from rpaug.core import keyframes, registry
from rpaug.core.errors import BadInput
from rpaug.core.interfaces import Adapter
from rpaug.core.types import Camera, CameraView, Episode, Robot, Scene
from rpaug.language import asking
from rpaug.language.messages import WishContext
from rpaug.pipeline.run import group_of
from rpaug.scene.build import build

MOST = 10  # recordings that are looked at
FEWEST = 5  # of each task, where there are several
MOST_TASKS = 20  # that are told apart: more are taken together
ALIKE = 0.5  # share of words that instructions of one task have in common
FRAMES = 24  # frames of each in which roles are told
OFTEN, ALWAYS = 0.5, 0.9  # shares of the recordings in which a pixel shows something


@dataclass(frozen=True)
class First:
    """A recording's first frame in one camera: image, ids, their roles, where the camera is, and its focal length."""

    image: UInt8[np.ndarray, "h w 3"]
    ids: Int32[np.ndarray, "h w"]
    roles: Mapping[str, frozenset[int]]
    pose: Float64[np.ndarray, "4 4"] | None
    focal: float | None = None  # focal length over the image's width, if that is known

    def mask(self, role: str) -> Bool[np.ndarray, "h w"]:
        """Where something in that role is seen."""
        return np.isin(self.ids, list(self.roles.get(role, ())))


@dataclass(frozen=True)
class ReferenceCamera:
    """One fixed camera of the recordings: all first frames, their mean, and what most of them show where."""

    firsts: tuple[First, ...]

    @cached_property
    def mean(self) -> Float32[np.ndarray, "h w 3"]:
        """Mean color, 0..255."""
        return np.asarray(np.mean([one.image for one in self.firsts], 0), np.float32)

    def usually(self, role: str, share: float = OFTEN) -> Bool[np.ndarray, "h w"]:
        """Where that share of the recordings shows the role."""
        return np.mean([one.mask(role) for one in self.firsts], 0) >= share

    @property
    def robot(self) -> Bool[np.ndarray, "h w"]:
        """Where the robot waits in nearly all recordings."""
        return self.usually("robot", ALWAYS)


Plates = Mapping[str, ReferenceCamera]  # by camera
Words = frozenset[str]


@dataclass(frozen=True)
class Reference:
    """The recordings a policy was trained on: their plates all together, and by the words of each task's instruction.

    `scene` builds one of them, to look for targets in.
    """

    plates: Plates
    setting: WishContext
    scene: Callable[[], Scene]
    notes: tuple[str, ...] = ()
    tasks: Mapping[Words, Plates] = field(default_factory=dict)

    @property
    def focal(self) -> float | None:
        """The shortest focal length of the recordings' cameras over their images' width, if all are known."""
        found = [one.focal for plate in self.plates.values() for one in plate.firsts]
        known = [one for one in found if one is not None]
        return min(known) if known and len(known) == len(found) else None

    def of(self, instruction: str) -> Plates:
        """The plates of the task whose instruction is most like that one; of all, where none is like it."""
        stated = _words(instruction)
        best = max(self.tasks, key=lambda task: _shared(stated, task), default=frozenset())
        return self.tasks[best] if _shared(stated, best) else self.plates


def learn(dataset: Path, most: int = MOST) -> Reference:
    """What the recordings show, from up to `most` of them or `FEWEST` of each task, evenly taken. Raises RpaugError."""
    adapter = registry.adapter_for(dataset)
    keys = adapter.episodes(dataset)
    if not keys:
        raise BadInput(dataset, "dataset", found="no episodes", expected="training recordings")
    first = adapter.read(dataset, keys[0])
    tasks = _tasks(adapter, dataset, keys)
    each = most if len(tasks) == 1 else max(FEWEST, most // len(tasks))
    seen = {task: _firsts(adapter, dataset, _evenly(some, each)) for task, some in tasks.items()}
    plates = _plates(seen.values())
    notes = () if plates else ("the recordings' cameras move, or nothing is told apart in them",)
    return Reference(
        plates,
        asking.setting_of(first),
        cache(lambda: build(thinned(first, FRAMES), with_bodies=True)),
        notes,
        {task: _plates([firsts]) for task, firsts in seen.items()} if len(seen) > 1 else {},
    )


def _tasks(adapter: Adapter, dataset: Path, keys: Sequence[str]) -> dict[Words, list[str]]:
    """The recordings by task: folders are joined whose first recordings' instructions are alike."""
    folders: dict[str, list[str]] = {}
    for key in keys:
        folders.setdefault(group_of(adapter, key), []).append(key)
    tasks: dict[Words, list[str]] = {}
    for some in folders.values():
        stated = _words(*adapter.read(dataset, some[0]).descriptions[:1])
        known = max(tasks, key=lambda task: _shared(stated, task), default=stated)
        tasks.setdefault(known if _shared(stated, known) >= ALIKE else stated, []).extend(some)
        if len(tasks) > MOST_TASKS:
            return {frozenset(): list(keys)}
    return tasks


def _words(*texts: str) -> Words:
    return frozenset(re.findall(r"\w+", " ".join(texts).lower()))


def _shared(some: Words, others: Words) -> float:
    """The share of words that are in both (Jaccard)."""
    return len(some & others) / max(1, len(some | others))


def _evenly(keys: Sequence[str], most: int) -> list[str]:
    taken = np.linspace(0, len(keys) - 1, min(most, len(keys))).round().astype(int)
    return [keys[number] for number in np.unique(taken)]


def _firsts(adapter: Adapter, dataset: Path, keys: Iterable[str]) -> dict[str, list[First]]:
    """The first frames of these recordings in each fixed camera, roles told."""
    firsts: dict[str, list[First]] = {}
    for key in keys:
        scene = build(thinned(adapter.read(dataset, key), FRAMES), with_bodies=True)
        for name, view in scene.episode.views.items():
            if view.ids is not None and view.camera.fixed:
                camera = view.camera
                pose = camera.cam_to_world[0] if camera.placed else None
                focal = None if camera.assumed else float(camera.K[0, 0]) / camera.width
                seen = First(view.rgb(0), view.ids(0), scene.roles, pose, focal)
                firsts.setdefault(name, []).append(seen)
    return firsts


def _plates(several: Iterable[Mapping[str, list[First]]]) -> Plates:
    joined: dict[str, list[First]] = {}
    for firsts in several:
        for name, seen in firsts.items():
            joined.setdefault(name, []).extend(seen)
    return {name: ReferenceCamera(tuple(_alike(seen))) for name, seen in joined.items()}


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
