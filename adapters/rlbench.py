"""RLBench, PerAct and COLOSSEUM episodes: a folder of PNGs and three pickles each.

`<episode>/{front,left_shoulder,right_shoulder,overhead,wrist}_{rgb,depth,mask}/<t>.png`, `low_dim_obs.pkl`,
`variation_number.pkl`, `variation_descriptions.pkl`. Traps this file knows about:

- the camera model is CoppeliaSim's: focal lengths are negative and a camera looks along +z with x to the left and
  y up; pixel centres lie at integer coordinates, as everywhere in rpaug;
- depth is 24-bit fixed point over three channels between the camera's near and far plane, z and not ray length;
- a mask codes the object's handle as R + 256 G + 65536 B; COLOSSEUM's may be single-channel, taken as it is;
- upstream RLBench keeps the descriptions in `variation<N>/`, not in the episode;
- readers run numpy 1 and push every attribute of an observation into a replay buffer: nothing may be added there.
"""

import copy
import os
import re
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float32, Float64, Int32
from rpaug_adapters._pickles import Demo, Observation, dump, load

from rpaug import Adapter, BadInput, Camera, CameraView, Episode, Robot, Side
from rpaug.files import atomic_folder, check_png, decode_png, encode_png, read_bytes
from rpaug.geometry import pose_of, quaternion_of

KINDS = ("rgb", "depth", "mask")
DEPTH_STEPS = 2**24 - 1
LOW_DIM = "low_dim_obs.pkl"
DESCRIPTIONS = "variation_descriptions.pkl"
NUMBER = "variation_number.pkl"
EPISODE = re.compile(r"episode(\d+)$")
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])  # CoppeliaSim's camera axes <-> OpenCV's; its own inverse
NEAR, FAR = 0.01, 10.0  # metres: depth range of cameras that were not recorded by CoppeliaSim
THREADS = 2
Image = Callable[[int], np.ndarray]
IMAGES = [
    f"{camera}_{kind}"
    for camera in ("left_shoulder", "right_shoulder", "overhead", "wrist", "front")
    for kind in ("rgb", "depth", "mask", "point_cloud")
]
EXTRAS = ("joint_forces", "gripper_joint_positions", "gripper_touch_forces", "task_low_dim_state")


@dataclass(frozen=True)
class Recorded:
    """Where an episode came from and what its low-dimensional pickle held."""

    folder: Path
    demo: Demo
    views: dict[str, CameraView]
    descriptions: tuple[str, ...]


class RLBench(Adapter):
    """Reads and writes RLBench-format datasets in every layout named above."""

    name: ClassVar[str] = "rlbench"

    def episodes(self, root: Path) -> Sequence[str]:
        keys, seen = [], set()
        for folder, subfolders, files in os.walk(root, followlinks=True, onerror=_unreadable):
            here = Path(folder)
            true = here.resolve()
            if true in seen:  # a link that leads back
                subfolders.clear()
                continue
            seen.add(true)
            if LOW_DIM in files or (EPISODE.search(here.name) and here != root):
                keys.append(here.relative_to(root).as_posix())
                subfolders.clear()
            subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        return sorted(keys, key=_natural)

    def read(self, root: Path, key: str) -> Episode:
        folder = root / key
        demo = load(folder / LOW_DIM)
        observations = _observations(folder / LOW_DIM, demo)
        views = {name: _view(folder, name, observations) for name in _cameras(folder)}
        descriptions = _descriptions(folder)
        return Episode(
            key=key,
            views=views,
            robot=_robot(folder / LOW_DIM, observations),
            descriptions=descriptions,
            length=len(observations),
            source=Recorded(folder, demo, views, descriptions),
        )

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, Recorded) else None
        with atomic_folder(root / key) as work:
            if recorded is None:
                files = _fresh_pickles(episode)
            else:
                _copy_unknown(recorded, episode, work)
                files = {LOW_DIM: dump(_edited_demo(recorded, episode))}
                if episode.descriptions != recorded.descriptions or _nowhere(recorded, root, key):
                    files[DESCRIPTIONS] = dump(list(episode.descriptions))
            _write_images(episode, recorded, work)
            for name, data in (files | dict(side())).items():
                (work / name).write_bytes(data)

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / f"episode{index}").as_posix()

    def finish(self, source: Path, target: Path) -> None:
        """Descriptions that upstream RLBench keeps beside the `episodes` folder."""
        for key in self.episodes(target):
            beside = _beside(key)
            if beside and (source / beside).is_file() and not (target / beside).exists():
                shutil.copyfile(source / beside, target / beside)


def _unreadable(error: OSError) -> None:
    raise BadInput(
        str(error.filename), "folder", found=error.strerror, expected="a readable folder"
    )


def _beside(key: str) -> str | None:
    """Where upstream RLBench keeps an episode's descriptions, if that lies within the dataset's root."""
    parts = PurePosixPath(key).parts
    return PurePosixPath(*parts[:-2], DESCRIPTIONS).as_posix() if len(parts) > 2 else None


def _nowhere(recorded: Recorded, root: Path, key: str) -> bool:
    """Whether descriptions came from outside the episode and `finish` has no place for them in the target."""
    return (
        bool(recorded.descriptions)
        and not (recorded.folder / DESCRIPTIONS).is_file()
        and not _beside(key)
    )


def _natural(key: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", key)]


# Reading


def _observations(path: Path, demo: Any) -> list[Observation]:
    observations = getattr(demo, "_observations", None)
    if not isinstance(demo, Demo) or not isinstance(observations, list) or not observations:
        found = "none" if isinstance(demo, Demo) else f"no demo but a {type(demo).__name__}"
        raise BadInput(path, "_observations", found=found, expected="a Demo with observations")
    for t, observation in enumerate(observations):
        if not isinstance(observation, Observation) or not isinstance(
            getattr(observation, "misc", None), dict
        ):
            raise BadInput(
                path,
                f"observation {t}",
                found=type(observation).__name__,
                expected="an Observation with misc",
            )
    return observations


def _cameras(folder: Path) -> list[str]:
    names = sorted(path.name[:-4] for path in folder.glob("*_rgb") if path.is_dir())
    if not names:
        raise BadInput(
            folder, "cameras", found="no *_rgb folder", expected="at least one camera's images"
        )
    return names


def _descriptions(folder: Path) -> tuple[str, ...]:
    for path in (folder / DESCRIPTIONS, folder.parent.parent / DESCRIPTIONS):
        if path.is_file():
            texts = load(path)
            if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
                raise BadInput(
                    path, "descriptions", found=type(texts).__name__, expected="a list of strings"
                )
            return tuple(texts)
    return ()


def _number(
    path: Path, t: int, field: str, value: Any, shape: tuple[int, ...]
) -> Float64[np.ndarray, "..."]:
    """A finite float array of the given shape (-1: any), or BadInput."""
    if value is None:
        raise BadInput(
            path, f"observation {t}, {field}", found="nothing", expected=f"numbers of shape {shape}"
        )
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise BadInput(
            path,
            f"observation {t}, {field}",
            found=type(value).__name__,
            expected=f"numbers of shape {shape}",
        ) from None
    if len(array.shape) != len(shape) or any(
        b not in (-1, a) for a, b in zip(array.shape, shape, strict=True)
    ):
        raise BadInput(
            path,
            f"observation {t}, {field}",
            found=f"shape {array.shape}",
            expected=f"shape {shape}",
        )
    if not np.isfinite(array).all():
        raise BadInput(
            path, f"observation {t}, {field}", found="NaN or infinity", expected="finite numbers"
        )
    return array


def _track(
    path: Path, observations: list[Observation], field: str, shape: tuple[int, ...]
) -> Float64[np.ndarray, "t ..."]:
    rows = [
        _number(path, t, field, getattr(o, field, None), shape) for t, o in enumerate(observations)
    ]
    if any(row.shape != rows[0].shape for row in rows):
        raise BadInput(
            path,
            field,
            found="a size that changes over time",
            expected="the same size in all frames",
        )
    return np.stack(rows)


def _misc(
    path: Path, observations: list[Observation], field: str, shape: tuple[int, ...]
) -> Float64[np.ndarray, "t ..."]:
    return np.stack(
        [
            _number(path, t, f"misc[{field!r}]", o.misc.get(field), shape)
            for t, o in enumerate(observations)
        ]
    )


def _robot(path: Path, observations: list[Observation]) -> Robot:
    pose = _track(path, observations, "gripper_pose", (7,))
    length = np.linalg.norm(pose[:, 3:], axis=1)
    if (np.abs(length - 1) > 1e-2).any():
        t = int(np.abs(length - 1).argmax())
        where = f"observation {t}, gripper_pose"
        raise BadInput(
            path,
            where,
            found=f"a quaternion of length {length[t]:.3g}",
            expected="a unit quaternion",
        )
    extra = {
        name: _track(path, observations, name, (-1,))
        for name in EXTRAS
        if getattr(observations[0], name, None) is not None
    }
    return Robot(
        joint_positions=_track(path, observations, "joint_positions", (-1,)),
        joint_velocities=_track(path, observations, "joint_velocities", (-1,)),
        gripper_to_world=pose_of(pose[:, :3], pose[:, 3:]),
        gripper_open=_track(path, observations, "gripper_open", ()),
        extra=extra,
    )


def _view(folder: Path, name: str, observations: list[Observation]) -> CameraView:
    path, length = folder / LOW_DIM, len(observations)
    K = _misc(path, observations, f"{name}_camera_intrinsics", (3, 3))
    for t, i in ((t, i) for t in range(length) for i in range(2) if K[t, i, i] == 0):
        where = f"observation {t}, misc['{name}_camera_intrinsics']"
        raise BadInput(
            path, where, found=f"focal length 0 at [{i}, {i}]", expected="one that is not zero"
        )
    if not (K[0] == K).all() or K[0, 0, 0] * K[0, 1, 1] < 0:
        where = f"misc['{name}_camera_intrinsics']"
        raise BadInput(
            path,
            where,
            found="a zoom, or focal lengths of two signs",
            expected="constant intrinsics",
        )
    extrinsics = _misc(path, observations, f"{name}_camera_extrinsics", (4, 4))
    turn = extrinsics[:, :3, :3]
    wrong = np.abs(turn @ turn.swapaxes(1, 2) - np.eye(3)).max((1, 2)) > 1e-3
    wrong |= (np.linalg.det(turn) < 0) | (extrinsics[:, 3] != [0, 0, 0, 1]).any(1)
    if wrong.any():
        where = f"observation {int(wrong.argmax())}, misc['{name}_camera_extrinsics']"
        raise BadInput(
            path, where, found="no rigid motion", expected="a rotation and a shift, camera to world"
        )
    near = _misc(path, observations, f"{name}_camera_near", ())
    far = _misc(path, observations, f"{name}_camera_far", ())
    if not (near < far).all():
        raise BadInput(
            path, f"misc['{name}_camera_far']", found="far <= near", expected="near < far"
        )
    size = _check_images(folder, name, length)
    intrinsics = np.abs(K[0]) if (K[0][[0, 1], [0, 1]] < 0).all() else K[0]
    has = {kind: (folder / f"{name}_{kind}").is_dir() for kind in KINDS}
    return CameraView(
        camera=Camera(intrinsics, extrinsics @ FLIP, *size),
        rgb=lambda t: decode_png(folder / f"{name}_rgb" / f"{t}.png"),
        depth=(lambda t: _metres(_code(folder / f"{name}_depth" / f"{t}.png"), near[t], far[t]))
        if has["depth"]
        else None,
        ids=(lambda t: _code(folder / f"{name}_mask" / f"{t}.png", low_first=True))
        if has["mask"]
        else None,
    )


def _check_images(folder: Path, name: str, length: int) -> tuple[int, int]:
    """(width, height) of one camera's images after every one of them was found whole and of its kind."""
    size = None
    for kind in KINDS:
        images = folder / f"{name}_{kind}"
        if not images.is_dir():
            continue
        count = sum(entry.name.endswith(".png") for entry in os.scandir(images))
        for t in range(length):
            path = images / f"{t}.png"
            header = check_png(path, read_bytes(path))
            if header.bits != 8 or (kind != "mask" and header.channels != 3):
                wanted = "8 bits, 1 or 3 channels" if kind == "mask" else "8 bits, 3 channels"
                found = f"{header.bits} bits, {header.channels} channel(s)"
                raise BadInput(path, "kind of image", found=found, expected=wanted)
            here = header.width, header.height
            size = size or here
            if here != size:
                first = f"{size[0]}x{size[1]} as in the camera's first image"
                raise BadInput(path, "size", found=f"{here[0]}x{here[1]}", expected=first)
        if count != length:
            raise BadInput(
                images, "frames", found=f"{count} images", expected=f"{length}, as {LOW_DIM} holds"
            )
    assert size is not None  # the rgb folder exists and length >= 1
    return size


def _code(path: Path, low_first: bool = False) -> Int32[np.ndarray, "h w"]:
    """The integer that an image's channels hold; a single-channel image is that integer."""
    image = decode_png(path).astype(np.int32)
    if image.ndim == 2:
        return image
    first, middle, last = (0, 1, 2) if low_first else (2, 1, 0)
    return image[..., first] + (image[..., middle] << 8) + (image[..., last] << 16)


def _metres(code: Int32[np.ndarray, "h w"], near: float, far: float) -> Float32[np.ndarray, "h w"]:
    return (near + code / DEPTH_STEPS * (far - near)).astype(np.float32)


# Writing


def _copy_unknown(recorded: Recorded, episode: Episode, work: Path) -> None:
    """Everything but the images we write ourselves; a report of an earlier augmentation stays behind."""
    ours = {f"{name}_{kind}" for name in episode.views for kind in KINDS}
    for entry in os.scandir(recorded.folder):
        if entry.name in ours or entry.name.startswith("rpaug"):
            continue
        if entry.is_dir():
            shutil.copytree(entry.path, work / entry.name)
        else:
            shutil.copyfile(entry.path, work / entry.name)


def _edited_demo(recorded: Recorded, episode: Episode) -> Demo:
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


def _fresh_pickles(episode: Episode) -> dict[str, bytes]:
    """The three pickles of an episode that no RLBench simulation recorded."""
    robot, misc = episode.robot, []
    for t in range(episode.length):
        here: dict[str, Any] = {}
        for name, view in episode.views.items():
            K = view.camera.K.copy()
            K[[0, 1], [0, 1]] *= -1
            here[f"{name}_camera_extrinsics"] = view.camera.cam_to_world[t] @ FLIP
            here[f"{name}_camera_intrinsics"] = K
            here[f"{name}_camera_near"], here[f"{name}_camera_far"] = NEAR, FAR
        misc.append(here)
    demo = Demo()
    demo.__dict__ = {"_observations": [], "random_seed": None, "variation_number": 0}
    for t in range(episode.length):
        observation = Observation()
        observation.__dict__ = dict.fromkeys(IMAGES) | {
            "joint_velocities": robot.joint_velocities[t],
            "joint_positions": robot.joint_positions[t],
            "joint_forces": None,
            "gripper_open": float(robot.gripper_open[t]),
            "gripper_pose": np.concatenate(
                [robot.gripper_to_world[t, :3, 3], quaternion_of(robot.gripper_to_world[t])]
            ),
            "gripper_matrix": robot.gripper_to_world[t],
            "gripper_joint_positions": None,
            "gripper_touch_forces": None,
            "task_low_dim_state": None,
            "ignore_collisions": np.array(1.0),
            "misc": misc[t],
        }
        observation.__dict__ |= {
            name: track[t] for name, track in robot.extra.items() if name in EXTRAS
        }
        demo._observations.append(observation)  # type: ignore[attr-defined]
    return {LOW_DIM: dump(demo), DESCRIPTIONS: dump(list(episode.descriptions)), NUMBER: dump(0)}


def _write_images(episode: Episode, recorded: Recorded | None, work: Path) -> None:
    """All frames, a few at a time in threads: decoding and encoding release the interpreter."""
    with ThreadPoolExecutor(THREADS) as pool:
        jobs = []
        for name in episode.views:
            planes = _planes(recorded, name, episode.length)
            kinds = _kinds(episode, recorded, name)
            for kind, _, _ in kinds:
                (work / f"{name}_{kind}").mkdir()
            jobs += [
                pool.submit(_write_frame, kinds, recorded, work, name, t, planes[t])
                for t in range(episode.length)
            ]
        for job in jobs:
            job.result()


def _kinds(
    episode: Episode, recorded: Recorded | None, name: str
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
    recorded: Recorded | None,
    work: Path,
    name: str,
    t: int,
    planes: tuple[float, float],
) -> None:
    for kind, new, old in kinds:
        file = Path(f"{name}_{kind}") / f"{t}.png"
        _write_image(
            kind,
            t,
            new,
            old,
            recorded.folder / file if recorded and old else None,
            work / file,
            planes,
        )


def _planes(recorded: Recorded | None, name: str, length: int) -> list[tuple[float, float]]:
    """Near and far plane of a camera at each frame, in metres."""
    if recorded is None:
        return [(NEAR, FAR)] * length
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
    recorded: Path | None,
    target: Path,
    planes: tuple[float, float],
) -> None:
    """One PNG: a copy of the recorded file where nothing changed, so that its bytes stay."""
    if recorded and new_image is old_image:
        shutil.copyfile(recorded, target)
        return
    image = new_image(t)
    if recorded and old_image:
        before = old_image(t)
        if np.array_equal(image, before):
            shutil.copyfile(recorded, target)
            return
    if kind == "depth":
        code = _steps(image, *planes)
        if recorded and old_image:
            code = np.where(
                image == before, _code(recorded), code
            )  # float32 holds a code to within one step
        image = np.stack([code >> 16, code >> 8 & 255, code & 255], -1).astype(np.uint8)
    elif kind == "mask" and not (recorded and decode_png(recorded).ndim == 2):
        image = np.stack([image & 255, image >> 8 & 255, image >> 16 & 255], -1).astype(np.uint8)
    target.write_bytes(encode_png(image.astype(np.uint8)))


def _steps(depth: Float32[np.ndarray, "h w"], near: float, far: float) -> Int32[np.ndarray, "h w"]:
    share = (depth.astype(np.float64) - near) / (far - near)
    return np.rint(np.clip(share, 0.0, 1.0) * DEPTH_STEPS).astype(np.int32)
