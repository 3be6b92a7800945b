"""Reading an RLBench episode: pickles, cameras and images, each checked before it is believed."""

import os
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8
from rpaug_adapters.rlbench.pickles import Demo, Observation, load
from rpaug_adapters.shared.held import HeldImages

from rpaug import BadInput, Camera, CameraView, Episode, Robot, files, geometry, kernel

KINDS = ("rgb", "depth", "mask")
DEPTH_STEPS = 2**24 - 1
MOST_TEXTS = 1000  # wordings of one instruction; RLBench has some ten
MOST_NUMBERS = 4096  # of one field of an observation that is no array
LOW_DIM = "low_dim_obs.pkl"
NUMBER = "variation_number.pkl"
DESCRIPTIONS = "variation_descriptions.pkl"
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])  # CoppeliaSim's camera axes <-> OpenCV's; its own inverse
EXTRAS = ("joint_forces", "gripper_joint_positions", "gripper_touch_forces", "task_low_dim_state")
COLLISIONS = "ignore_collisions"  # one number, of the fork of RLBench that PerAct and RVT read with

Codes = Callable[[int], Int32[np.ndarray, "h w"]]


@dataclass(frozen=True)
class RLBenchSource:
    """Where an episode came from and what its low-dimensional pickle held; `codes` are depth as its files hold it."""

    folder: Path
    demo: Demo
    views: dict[str, CameraView]
    codes: dict[str, Codes]
    descriptions: tuple[str, ...]


def read_episode(folder: Path, key: str) -> Episode:
    """The episode in a folder, images lazy. Raises BadInput."""
    demo = load(folder / LOW_DIM)
    observations = _observations(folder / LOW_DIM, demo)
    for path in sorted(folder.glob("*.pkl")):
        if path.name != LOW_DIM:
            _see_plain(path)
    held = HeldImages()
    codes = {name: held.of(partial(_code, folder, name)) for name in _cameras(folder)}
    views = {name: _view(folder, name, observations, held, code) for name, code in codes.items()}
    descriptions = _descriptions(folder)
    return Episode(
        key=key,
        views=views,
        robot=_robot(folder / LOW_DIM, observations),
        descriptions=descriptions,
        length=len(observations),
        source=RLBenchSource(folder, demo, views, codes, descriptions),
    )


def _see_plain(path: Path) -> None:
    """See that a pickle holds values alone: it is passed on, and what is in it would run in other readers. Raises
    BadInput, also for a variation that is no number."""
    value = load(path)
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if path.name == NUMBER and not whole:
        raise BadInput(path, "variation", found=type(value).__name__, expected="a whole number")


def untouched(source: RLBenchSource) -> dict[str, bytes]:
    """All that an episode's files hold beside images, descriptions and extrinsics, by name: fields of its pickle over
    all frames, and other files."""
    demo = vars(source.demo)
    observations = [vars(one) for one in demo["_observations"]]
    poses = {f"{name}_camera_extrinsics" for name in source.views}
    found = {name: pickle.dumps(value) for name, value in demo.items() if name != "_observations"}
    for part in ("", "misc"):
        rows = [one["misc"] if part else one for one in observations]
        for name in {name for row in rows for name in row} - poses - {"misc"}:
            found[f"{part} {name}".strip()] = pickle.dumps([row.get(name) for row in rows])
    for path in source.folder.iterdir():
        ours = path.name in (LOW_DIM, DESCRIPTIONS) or path.name.startswith("rpaug")
        if path.is_file() and not ours:
            found[path.name] = path.read_bytes()
    return found


def _observations(path: Path, demo: Any) -> list[Observation]:
    observations = getattr(demo, "_observations", None)
    if not isinstance(demo, Demo) or not isinstance(observations, list) or not observations:
        found = "none" if isinstance(demo, Demo) else f"no demo but a {type(demo).__name__}"
        raise BadInput(path, "_observations", found=found, expected="a Demo with observations")
    if len(set(map(id, observations))) < len(observations):
        found = f"{len(observations)}, some of them one and the same"
        raise BadInput(path, "_observations", found=found, expected="one for each frame")
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
            if len(texts) > MOST_TEXTS:
                expected = f"at most {MOST_TEXTS}"
                raise BadInput(path, "descriptions", found=f"{len(texts)}", expected=expected)
            return tuple(texts)
    return ()


def _numbers(
    path: Path, values: Sequence[Any], field: str, shape: tuple[int, ...]
) -> list[Float64[np.ndarray, "..."]]:
    """A field at all frames: at once where all are plain numbers of one shape. Raises BadInput."""
    kinds = {
        (type(value), getattr(value, "dtype", None), getattr(value, "shape", ()))
        for value in values
    }
    (kind, dtype, found), *others = kinds
    plain = kind is float or (kind is np.ndarray and dtype == np.float64)
    if plain and not others and _fits(found, shape):
        rows = np.array(values, np.float64)
        if np.isfinite(rows).all():
            return list(rows)
    return [_number(path, t, field, value, shape) for t, value in enumerate(values)]


def _fits(found: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    """Whether a shape is the wanted one, in which -1 stands for any length."""
    return len(found) == len(shape) and all(b in (-1, a) for a, b in zip(found, shape, strict=True))


def _number(
    path: Path, t: int, field: str, value: Any, shape: tuple[int, ...]
) -> Float64[np.ndarray, "..."]:
    """A finite float array of the given shape (-1: any), or BadInput."""
    if value is None:
        raise BadInput(
            path, f"observation {t}, {field}", found="nothing", expected=f"numbers of shape {shape}"
        )
    try:
        array = np.asarray(_plain(value), np.float64)
    except (TypeError, ValueError):
        raise BadInput(
            path,
            f"observation {t}, {field}",
            found=type(value).__name__,
            expected=f"numbers of shape {shape}",
        ) from None
    if not _fits(array.shape, shape):
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


def _plain(value: Any) -> Any:
    """A value that becomes an array of no more numbers than it holds. Raises ValueError.

    A list may hold another many times over, and that one a third: few bytes of a pickle, and an array without end.
    """
    rows = value if isinstance(value, list | tuple) else ()
    inner = [row for row in rows if isinstance(row, list | tuple)]
    deep = any(isinstance(one, list | tuple) for row in inner for one in row[:MOST_NUMBERS])
    if deep or len(rows) + sum(map(len, inner)) > MOST_NUMBERS:
        raise ValueError("lists in lists of lists, or too many numbers")
    return value


def _track(
    path: Path, observations: list[Observation], field: str, shape: tuple[int, ...]
) -> Float64[np.ndarray, "t ..."]:
    rows = _numbers(path, [getattr(o, field, None) for o in observations], field, shape)
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
    values = [o.misc.get(field) for o in observations]
    return np.stack(_numbers(path, values, f"misc[{field!r}]", shape))


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
    if getattr(observations[0], COLLISIONS, None) is not None:
        extra[COLLISIONS] = _track(path, observations, COLLISIONS, ())[:, None]
    return Robot(
        joint_positions=_track(path, observations, "joint_positions", (-1,)),
        joint_velocities=_track(path, observations, "joint_velocities", (-1,)),
        gripper_to_world=geometry.pose_of(pose[:, :3], pose[:, 3:]),
        gripper_open=_track(path, observations, "gripper_open", ()),
        extra=extra,
    )


def _view(
    folder: Path, name: str, observations: list[Observation], held: HeldImages, code: Codes
) -> CameraView:
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
    size, mask_channels = _check_images(folder, name, length)
    intrinsics = np.abs(K[0]) if (K[0][[0, 1], [0, 1]] < 0).all() else K[0]
    has = {kind: (folder / f"{name}_{kind}").is_dir() for kind in KINDS}
    return CameraView(
        camera=Camera(intrinsics, extrinsics @ FLIP, *size),
        rgb=held.of(lambda t: files.decode_png(f"{folder}/{name}_rgb/{t}.png")),
        depth=(lambda t: _metres(code(t), near[t], far[t])) if has["depth"] else None,
        ids=held.of(lambda t: read_code(f"{folder}/{name}_mask/{t}.png", low_first=True))
        if has["mask"]
        else None,
        most_id=2 ** (8 * mask_channels) - 1,
    )


def _check_images(folder: Path, name: str, length: int) -> tuple[tuple[int, int], int]:
    """(width, height) of one camera's images after every one of them was found whole and of its kind, and the fewest
    channels of a mask."""
    size, mask_channels = None, 3
    for kind in KINDS:
        images = folder / f"{name}_{kind}"
        if not images.is_dir():
            continue
        count = sum(entry.name.endswith(".png") for entry in os.scandir(images))
        for t in range(length):
            path = (
                f"{images}/{t}.png"  # a Path for each of thousands would cost as much as its check
            )
            header = files.check_png(path, files.read_bytes(path))
            if header.bits != 8 or (kind != "mask" and header.channels != 3):
                wanted = "8 bits, 1 or 3 channels" if kind == "mask" else "8 bits, 3 channels"
                found = f"{header.bits} bits, {header.channels} channel(s)"
                raise BadInput(path, "kind of image", found=found, expected=wanted)
            mask_channels = min(mask_channels, header.channels)
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
    return size, mask_channels


def _code(folder: Path, name: str, t: int) -> Int32[np.ndarray, "h w"]:
    return read_code(f"{folder}/{name}_depth/{t}.png")


def read_code(path: Path | str, low_first: bool = False) -> Int32[np.ndarray, "h w"]:
    """The integer that an image's channels hold; a single-channel image is that integer."""
    image = files.decode_png(path)
    return image.astype(np.int32) if image.ndim == 2 else _joined(image, low_first)


@kernel
def _joined(image: UInt8[np.ndarray, "h w 3"], low_first: bool) -> Int32[np.ndarray, "h w"]:
    out = np.empty(image.shape[:2], np.int32)
    low, high = (0, 2) if low_first else (2, 0)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            out[y, x] = (
                image[y, x, low] | np.int32(image[y, x, 1]) << 8 | np.int32(image[y, x, high]) << 16
            )
    return out


@kernel
def _metres(code: Int32[np.ndarray, "h w"], near: float, far: float) -> Float32[np.ndarray, "h w"]:
    out = np.empty(code.shape, np.float32)
    for y in range(code.shape[0]):
        for x in range(code.shape[1]):
            out[y, x] = near + code[y, x] / DEPTH_STEPS * (far - near)
    return out
