"""The same places seen by two cameras at one time: matte ones look alike, and what shines does not."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float32, Float64, Int64

from rpaug.core import geometry, sampling
from rpaug.core.types import CameraView, Episode
from rpaug.scene.lighting import casting
from rpaug.scene.recorded import lit

FRAMES = 3
PIXELS = 120  # of one thing, from one image
WHITE = 0.98  # of a channel: beyond, it may be cut off
NEAR = 0.006  # metres, and as a share of its depth: two surfaces are one place
FAR = 0.005


@dataclass(frozen=True, eq=False)
class SeenTwice:
    """Places, by how much brighter (0..1) the first camera saw them than the second, how bright it saw them, and where
    both eyes were. `pairs` numbers the two cameras."""

    difference: Float32[np.ndarray, "n 3"]
    level: Float32[np.ndarray, "n"]
    pairs: Int64[np.ndarray, "n"]
    points: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]
    first: Float32[np.ndarray, "n 3"]
    second: Float32[np.ndarray, "n 3"]
    ids: Int64[np.ndarray, "n"]
    times: Int64[np.ndarray, "n"]

    def every(self, step: int) -> "SeenTwice":
        """One of so many of them."""
        return SeenTwice(*(getattr(self, part.name)[::step] for part in fields(self)))


def seen_twice(episode: Episode, known: list[CameraView]) -> SeenTwice | None:
    """Some places of every thing, away from its outlines; None if no two of the views show the same."""
    found = [
        part
        for t in sampling.frames(episode.length, FRAMES)
        for first in range(len(known))
        for part in _beside(first, known, t)
    ]
    if not found:
        return None
    return SeenTwice(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _beside(one: int, known: list[CameraView], t: int) -> Iterator[tuple[np.ndarray, ...]]:
    first = known[one]
    rows = _some(first, t)
    ids, places = casting.discs_of(first, t, rows)
    color = first.rgb(t).reshape(-1, 3)[rows]
    for number, second in enumerate(known):
        if number == one:
            continue
        here, there = _same(second, t, places.points, ids)
        other = second.rgb(t).reshape(-1, 3)[there]
        told = (color[here].max(1) < 255 * WHITE) & (other.max(1) < 255 * WHITE)
        here, other = here[told], other[told]
        if len(here):
            difference = (color[here].astype(np.float32) - other) / np.float32(255)
            eyes = [
                np.tile(view.camera.cam_to_world[t, :3, 3].astype(np.float32), (len(here), 1))
                for view in (first, second)
            ]
            when = np.full(len(here), t)
            points, normals = places.points[here], places.normals[here]
            level = color[here].mean(1, dtype=np.float32) / np.float32(255)
            pair = np.full(len(here), len(known) * one + number)
            instance_ids = ids[here].astype(np.int64)
            yield difference, level, pair, points, normals, *eyes, instance_ids, when


def exposed(places: SeenTwice) -> Float64[np.ndarray, "n"]:
    """What is left of the difference, mean of channels, if each two cameras only differ in how long they expose."""
    left = places.difference.mean(1).astype(float)
    for pair in np.unique(places.pairs):
        rows = places.pairs == pair
        left[rows] -= (
            np.median(left[rows] / np.maximum(places.level[rows], 0.02)) * places.level[rows]
        )
    return left


def _some(view: CameraView, t: int) -> Int64[np.ndarray, "n"]:
    """Pixels of each thing, away from its outline."""
    assert view.ids is not None
    ids = view.ids(t)
    inside = np.flatnonzero(lit.inside(ids) & (ids > 0))
    order = inside[np.argsort(ids.reshape(-1)[inside], kind="stable")]
    _, count = np.unique(ids.reshape(-1)[order], return_counts=True)
    each = np.split(order, np.cumsum(count)[:-1])
    return np.concatenate([one[:: max(1, len(one) // PIXELS)] for one in each])


def _same(
    view: CameraView, t: int, points: Float32[np.ndarray, "n 3"], ids: np.ndarray
) -> tuple[Int64[np.ndarray, "k"], Int64[np.ndarray, "k"]]:
    """Which of the places the view shows too, and at which of its pixels."""
    assert view.ids is not None
    assert view.depth is not None
    K, height, width = view.camera.K, view.camera.height, view.camera.width
    x, y, z = geometry.transform(geometry.inverse(view.camera.cam_to_world[t]), points).T
    ahead = z > 1e-3
    column = np.rint(K[0, 0] * x / np.where(ahead, z, 1) + K[0, 2])
    row = np.rint(K[1, 1] * y / np.where(ahead, z, 1) + K[1, 2])
    within = ahead & (column >= 0) & (row >= 0) & (column < width) & (row < height)
    here = np.flatnonzero(within)
    there = (row[here] * width + column[here]).astype(np.int64)
    close = np.abs(view.depth(t).reshape(-1)[there] - z[here]) < NEAR + FAR * z[here]
    seen = view.ids(t)
    same = close & (seen.reshape(-1)[there] == ids[here]) & lit.inside(seen).reshape(-1)[there]
    return here[same], there[same]
