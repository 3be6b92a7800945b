"""What words mean in an image, each thing with its outline: by a detector and a segmenter, or as somebody drew it.

A file of outlines is JSON: `{"EPISODE": {"CAMERA": {"FRAME": [{"words": "red cup", "polygon": [[x, y], ...]}]}}}`, in
pixels with their centres at integers; `polygons` may stand for a thing that is seen in pieces. What a frame lists is
all that it shows of the words that its episode knows.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from rpaug.core import fingerprint
from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes
from rpaug.providers import hub
from rpaug.providers.detect import Detection, Detector, detector
from rpaug.providers.models_settings import Models
from rpaug.providers.segment import GRABCUT, Segmenter, segmenter

OUTLINES = "outlines:"
MOST_BYTES = 2**28
TWICE = 0.7  # intersection over union: so much alike, two boxes of one image are about one thing
ARTICLES = re.compile(r"^(?:the|a|an|all|every|some)\s+")


@dataclass(frozen=True, eq=False)
class AskedImage:
    """One image, and where it stands."""

    episode: str
    camera: str
    frame: int
    image: UInt8[np.ndarray, "h w 3"]


class Finder(Protocol):
    """Finds the things that some words mean in one image, the surest first, each with its mask.

    `name` tells two finders apart that would answer otherwise.
    """

    name: str

    def frames(self, episode: str, camera: str, length: int) -> Sequence[int]:
        """The frames of a camera that it can be asked about."""
        ...

    def knows(self, episode: str, words: str) -> bool:
        """Whether it can say that an episode shows nothing that these words mean."""
        ...

    def __call__(self, asked: AskedImage, words: str) -> list[Detection]: ...


class DetectedOutlines:
    """A detector's boxes, and the segmenter's mask in each where the detector gives none."""

    def __init__(self, name: str, detect: Detector, segment: Segmenter) -> None:
        self.name, self._detect, self._segment = name, detect, segment

    def frames(self, episode: str, camera: str, length: int) -> Sequence[int]:
        """All of them."""
        return range(length)

    def knows(self, episode: str, words: str) -> bool:
        """Whatever they are."""
        return True

    def __call__(self, asked: AskedImage, words: str) -> list[Detection]:
        """Every thing once: of boxes on one thing the surest is kept."""
        found = list[Detection]()
        for one in self._detect(asked.image, words):
            mask = self._segment(asked.image, one.box) if one.mask is None else one.mask
            if mask.any() and all(overlap(mask, other.mask) < TWICE for other in found):
                found.append(Detection(one.box, one.score, mask))
        return found


class DrawnOutlines:
    """Outlines from a file. Raises BadInput for a file that is none."""

    def __init__(self, path: Path) -> None:
        data = read_bytes(path)
        self.name, self._path = f"{OUTLINES}{fingerprint.of(data)}", path
        if len(data) > MOST_BYTES:
            raise BadInput(path, "outlines", found=f"{len(data)} bytes", expected="at most 256 MB")
        try:
            self._known = _checked(json.loads(data))
        except (ValueError, RecursionError, _NoOutline) as error:
            expected = 'JSON: {"EPISODE": {"CAMERA": {"FRAME": [{"words": ..., "polygon": [[x, y], ...]}]}}}'
            raise BadInput(path, "outlines", found=str(error), expected=expected) from None

    def frames(self, episode: str, camera: str, length: int) -> Sequence[int]:
        """Those of the camera that somebody drew in."""
        return sorted(t for t in self._known.get(episode, {}).get(camera, {}) if t < length)

    def knows(self, episode: str, words: str) -> bool:
        """The words that somebody drew something for."""
        cameras = self._known.get(episode, {}).values()
        drawn = (one for frames in cameras for listed in frames.values() for one in listed)
        return any(stated == plain(words) for stated, _ in drawn)

    def __call__(self, asked: AskedImage, words: str) -> list[Detection]:
        """What the frame lists under exactly these words."""
        drawn = self._known.get(asked.episode, {}).get(asked.camera, {}).get(asked.frame, [])
        out = []
        for stated, polygons in drawn:
            if stated != plain(words):
                continue
            mask = np.zeros(asked.image.shape[:2], np.uint8)
            for polygon in polygons:
                fine = np.rint(np.asarray(polygon) * 16).astype(np.int32)  # sixteenths of a pixel
                cv2.fillPoly(mask, [fine], 1, shift=4)
            if mask.any():
                corners = np.concatenate([np.asarray(one) for one in polygons])
                (left, top), (right, bottom) = corners.min(0).tolist(), corners.max(0).tolist()
                out.append(Detection((left, top, right, bottom), 1.0, mask > 0))
        return out


Polygons = list[list[list[float]]]


class _NoOutline(Exception):
    """What of a file is no outline."""


def _checked(tree: Any) -> Mapping[str, Mapping[str, Mapping[int, list[tuple[str, Polygons]]]]]:
    """By episode, camera and frame: words and polygons. Raises _NoOutline."""
    return {
        str(key): {
            str(camera): {
                _frame(number, key, camera): [_outline(one, key, camera, number) for one in drawn]
                for number, drawn in _mapping(frames, f"{key}, {camera}").items()
            }
            for camera, frames in _mapping(cameras, str(key)).items()
        }
        for key, cameras in _mapping(tree, "the file").items()
    }


def _mapping(given: Any, where: str) -> dict[Any, Any]:
    if not isinstance(given, dict):
        raise _NoOutline(f"{where}: a {type(given).__name__}, no mapping")
    return given


def _frame(number: str, key: str, camera: str) -> int:
    if not number.isdecimal():
        raise _NoOutline(f"{key}, {camera}: a frame {number!r}")
    return int(number)


def _outline(one: Any, key: str, camera: str, number: str) -> tuple[str, Polygons]:
    where = f"{key}, {camera}, frame {number}"
    known = _mapping(one, where)
    polygons = known.get("polygons", [known.get("polygon")])
    if not isinstance(known.get("words"), str) or not isinstance(polygons, list) or not polygons:
        raise _NoOutline(f"{where}: an outline without words or polygon")
    for polygon in polygons:
        try:
            corners = np.asarray(polygon, np.float64)
        except (TypeError, ValueError):
            corners = np.zeros(0)
        if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3:
            raise _NoOutline(
                f"{where}: {known['words']!r}: no polygon of three corners [x, y] at least"
            )
        if not np.isfinite(corners).all() or np.abs(corners).max() > 1e5:
            raise _NoOutline(f"{where}: {known['words']!r}: corners beyond all pixels")
    return plain(known["words"]), polygons


def plain(words: str) -> str:
    """Words as they are compared: small letters, one space, no article."""
    return ARTICLES.sub("", " ".join(words.lower().split()).strip(" ."))


def overlap(one: Bool[np.ndarray, "h w"], other: Bool[np.ndarray, "h w"] | None) -> float:
    """Intersection over union; 0 for two empty masks."""
    if other is None:
        return 0.0
    union = int((one | other).sum())
    return int((one & other).sum()) / union if union else 0.0


def finder(models: Models) -> Finder:
    """The finder that these models make. Raises Unsupported, MissingExtra, BadInput."""
    assert models.text is not None
    if models.text.startswith(OUTLINES):
        return DrawnOutlines(Path(models.text.removeprefix(OUTLINES)))
    named = models.instances or GRABCUT
    device = models.device
    stated = [told(models.text), named if named == GRABCUT else told(named)]
    return DetectedOutlines(
        "|".join(stated), detector(models.text, device), segmenter(named, device)
    )


def told(name: str) -> str:
    """A model by what is in its folder, wherever that lies: what was found with it before is known by this."""
    return fingerprint.contents(hub.folder(name))
