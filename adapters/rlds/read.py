"""Reading an RLDS episode: which features are what, and every image's header before it is believed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from rpaug_adapters.rlds import shards
from rpaug_adapters.rlds.example import Example
from rpaug_adapters.rlds.features import FEATURES, Leaf, leaves
from rpaug_adapters.rlds.pixels import decoder, most_id
from rpaug_adapters.shared import cameras, episodes
from rpaug_adapters.shared.cameras import Beside
from rpaug_adapters.shared.images import image_size, lazy_colors, lazy_depth

from rpaug import BadInput, Camera, CameraView, Episode

STEPS = "steps/"
WORDS = (
    "instruction",
    "language",
    "task",
)  # in the names of features that hold the words, best first
NUMBERS = frozenset({"float32", "float64", "int32", "int64", "bool", "uint8", "uint16", "uint32"})


@dataclass(frozen=True)
class RLDSSource:
    """Where an episode came from, its record, and which features its views and words are."""

    folder: Path
    own: Path  # what lies beside this episode alone
    example: Example
    views: dict[str, CameraView]
    images: dict[str, Leaf]
    depths: dict[str, tuple[Leaf, float]]
    ids: dict[str, Leaf]
    beside: Beside
    language: str | None
    descriptions: tuple[str, ...]


def read_episode(folder: Path, split: str, number: int, key: str) -> Episode:
    """Episode `number` of a split, images lazy. Raises BadInput."""
    known = leaves(folder)
    if known is None:
        raise BadInput(folder / FEATURES, "steps", found="none", expected="an RLDS dataset")
    example = Example(*shards.record(folder, split, number))
    own = folder / split / str(number)
    beside = cameras.load((own, folder))
    images = _found(folder, example, known, beside)
    length = len(example.blobs(next(iter(images.values())).key))
    sizes = {name: _size(example, leaf.key, length) for name, leaf in images.items()}
    tracks = _tracks(example, known, length)
    named = _beside(folder, example, known, beside, "depth")
    depths = {name: (leaf, beside.cameras[name].metres) for name, leaf in named.items()}
    ids = _beside(folder, example, known, beside, "ids")
    language = _language(example, known, beside)
    descriptions = _descriptions(example, language)

    def view(name: str, camera: Camera) -> CameraView:
        return _view(example, images[name], depths.get(name), ids.get(name), camera, length)

    def recorded(views: dict[str, CameraView]) -> RLDSSource:
        return RLDSSource(
            folder, own, example, views, images, depths, ids, beside, language, descriptions
        )

    return episodes.episode(key, beside, sizes, tracks, length, descriptions, view, recorded)


def _found(
    folder: Path, example: Example, known: dict[str, Leaf], beside: Beside
) -> dict[str, Leaf]:
    """Color images by the name of their view: the last part of the key, or all of it where two share that."""
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
    views = cameras.chosen(beside, views, _stepwise(known))
    if not views:
        raise BadInput(folder / FEATURES, "images", found="none", expected="a color image a step")
    return views


def _stepwise(known: dict[str, Leaf]) -> dict[str, Leaf]:
    """The features of the steps, by the names that a side file calls them."""
    return {key.removeprefix(STEPS): leaf for key, leaf in known.items() if leaf.stepwise}


def _size(example: Example, key: str, length: int) -> tuple[int, int]:
    """Width and height that all images of a feature share."""
    blobs = example.blobs(key)
    if len(blobs) != length:
        raise BadInput(example.where, key, found=f"{len(blobs)} images", expected=f"{length}")
    return image_size(blobs, lambda t: f"{example.where}, {key}, step {t}")


def _beside(
    folder: Path, example: Example, known: dict[str, Leaf], beside: Beside, which: str
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
    leaf: Leaf,
    depth: tuple[Leaf, float] | None,
    ids: Leaf | None,
    camera: Camera,
    length: int,
) -> CameraView:
    shape = camera.height, camera.width

    def whole(stored: Callable[[int], np.ndarray]) -> Callable[[int], np.ndarray]:
        return lambda t: stored(t).astype(np.int32)

    return CameraView(
        camera,
        lazy_colors(example.blobs(leaf.key), lambda t: f"{example.where}, {leaf.key}, step {t}"),
        None if depth is None else lazy_depth(decoder(example, depth[0], shape, length), depth[1]),
        None if ids is None else whole(decoder(example, ids, shape, length)),
        most_id=CameraView.most_id if ids is None else most_id(ids),
    )


def _language(example: Example, known: dict[str, Leaf], beside: Beside) -> str | None:
    """The feature that holds the instruction: named, or a text of one value a step whose name says so."""
    if beside.language is not None:
        key = STEPS + beside.language if STEPS + beside.language in known else beside.language
        cameras.known(beside, "language", key, known)
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


def _tracks(
    example: Example, known: dict[str, Leaf], length: int
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
