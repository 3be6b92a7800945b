"""Reading an RLDS episode: which features are what, and every image's header before it is believed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from rpaug_adapters import _rlds_cameras, _rlds_files
from rpaug_adapters._example import Example
from rpaug_adapters._rlds_cameras import Beside, Calibration, Gripper
from rpaug_adapters._rlds_features import FEATURES, Leaf, leaves

from rpaug import BadInput, Camera, CameraView, Episode, Robot
from rpaug.files import check_image, decode_image
from rpaug.geometry import pose_of, rotation

STEPS = "steps/"
WORDS = (
    "instruction",
    "language",
    "task",
)  # in the names of features that hold the words, best first
FOCAL = 1.2  # longest sides: what COLMAP assumes of an unknown camera
NUMBERS = frozenset({"float32", "float64", "int32", "int64", "bool", "uint8", "uint16", "uint32"})


@dataclass(frozen=True)
class Recorded:
    """Where an episode came from, its record, and which features its views and words are."""

    folder: Path
    example: Example
    views: dict[str, CameraView]
    images: dict[str, Leaf]
    depths: dict[str, tuple[Leaf, float]]
    beside: Beside
    language: str | None
    descriptions: tuple[str, ...]


def read(folder: Path, split: str, number: int, key: str) -> Episode:
    """Episode `number` of a split, images lazy. Raises BadInput."""
    known = leaves(folder)
    if known is None:
        raise BadInput(folder / FEATURES, "steps", found="none", expected="an RLDS dataset")
    example = Example(*_rlds_files.record(folder, split, number))
    beside = _rlds_cameras.load((folder / split / str(number), folder))
    images = _images(folder, example, known, beside)
    length = len(example.blobs(next(iter(images.values())).key))
    sizes = {name: _check(example, leaf.key, length) for name, leaf in images.items()}
    depths = _depths(folder, example, known, beside, images, length)
    views = {
        name: _view(
            example, leaf, depths.get(name), _camera(example, beside, name, sizes[name], length)
        )
        for name, leaf in images.items()
    }
    language = _language(example, known, beside)
    descriptions = _descriptions(example, language)
    return Episode(
        key=key,
        views=views,
        robot=_robot(folder, example, known, beside, length),
        descriptions=descriptions,
        length=length,
        source=Recorded(folder, example, views, images, depths, beside, language, descriptions),
    )


def _images(
    folder: Path, example: Example, known: dict[str, Leaf], beside: Beside
) -> dict[str, Leaf]:
    """Colour images by the name of their view: the last part of the key, or all of it where two share that."""
    found = [
        leaf
        for leaf in known.values()
        if leaf.kind == "Image" and leaf.stepwise and leaf.dtype in ("uint8", "")
        and (len(leaf.shape) < 3 or leaf.shape[2] in (3, 4, None)) and any(example.blobs(leaf.key))
    ]  # fmt: skip
    names = [leaf.name for leaf in found]
    views = {
        leaf.name if names.count(leaf.name) == 1 else leaf.key.removeprefix(STEPS): leaf
        for leaf in found
    }
    if beside.views is not None:
        for name in beside.views:
            _known(folder, f"views, {name}", name, views)
        views = {name: views[name] for name in beside.views}
    for name in beside.cameras:
        _known(folder, f"cameras.{name}", name, views)
    if not views:
        raise BadInput(folder / FEATURES, "images", found="none", expected="a colour image a step")
    return dict(sorted(views.items()))


def _known(folder: Path, field: str, name: str, among: Sequence[str] | dict[str, Leaf]) -> None:
    if name not in among:
        listed = ", ".join(sorted(among))
        raise BadInput(folder / _rlds_cameras.NAME, field, found=name, expected=f"one of: {listed}")


def _check(example: Example, key: str, length: int) -> tuple[int, int]:
    """Width and height that all images of a feature share."""
    size, blobs = None, example.blobs(key)
    if len(blobs) != length:
        raise BadInput(example.where, key, found=f"{len(blobs)} images", expected=f"{length}")
    for t, data in enumerate(blobs):
        here = check_image(f"{example.where}, {key}, step {t}", data)
        if here != (size := size or here):
            expected = f"{size[0]}x{size[1]} as in the first step"
            raise BadInput(
                example.where, f"{key}, step {t}", found=f"{here[0]}x{here[1]}", expected=expected
            )
    assert size is not None
    return size


def _depths(
    folder: Path,
    example: Example,
    known: dict[str, Leaf],
    beside: Beside,
    images: dict[str, Leaf],
    length: int,
) -> dict[str, tuple[Leaf, float]]:
    """The depth feature of each calibrated camera that names one, and how many metres its unit is."""
    found = {}
    for name, calibration in beside.cameras.items():
        if calibration.depth is None:
            continue
        key = STEPS + calibration.depth
        among = sorted(k.removeprefix(STEPS) for k, leaf in known.items() if leaf.stepwise)
        _known(folder, f"cameras.{name}.depth", calibration.depth, among)
        leaf = known[key]
        if leaf.kind == "Image" and _check(example, key, length) != _check(
            example, images[name].key, length
        ):
            raise BadInput(example.where, key, found="another size", expected=f"that of {name}")
        found[name] = leaf, calibration.metres
    return found


def _camera(
    example: Example, beside: Beside, name: str, size: tuple[int, int], length: int
) -> Camera:
    width, height = size
    calibration: Calibration | None = beside.cameras.get(name)
    if calibration is None:
        focal = FOCAL * max(size)
        K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        return Camera(K, np.tile(np.eye(4), (length, 1, 1)), width, height, assumed=True)
    numbers = None
    if calibration.pose_key is not None:
        numbers = example.numbers(STEPS + calibration.pose_key).astype(float)
    track = _rlds_cameras.poses(f"camera {name}", calibration, numbers, length)
    return Camera(calibration.intrinsics(width, height), track, width, height)


def _view(
    example: Example, leaf: Leaf, depth: tuple[Leaf, float] | None, camera: Camera
) -> CameraView:
    def rgb(t: int) -> np.ndarray:
        image = decode_image(f"{example.where}, {leaf.key}, step {t}", example.blobs(leaf.key)[t])
        return image if image.ndim == 3 else np.repeat(image[..., None], 3, 2)

    return CameraView(camera, rgb, None if depth is None else _depth(example, *depth, camera))


def _depth(
    example: Example, leaf: Leaf, metres: float, camera: Camera
) -> Callable[[int], Float32[np.ndarray, "h w"]]:
    shape = camera.height, camera.width

    def from_image(t: int) -> Float32[np.ndarray, "h w"]:
        data = np.frombuffer(example.blobs(leaf.key)[t], np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        if image is not None and leaf.dtype == "float32" and image.ndim == 3:
            # TFDS stores float images as the four bytes of each number, in RGBA.
            image = np.ascontiguousarray(image[..., [2, 1, 0, 3]]).view("<f4")[..., 0]
        if image is None or image.shape[:2] != shape or image.ndim != 2:
            where = f"{leaf.key}, step {t}"
            raise BadInput(example.where, where, found="no such image", expected="one of depth")
        return np.nan_to_num(image.astype(np.float32) * np.float32(metres), posinf=0, neginf=0)

    def from_numbers(t: int) -> Float32[np.ndarray, "h w"]:
        values = example.floats(leaf.key)
        try:
            frames = values.reshape(-1, *shape)
        except ValueError:
            expected = f"{shape[0]}x{shape[1]} a step"
            raise BadInput(
                example.where, leaf.key, found=f"{len(values)} numbers", expected=expected
            ) from None
        return np.nan_to_num(frames[t] * np.float32(metres), posinf=0, neginf=0)

    return from_image if leaf.kind == "Image" else from_numbers


def _language(example: Example, known: dict[str, Leaf], beside: Beside) -> str | None:
    """The feature that holds the instruction: named, or a text of one value a step whose name says so."""
    if beside.language is not None:
        key = STEPS + beside.language if STEPS + beside.language in known else beside.language
        _known(Path(example.where), "language", key, known)
        return key
    texts = [
        leaf.key
        for leaf in known.values()
        if leaf.key in example.features and (leaf.kind == "Text" or leaf.dtype in ("string", "object"))
    ]  # fmt: skip
    for word in WORDS:
        for key in sorted(texts, key=lambda key: (not key.startswith(STEPS), key)):
            if word in key.rpartition("/")[2]:
                return key
    return None


def _descriptions(example: Example, language: str | None) -> tuple[str, ...]:
    if language is None:
        return ()
    texts = [text.decode(errors="replace").strip() for text in example.blobs(language)]
    return tuple(dict.fromkeys(text for text in texts if text))


def _robot(
    folder: Path, example: Example, known: dict[str, Leaf], beside: Beside, length: int
) -> Robot:
    extra = {}
    for leaf in known.values():
        if leaf.stepwise and leaf.kind in ("Tensor", "Scalar") and leaf.dtype in NUMBERS:
            feature = example.features.get(leaf.key)
            if feature is not None and feature.kind in ("float", "int"):
                extra[leaf.key.removeprefix(STEPS)] = _track(example, leaf.key, length)
    none = np.zeros((length, 0))
    joints = none
    if beside.joints is not None:
        _known(folder, "joints", beside.joints, sorted(extra))
        joints = extra[beside.joints]
    pose, opening = None, None
    if beside.gripper is not None:
        _known(folder, "gripper.key", beside.gripper.key, sorted(extra))
        pose, opening = _gripper(folder, beside.gripper, extra[beside.gripper.key])
    return Robot(joints, np.zeros_like(joints), pose, opening, extra)


def _track(example: Example, key: str, length: int) -> Float64[np.ndarray, "t k"]:
    numbers = example.numbers(key).astype(np.float64)
    if len(numbers) % length:
        expected = f"a multiple of the {length} steps"
        raise BadInput(example.where, key, found=f"{len(numbers)} numbers", expected=expected)
    return numbers.reshape(length, -1)


def _gripper(
    folder: Path, told: Gripper, state: Float64[np.ndarray, "t k"]
) -> tuple[Float64[np.ndarray, "t 4 4"], Float64[np.ndarray, "t"] | None]:
    """The gripper's pose and opening from columns of the state. Euler angles turn about the fixed x, y, z in turn."""
    columns = [*told.position, *told.rotation, *([] if told.opening is None else [told.opening])]
    wanted = 3 if told.convention == "euler_xyz" else 4
    if not all(0 <= c < state.shape[1] for c in columns) or len(told.rotation) != wanted:
        found = f"columns {columns} of {state.shape[1]}, {len(told.rotation)} for the rotation"
        expected = f"columns that are there, {wanted} for the rotation"
        raise BadInput(folder / _rlds_cameras.NAME, "gripper", found=found, expected=expected)
    position, turn = state[:, told.position], state[:, told.rotation]
    if told.convention == "euler_xyz":
        pose = np.tile(np.eye(4), (len(state), 1, 1))
        axes = [
            np.stack([rotation(a * axis) for a in angles])
            for angles, axis in zip(turn.T, np.eye(3), strict=True)
        ]
        pose[:, :3, :3], pose[:, :3, 3] = axes[2] @ axes[1] @ axes[0], position
    else:
        order = [0, 1, 2, 3] if told.convention == "quaternion_xyzw" else [1, 2, 3, 0]
        pose = pose_of(position, turn[:, order])
    return pose, None if told.opening is None else state[:, told.opening]
