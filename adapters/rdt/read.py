"""Reading an ALOHA or RDT episode: one HDF5 file, nothing followed out of it, every image's header checked."""

from collections.abc import Callable, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float32, Float64, UInt8
from rpaug_adapters.shared import cameras, episodes
from rpaug_adapters.shared.cameras import Beside
from rpaug_adapters.shared.hdf5 import dataset, opened
from rpaug_adapters.shared.images import image_size, lazy_colors, lazy_depth
from rpaug_adapters.shared.texts import read_json

from rpaug import BadInput, Camera, CameraView, Episode, files

IMAGES = "observations/images"
QPOS = "observations/qpos"
WORDS = "expanded_instruction_gpt-4-turbo.json"
TEXTS = ("instruction", "simplified_instruction", "expanded_instruction")


@dataclass(frozen=True)
class RDTSource:
    """Where an episode came from, the datasets of its images, their encoded ones (None: stored as pixels), and what
    lies beside it."""

    path: Path
    views: dict[str, CameraView]
    images: dict[str, str]
    encoded: dict[str, list[bytes] | None]
    depths: dict[str, tuple[str, float]]
    words: dict[str, Any] | None
    beside: Beside
    descriptions: tuple[str, ...]


def read_episode(root: Path, path: Path, key: str) -> Episode:
    """The episode in a file, images lazy. Raises BadInput."""
    folder = path.parent
    files.see_inside(root, path, folder / WORDS)
    beside = cameras.load(root, (folder, folder.parent))
    with opened(path) as file:
        images = _found(path, file, beside)
        tracks = _tracks(path, file, frozenset(images.values()))
        length = len(tracks[QPOS])
        encoded = {name: _encoded(path, file, at, length) for name, at in images.items()}
        sizes = {name: _size(path, file, at, encoded[name]) for name, at in images.items()}
        depths = _depths(path, file, beside, sizes, length)
    words = _words(folder / WORDS)
    given = beside if beside.joints else beside.model_copy(update={"joints": QPOS})
    descriptions = _descriptions(words)

    def view(name: str, camera: Camera) -> CameraView:
        depth = None if name not in depths else _depth(path, *depths[name])
        return CameraView(camera, _colors(path, images[name], encoded[name]), depth)

    def recorded(views: dict[str, CameraView]) -> RDTSource:
        return RDTSource(path, views, images, encoded, depths, words, beside, descriptions)

    return episodes.episode(key, given, sizes, tracks, length, descriptions, view, recorded)


def untouched(path: Path, shown: Set[str]) -> dict[str, bytes]:
    """The values of all datasets of a file but those that are shown, and all attributes, by name. Raises BadInput."""
    found = {}
    with opened(path) as file:
        for name in _datasets(file):
            if name not in shown and name != "compress_len":
                held = dataset(path, file, name)
                values = held[()] if held.shape is not None else b""
                found[name] = repr((held.dtype.str, np.shape(values))).encode()
                found[name] += values.tobytes() if held.dtype.kind != "O" else repr(values).encode()
        for name in ("/", *_groups(file)):
            for key, value in file[name].attrs.items():
                found[f"{name}, attribute {key}"] = repr(value).encode()
    return found


def _groups(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visit(names.append)
    return names


def _tracks(
    path: Path, file: h5py.File, images: frozenset[str]
) -> dict[str, Float64[np.ndarray, "t k"]]:
    """Every dataset of numbers with one row a step that holds no images, by its path."""
    length = len(dataset(path, file, QPOS))
    if dataset(path, file, QPOS).ndim != 2 or not length:
        raise BadInput(
            path, QPOS, found=str(dataset(path, file, QPOS).shape), expected="one row a step"
        )
    found = {}
    for name in _datasets(file):
        if name in images or name.startswith(IMAGES):
            continue
        held = dataset(path, file, name)
        if held.dtype.kind in "fiub" and held.ndim in (1, 2) and len(held) == length:
            found[name] = np.asarray(held, np.float64).reshape(length, -1)
            if not np.isfinite(found[name]).all():
                raise BadInput(path, name, found="NaN or infinity", expected="finite numbers")
    return found


def _datasets(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visit(names.append)  # hard links alone are visited
    return [name for name in names if isinstance(file[name], h5py.Dataset)]


def _found(path: Path, file: h5py.File, beside: Beside) -> dict[str, str]:
    """The dataset of each camera's images: those in their usual group, as the side file names and picks them."""
    group = file.get(IMAGES)
    held = sorted(group) if isinstance(group, h5py.Group) else []
    usual = {name: f"{IMAGES}/{name}" for name in held}
    among = {name: name for name in (*_datasets(file), *usual.values())}
    views = cameras.chosen(beside, usual, among)
    if not views:
        raise BadInput(path, IMAGES, found="no cameras", expected="a dataset of images each")
    return views


def _encoded(path: Path, file: h5py.File, where: str, length: int) -> list[bytes] | None:
    """A camera's encoded images; None if pixels are stored."""
    held = dataset(path, file, where)
    if len(held.shape) == 0 or len(held) != length:
        found = f"shape {held.shape}"
        raise BadInput(path, where, found=found, expected=f"{length} images, as {QPOS} has rows")
    if held.ndim == 4 and held.dtype == np.uint8 and held.shape[3] == 3:
        return None
    padded = held.ndim == 2 and held.dtype == np.uint8
    if not padded and held.ndim != 1:
        expected = "encoded images, or height x width x 3 bytes each"
        raise BadInput(path, where, found=f"shape {held.shape}", expected=expected)
    rows = held[:]
    if padded or rows.dtype.kind == "O":
        return [np.asarray(row, np.uint8).tobytes().rstrip(b"\0") for row in rows]
    return [bytes(row) for row in rows]


def _size(path: Path, file: h5py.File, where: str, images: list[bytes] | None) -> tuple[int, int]:
    """Width and height that all images of a camera share."""
    if images is None:
        _, height, width, _ = dataset(path, file, where).shape
        return width, height
    return image_size(images, lambda t: f"{path}: {where}[{t}]")


def _depths(
    path: Path, file: h5py.File, beside: Beside, sizes: dict[str, tuple[int, int]], length: int
) -> dict[str, tuple[str, float]]:
    found = {}
    for name, given in beside.cameras.items():
        if given.depth is not None and name in sizes:
            held = dataset(path, file, given.depth)
            wanted = (length, *sizes[name][::-1])
            if held.shape != wanted or held.dtype.kind not in "fiu":
                raise BadInput(path, given.depth, found=str(held.shape), expected=str(wanted))
            found[name] = given.depth, given.metres
    return found


def _colors(
    path: Path, where: str, images: list[bytes] | None
) -> Callable[[int], UInt8[np.ndarray, "h w 3"]]:
    def from_file(t: int) -> UInt8[np.ndarray, "h w 3"]:
        with opened(path) as file:
            return dataset(path, file, where)[t]

    if images is None:
        return from_file
    decoded = lazy_colors(images, lambda t: f"{path}: {where}[{t}]")
    # RDT takes what OpenCV decodes for RGB as it is: its files hold red where a JPEG has blue.
    return lambda t: np.ascontiguousarray(decoded(t)[..., ::-1])


def _depth(path: Path, name: str, metres: float) -> Callable[[int], Float32[np.ndarray, "h w"]]:
    def stored(t: int) -> np.ndarray:
        with opened(path) as file:
            return dataset(path, file, name)[t]

    return lazy_depth(stored, metres)


def _words(path: Path) -> dict[str, Any] | None:
    """The instruction's file, or None where there is none. Raises BadInput."""
    if not path.is_file():
        return None
    given = read_json(path, "instructions")
    if not isinstance(given, dict) or "instruction" not in given:
        raise BadInput(path, "instruction", found="none", expected="a text or a list of texts")
    for name in TEXTS:
        if not isinstance(given.get(name, []), (str, list)):
            found = type(given[name]).__name__
            raise BadInput(path, name, found=found, expected="a text or a list of texts")
    return given


def _descriptions(words: dict[str, Any] | None) -> tuple[str, ...]:
    texts: list[str] = []
    for name in TEXTS:
        value = (words or {}).get(name, [])
        texts += (
            [value] if isinstance(value, str) else [text for text in value if isinstance(text, str)]
        )
    return tuple(dict.fromkeys(text for text in texts if text))
