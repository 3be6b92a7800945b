"""Writing an RLBench episode: what was recorded, with only what changed encoded anew."""

import copy
import os
import re
from collections.abc import Callable, Iterator, Mapping, Set
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8
from rpaug_adapters.rlbench.pickles import Demo, Observation, dump, load
from rpaug_adapters.rlbench.read import (
    COLLISIONS,
    DEPTH_STEPS,
    DESCRIPTIONS,
    EXTRAS,
    FLIP,
    KINDS,
    LOW_DIM,
    NUMBER,
    Codes,
    RLBenchSource,
)
from rpaug_adapters.shared.folders import see_no_pickle, write_files

from rpaug import Episode, Unsupported, files, geometry

PICKLES = (".pkl", ".pickle", ".p")
# Metres: depth range of cameras that were not recorded by CoppeliaSim, where they saw nothing farther.
NEAR, FAR = 0.01, 10.0
Planes = list[tuple[float, float]]
MOST_ID = 2**24 - 1  # in a mask of three channels
THREADS = 1, 8  # that write frames: of small images or beside other workers, and alone at most
SMALL = 2**15  # pixels: below, threads wait for the interpreter longer than they work without it
OLD_NUMPY_LACKS = b"numpy._core"  # RVT and RLBench run numpy <= 1.24
Image = Callable[[int], np.ndarray]
IMAGES = [
    f"{camera}_{kind}"
    for camera in ("left_shoulder", "right_shoulder", "overhead", "wrist", "front")
    for kind in ("rgb", "depth", "mask", "point_cloud")
]


def write_episode(
    episode: Episode, recorded: RLBenchSource | None, work: Path, *, with_descriptions: bool
) -> None:
    """Fill a folder with the episode, beginning with what was recorded if anything was."""
    planes = {name: _planes(episode, recorded, name) for name in episode.views}
    if recorded is None:
        made = _fresh_pickles(episode, planes)
    else:
        _copy_unknown(recorded, episode, work)
        demo, made = _edited_demo(recorded, episode), {}
        if demo is not recorded.demo or OLD_NUMPY_LACKS in (work / LOW_DIM).read_bytes():
            made[LOW_DIM] = dump(demo)
        if with_descriptions or episode.descriptions != recorded.descriptions:
            made[DESCRIPTIONS] = dump(list(episode.descriptions))
    _write_images(episode, recorded, work, planes)
    write_files(work, made)


def _copy_unknown(recorded: RLBenchSource, episode: Episode, work: Path) -> None:
    """Everything but the images we write ourselves; a report of an earlier augmentation stays behind.

    Raises BadInput for a pickle that holds more than values.
    """
    ours = {f"{name}_{kind}" for name in episode.views for kind in KINDS}
    for path in _entries(recorded.folder, ours):
        place = path.relative_to(recorded.folder)
        if path.is_dir():
            (work / place).mkdir()
            continue
        if path.suffix.lower() in PICKLES:
            load(path)
        else:
            see_no_pickle(path)
        files.pass_on(path, work / place)


def _entries(folder: Path, ours: Set[str] = frozenset()) -> Iterator[Path]:
    """All within a folder but what is `ours`, each folder before what is in it; linked ones are not looked into."""
    for entry in sorted(os.scandir(folder), key=lambda one: one.name):
        if ours and (entry.name in ours or entry.name.startswith("rpaug")):
            continue
        yield Path(entry.path)
        if entry.is_dir(follow_symlinks=False):
            yield from _entries(Path(entry.path))


def _edited_demo(recorded: RLBenchSource, episode: Episode) -> Demo:
    """The recorded demo; only the poses of cameras that moved are new."""
    moved = {
        name: view.camera.cam_to_world @ FLIP
        for name, view in episode.views.items()
        if view.camera is not recorded.views[name].camera
    }
    if not moved:
        return recorded.demo
    demo = copy.copy(recorded.demo)
    demo._observations = [copy.copy(o) for o in demo._observations]  # type: ignore[attr-defined]
    for t, observation in enumerate(demo._observations):  # type: ignore[attr-defined]
        poses = {f"{name}_camera_extrinsics": pose[t] for name, pose in moved.items()}
        observation.misc = {**observation.misc, **poses}
    return demo


def _fresh_pickles(episode: Episode, planes: Mapping[str, Planes]) -> dict[str, bytes]:
    """The three pickles of an episode that no RLBench simulation recorded."""
    robot, misc = episode.robot, []
    if robot.gripper_to_world is None or robot.gripper_open is None:
        reason = (
            "RLBench needs the gripper's pose and opening; the source does not say which they are"
        )
        raise Unsupported(f"{episode.key}: {reason} (cameras.yaml may)")
    velocities = _velocities(episode)
    own = {re.split("[/.]", name)[-1]: track for name, track in robot.extra.items()}
    for t in range(episode.length):
        here: dict[str, Any] = {}
        for name, view in episode.views.items():
            K = view.camera.K.copy()
            K[[0, 1], [0, 1]] *= -1
            here[f"{name}_camera_extrinsics"] = view.camera.cam_to_world[t] @ FLIP
            here[f"{name}_camera_intrinsics"] = K
            here[f"{name}_camera_near"], here[f"{name}_camera_far"] = planes[name][t]
        misc.append(here)
    demo = Demo()
    demo.__dict__ = {"_observations": [], "random_seed": None, "variation_number": 0}
    for t in range(episode.length):
        observation = Observation()
        observation.__dict__ = dict.fromkeys(IMAGES) | {
            "joint_velocities": velocities[t],
            "joint_positions": robot.joint_positions[t],
            "joint_forces": None,
            "gripper_open": float(robot.gripper_open[t]),
            "gripper_pose": np.concatenate(
                [
                    robot.gripper_to_world[t, :3, 3],
                    geometry.quaternion_of(robot.gripper_to_world[t]),
                ]
            ),
            "gripper_matrix": robot.gripper_to_world[t],
            "gripper_joint_positions": None,
            "gripper_touch_forces": None,
            "task_low_dim_state": None,
            "misc": misc[t],
        }
        observation.__dict__ |= {name: own[name][t] for name in EXTRAS if name in own}
        if COLLISIONS in own:
            observation.__dict__[COLLISIONS] = np.array(np.ravel(own[COLLISIONS][t])[0])
        demo._observations.append(observation)  # type: ignore[attr-defined]
    return {LOW_DIM: dump(demo), DESCRIPTIONS: dump(list(episode.descriptions)), NUMBER: dump(0)}


def _velocities(episode: Episode) -> Float64[np.ndarray, "t j"]:
    """Joint velocities in radians a second: recorded, or the joints' differences. Raises Unsupported for neither."""
    joints, velocities = episode.robot.joint_positions, episode.robot.joint_velocities
    if velocities.shape[1] or not joints.shape[1] or len(joints) < 2:
        return velocities
    if episode.rate is None:
        reason = (
            "RLBench's readers find key frames by joint velocities; the source has none, nor a rate"
        )
        raise Unsupported(f"{episode.key}: {reason} to tell them by (--fps gives it)")
    return np.gradient(joints, 1 / episode.rate, axis=0)


def _write_images(
    episode: Episode, recorded: RLBenchSource | None, work: Path, planes: Mapping[str, Planes]
) -> None:
    """All frames, a few at a time in threads: decoding and encoding release the interpreter."""
    kinds = {name: _kinds(episode, recorded, name) for name in episode.views}
    for name in kinds:
        for kind, _, _ in kinds[name]:
            (work / f"{name}_{kind}").mkdir()

    def write(t: int) -> None:
        # All cameras of one time together: each is drawn from what all recorded.
        for name in kinds:
            _write_frame(kinds[name], recorded, work, name, t, planes[name][t])

    with ThreadPoolExecutor(_threads(episode)) as pool:
        for _ in pool.map(write, range(episode.length)):
            pass


def _threads(episode: Episode) -> int:
    """Workers beside others are told to keep to themselves by the variables that libraries read."""
    few, most = THREADS
    cameras = (view.camera for view in episode.views.values())
    small = max(one.width * one.height for one in cameras) < SMALL
    alone = "OMP_NUM_THREADS" not in os.environ
    return max(few, min(most, os.cpu_count() or 1)) if alone and not small else few


def _kinds(
    episode: Episode, recorded: RLBenchSource | None, name: str
) -> list[tuple[str, Image, Image | None]]:
    """Kind, new and recorded accessor of the images a camera has."""
    new, old = episode.views[name], recorded.views[name] if recorded else None
    accessors = [
        ("rgb", new.rgb, old and old.rgb),
        ("depth", new.depth, old and old.depth),
        ("mask", new.ids, old and old.ids),
    ]
    return [(kind, image, before) for kind, image, before in accessors if image is not None]


def _write_frame(
    kinds: list[tuple[str, Image, Image | None]],
    recorded: RLBenchSource | None,
    work: Path,
    name: str,
    t: int,
    planes: tuple[float, float],
) -> None:
    for kind, new, old in kinds:
        file = f"{name}_{kind}/{t}.png"
        before = f"{recorded.folder}/{file}" if recorded and old else None
        code = recorded.codes[name] if recorded and old and kind == "depth" else None
        _write_image(kind, t, new, old, before, f"{work}/{file}", planes, code)


def _planes(episode: Episode, recorded: RLBenchSource | None, name: str) -> Planes:
    """Near and far plane of a camera at each frame, in metres: as recorded, or so that its farthest depth is held."""
    if recorded is None:
        depth, far = episode.views[name].depth, FAR
        for t in range(episode.length if depth else 0):
            seen = depth(t)
            far = max(far, float(seen[np.isfinite(seen)].max(initial=0.0)))
        return [(NEAR, far)] * episode.length
    observations = recorded.demo._observations  # type: ignore[attr-defined]
    return [
        (float(o.misc[f"{name}_camera_near"]), float(o.misc[f"{name}_camera_far"]))
        for o in observations
    ]


def _write_image(
    kind: str,
    t: int,
    new_image: Image,
    old_image: Image | None,
    recorded: str | None,
    target: str,
    planes: tuple[float, float],
    codes: Codes | None,
) -> None:
    """One PNG: a copy of the recorded file where nothing changed, so that its bytes stay."""
    if recorded and new_image is old_image:
        files.pass_on(recorded, target)
        return
    image = new_image(t)
    if recorded and old_image:
        before = old_image(t)
        if np.array_equal(image, before):
            files.pass_on(recorded, target)
            return
    if kind == "depth":
        code = _steps(image, *planes)
        if codes is not None:  # float32 holds a code only to within one step
            code = np.where(image == before, codes(t), code)
        image = _bytes_of(code)
    elif kind == "mask":
        plain = recorded and files.check_png(recorded, files.read_bytes(recorded)).channels == 1
        most = 255 if plain else MOST_ID
        if image.max() > most:
            folder = os.path.basename(os.path.dirname(target))
            raise Unsupported(f"{folder}: found id {image.max()}; masks here hold up to {most}")
        if not plain:
            image = _bytes_of(image)[..., ::-1]
    Path(target).write_bytes(files.encode_png(image.astype(np.uint8, copy=False)))


def _steps(depth: Float32[np.ndarray, "h w"], near: float, far: float) -> Int32[np.ndarray, "h w"]:
    """Depth as the file's fixed point; where nothing is, it has the far plane, as CoppeliaSim's renderer does."""
    something = np.isfinite(depth) & (depth > 0)
    share = (np.where(something, depth, far).astype(np.float64) - near) / (far - near)
    return np.rint(np.clip(share, 0.0, 1.0) * DEPTH_STEPS).astype(np.int32)


def _bytes_of(code: Int32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """The three bytes of an integer below 2^24, the highest first."""
    return np.ascontiguousarray(code, ">i4").view(np.uint8).reshape(*code.shape, 4)[..., 1:]
