"""Reading an RLDS episode: which features are what, and every image's header before it is believed."""

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from rpaug_adapters.rlds import shards
from rpaug_adapters.rlds.example import Example
from rpaug_adapters.rlds.features import FEATURES, Leaf, leaves
from rpaug_adapters.rlds.pixels import TensorColors, decoder, most_id
from rpaug_adapters.shared import cameras, episodes
from rpaug_adapters.shared.cameras import Beside
from rpaug_adapters.shared.folders import see_no_link_out
from rpaug_adapters.shared.images import image_size, lazy_colors, lazy_depth

from rpaug import BadInput, Camera, CameraView, Episode

STEPS = "steps/"
# In the names of features that hold the words; the last only where there are none of the others.
WORDS, ELSE = ("instruction", "language"), "task"
JPEG = b"\xff\xd8"
FLOATS = ("float16", "float32", "float64")
LEAST = 16  # pixels a side: tensors with fewer rows or columns are matrices
# By how a dataset's name begins, the number that is the gripper's opening: 1 is wide open. BridgeData's files call the
# seven numbers joint angles; they are position, rotation and this.
OPENINGS = {"bridge": ("observation/state", 6)}
NUMBERS = frozenset({"float32", "float64", "int32", "int64", "bool", "uint8", "uint16", "uint32"})


@dataclass(frozen=True)
class RLDSSource:
    """Where an episode came from, its record, and which features its views and words are."""

    root: Path  # of the dataset as it was given, which may hold several
    folder: Path
    own: Path  # what lies beside this episode alone
    example: Example
    views: dict[str, CameraView]
    images: dict[str, Leaf]
    depths: dict[str, tuple[Leaf, float]]
    ids: dict[str, Leaf]
    beside: Beside
    languages: tuple[str, ...]
    descriptions: tuple[str, ...]

    @property
    def shown(self) -> set[str]:
        """The features with images, depth and instance ids."""
        leaves = [
            *self.images.values(),
            *self.ids.values(),
            *(leaf for leaf, _ in self.depths.values()),
        ]
        return {leaf.key for leaf in leaves}


def read_episode(root: Path, folder: Path, split: str, number: int, key: str) -> Episode:
    """Episode `number` of a split, images lazy. Raises BadInput."""
    known = leaves(folder)
    if known is None:
        raise BadInput(folder / FEATURES, "steps", found="none", expected="an RLDS dataset")
    own = folder / split / str(number)
    if own.is_dir():
        see_no_link_out(folder, own)
    example = Example(*shards.record(folder, split, number))
    beside = cameras.load(root, (own, folder))
    images = _found(folder, example, known, beside)
    length = _length(example, known)
    colors = {name: _colors(example, leaf, length) for name, leaf in images.items()}
    sizes = {name: size for name, (size, _) in colors.items()}
    tracks = _tracks(example, known, length)
    named = _beside(folder, example, known, beside, "depth")
    depths = {name: (leaf, beside.cameras[name].metres) for name, leaf in named.items()}
    ids = _beside(folder, example, known, beside, "ids")
    languages = _languages(example, known, beside)
    descriptions = _descriptions(example, languages)

    def view(name: str, camera: Camera) -> CameraView:
        return _view(example, colors[name][1], depths.get(name), ids.get(name), camera, length)

    def recorded(views: dict[str, CameraView]) -> RLDSSource:
        return RLDSSource(
            root, folder, own, example, views, images, depths, ids, beside, languages, descriptions
        )

    made = episodes.episode(key, beside, sizes, tracks, length, descriptions, view, recorded)
    if beside.gripper is None and (opening := _opening(folder, tracks)) is not None:
        made = replace(made, robot=replace(made.robot, gripper_open=opening))
    unread = () if beside.views is not None else _unread(example, known, made.source.shown)
    return replace(made, unread=unread)


def _opening(
    folder: Path, tracks: Mapping[str, Float64[np.ndarray, "t k"]]
) -> Float64[np.ndarray, "t"] | None:
    """How far the gripper is open, in datasets whose layout is public; None where no file or name tells."""
    called = shards.called(folder)
    for name, (key, column) in OPENINGS.items():
        track = tracks.get(key)
        if called.startswith(name) and track is not None and column < track.shape[1]:
            return np.clip(track[:, column], 0.0, 1.0)
    return None


def _length(example: Example, known: Mapping[str, Leaf]) -> int:
    """How many steps a record has: as many as its encoded images, texts or flags. Raises BadInput."""
    for leaf in known.values():
        feature = example.features.get(leaf.key)
        if not leaf.stepwise or feature is None:
            continue
        if leaf.kind in ("Image", "Text") and feature.kind == "bytes":
            count = len(example.blobs(leaf.key))
        elif leaf.kind in ("Scalar", "Tensor") and not leaf.shape and feature.kind != "bytes":
            count = len(example.numbers(leaf.key))
        else:
            continue
        if count:
            return count
    raise BadInput(example.where, "steps", found="no feature to count them by", expected="steps")


def _found(
    folder: Path, example: Example, known: Mapping[str, Leaf], beside: Beside
) -> dict[str, Leaf]:
    """Color images by the name of their view: the last part of the key, or all of it where two share that."""
    found = [leaf for leaf in known.values() if leaf.stepwise and _is_color(example, leaf)]
    names = [leaf.name for leaf in found]
    views = {
        leaf.name if names.count(leaf.name) == 1 else leaf.key.removeprefix(STEPS): leaf
        for leaf in found
    }
    views = cameras.chosen(beside, views, _stepwise(known))
    if not views:
        raise BadInput(folder / FEATURES, "images", found="none", expected="a color image a step")
    return views


def _is_color(example: Example, leaf: Leaf) -> bool:
    """Whether a feature can be nothing else than a camera's images: bytes with three or four channels, or JPEG."""
    if leaf.kind == "Image" and leaf.dtype in ("uint8", ""):
        blobs = example.blobs(leaf.key)
        several = len(leaf.shape) < 3 or leaf.shape[2] in (3, 4, None)
        return any(blobs) and (several or all(data[:2] == JPEG for data in blobs))
    return (
        leaf.kind == "Tensor"
        and leaf.dtype == "uint8"
        and len(leaf.shape) == 3
        and leaf.shape[2] in (3, 4)
        and _large(leaf)
        and leaf.key in example.features
    )


def _large(leaf: Leaf) -> bool:
    """Whether a tensor may be an image by its sides, as far as they are stated."""
    return len(leaf.shape) >= 2 and all(side is None or side >= LEAST for side in leaf.shape[:2])


def _unread(example: Example, known: Mapping[str, Leaf], understood: Set[str]) -> tuple[str, ...]:
    """What may be images and is not understood, in sentences."""
    found = []
    for leaf in known.values():
        image = leaf.kind in ("Image", "Video") or (leaf.kind == "Tensor" and _large(leaf))
        if leaf.stepwise and image and leaf.key not in understood and leaf.key in example.features:
            name = leaf.key.removeprefix(STEPS)
            sides = "x".join("?" if side is None else str(side) for side in leaf.shape)
            found.append(
                f"{name} ({sides} {leaf.dtype}) stays as it is recorded: {cameras.NAME} may say that it is color"
                f" (images: {{NAME: {name}}}), depth or ids"
            )
    return tuple(found)


def _colors(
    example: Example, leaf: Leaf, length: int
) -> tuple[tuple[int, int], Callable[[int], np.ndarray]]:
    """Width and height of a feature's images, and the images. Raises BadInput."""
    if leaf.kind == "Image":
        size = _size(example, leaf.key, length)
        place = partial("{}, {}, step {}".format, example.where, leaf.key)
        return size, lazy_colors(example.blobs(leaf.key), place)
    if leaf.kind != "Tensor" or leaf.dtype not in ("uint8", *FLOATS):
        expected = "an image, or a tensor of bytes or floats"
        raise BadInput(
            example.where, leaf.key, found=f"{leaf.kind} {leaf.dtype}", expected=expected
        )
    found = TensorColors(example, leaf, length)
    return found.size, found


def _stepwise(known: Mapping[str, Leaf]) -> dict[str, Leaf]:
    """The features of the steps, by the names that a side file calls them."""
    return {key.removeprefix(STEPS): leaf for key, leaf in known.items() if leaf.stepwise}


def _size(example: Example, key: str, length: int) -> tuple[int, int]:
    """Width and height that all images of a feature share."""
    blobs = example.blobs(key)
    if len(blobs) != length:
        raise BadInput(example.where, key, found=f"{len(blobs)} images", expected=f"{length}")
    return image_size(blobs, lambda t: f"{example.where}, {key}, step {t}")


def _beside(
    folder: Path, example: Example, known: Mapping[str, Leaf], beside: Beside, which: str
) -> dict[str, Leaf]:
    """The feature of depth, or of handles, that each calibrated camera names."""
    found = {}
    for name, calibration in beside.cameras.items():
        given = getattr(calibration, which)
        if given is not None:
            cameras.known(beside, f"cameras.{name}.{which}", given, _stepwise(known))
            found[name] = known[STEPS + given]
    return found


def _view(
    example: Example,
    colors: Callable[[int], np.ndarray],
    depth: tuple[Leaf, float] | None,
    ids: Leaf | None,
    camera: Camera,
    length: int,
) -> CameraView:
    shape = camera.height, camera.width
    stored = None if ids is None else decoder(example, ids, shape, length)
    return CameraView(
        camera,
        colors,
        None if depth is None else lazy_depth(decoder(example, depth[0], shape, length), depth[1]),
        None if stored is None else lambda t: stored(t).astype(np.int32),
        most_id=CameraView.most_id if ids is None else most_id(ids),
    )


def _languages(example: Example, known: Mapping[str, Leaf], beside: Beside) -> tuple[str, ...]:
    """The features that hold instructions, the main one first: those named, or texts whose names say so."""
    if beside.language is not None:
        given = [beside.language] if isinstance(beside.language, str) else beside.language
        keys = tuple(STEPS + name if STEPS + name in known else name for name in given)
        for key in keys:
            cameras.known(beside, "language", key, known)
        return keys
    names = texts(example, known)
    order = sorted(names, key=lambda key: (not key.startswith(STEPS), key))
    found = [key for word in WORDS for key in order if word in key.rpartition("/")[2]]
    return tuple(dict.fromkeys(found)) or tuple(
        [key for key in order if ELSE in key.rpartition("/")[2]][:1]
    )


def texts(example: Example, known: Mapping[str, Leaf]) -> list[str]:
    """The features of a record that hold texts."""
    return [
        leaf.key
        for leaf in known.values()
        if leaf.key in example.features and (leaf.kind == "Text" or leaf.dtype in ("string", "object"))
    ]  # fmt: skip


def _descriptions(example: Example, languages: tuple[str, ...]) -> tuple[str, ...]:
    texts = [
        text.decode(errors="replace").strip() for key in languages for text in example.blobs(key)
    ]
    return tuple(dict.fromkeys(text for text in texts if text))


def _tracks(
    example: Example, known: Mapping[str, Leaf], length: int
) -> dict[str, Float64[np.ndarray, "t k"]]:
    """All numbers of the steps that are no images."""
    found = {}
    for leaf in known.values():
        row = leaf.kind in ("Tensor", "Scalar") and len(leaf.shape) < 2
        numeric = row and leaf.dtype in NUMBERS
        feature = example.features.get(leaf.key)
        if leaf.stepwise and numeric and feature and feature.kind in ("float", "int"):
            found[leaf.key.removeprefix(STEPS)] = _track(example, leaf.key, length)
    return found


def _track(example: Example, key: str, length: int) -> Float64[np.ndarray, "t k"]:
    numbers = example.numbers(key).astype(np.float64)
    if len(numbers) % length:
        expected = f"a multiple of the {length} steps"
        raise BadInput(example.where, key, found=f"{len(numbers)} numbers", expected=expected)
    return numbers.reshape(length, -1)
