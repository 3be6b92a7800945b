"""Writing an RLDS episode: its record with only what changed encoded anew, in the encoding it had."""

from collections.abc import Sequence

import cv2
import numpy as np
from rpaug_adapters import _cameras
from rpaug_adapters._rlds_features import Leaf
from rpaug_adapters._rlds_read import Recorded

from rpaug import CameraView, Episode, Unsupported
from rpaug.files import encode_jpeg, encode_png

JPEG = b"\xff\xd8"


def encoded(episode: Episode, recorded: Recorded) -> tuple[bytes, dict[str, bytes]]:
    """The record, and the files to lay beside it: `cameras.yaml` where a camera was moved."""
    changes: dict[str, Sequence[bytes] | np.ndarray] = {}
    for name, view in episode.views.items():
        before = recorded.views[name]
        if view.rgb is not before.rgb:
            leaf = recorded.images[name]
            changes[leaf.key] = _colours(recorded, leaf, view, before, episode.length)
        if name in recorded.depths and view.depth is not before.depth:
            leaf, metres = recorded.depths[name]
            changes[leaf.key] = _depths(recorded, leaf, metres, view, before, episode.length)
    if episode.descriptions != recorded.descriptions:
        key = recorded.language
        if key is None:
            raise Unsupported(f"{episode.key}: the words changed, and no feature holds any")
        count = len(recorded.example.blobs(key))
        changes[key] = [episode.instruction.encode()] * count
    beside = _cameras.moved(episode, recorded.views, recorded.beside)
    return recorded.example.replaced(changes), beside


def _colours(
    recorded: Recorded, leaf: Leaf, view: CameraView, before: CameraView, length: int
) -> list[bytes]:
    images = []
    for t, data in enumerate(recorded.example.blobs(leaf.key)[:length]):
        image = view.rgb(t)
        if not np.array_equal(image, before.rgb(t)):
            data = encode_jpeg(image) if data[:2] == JPEG else _like_png(image, data)
        images.append(data)
    return images


def _like_png(image: np.ndarray, data: bytes) -> bytes:
    """A PNG with the channels of the recorded one: transparency stays as it was."""
    whole = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if whole.ndim == 3 and whole.shape[2] == 4:
        whole[..., :3] = image[..., ::-1]
        return cv2.imencode(".png", whole)[1].tobytes()
    return encode_png(image)


def _depths(
    recorded: Recorded,
    leaf: Leaf,
    metres: float,
    view: CameraView,
    before: CameraView,
    length: int,
) -> Sequence[bytes] | np.ndarray:
    assert view.depth is not None
    assert before.depth is not None
    if leaf.kind != "Image":
        frames = [(view.depth(t) / np.float32(metres)).astype(np.float32) for t in range(length)]
        return np.concatenate([frame.ravel() for frame in frames])
    images = []
    for t, data in enumerate(recorded.example.blobs(leaf.key)[:length]):
        depth = view.depth(t)
        if not np.array_equal(depth, before.depth(t)):
            units = depth / np.float32(metres)
            if leaf.dtype == "float32":
                rgba = np.ascontiguousarray(units, "<f4")[..., None].view(np.uint8)
                stored = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]])
            else:
                kind = np.dtype(leaf.dtype or "uint16")
                stored = np.clip(np.rint(units), 0, np.iinfo(kind).max).astype(kind)
            data = cv2.imencode(".png", stored)[1].tobytes()
        images.append(data)
    return images
