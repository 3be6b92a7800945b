"""Small things that the instruction names by color: "push the red button" tells that a few red pixels are a thing."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from rpaug.core import color_space
from rpaug.scene.instances import blobs, color_clusters, ends
from rpaug.scene.instances.resting import Resting
from rpaug.scene.instances.watched import Watched

FEWEST = 8  # pixels: fewer are an outline or noise


@dataclass(frozen=True)
class Small:
    """One camera's part: the place of the thing, and the tints it has there."""

    where: Bool[np.ndarray, "h w"]
    clusters: frozenset[int]

    def shown(self, label: Int[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        """Where an image, by the tints of its pixels, shows it."""
        return self.where & np.isin(label, list(self.clusters))


def asked(words: Iterable[str], known: color_clusters.ColorClusters) -> frozenset[int]:
    """The tints that go by a color's name which is among the words."""
    names = {
        name
        for text in words
        for word in text.lower().split()
        if (name := color_space.canonical(word.strip(".,;:!"))) is not None
    }
    near = [color_space.nearest(_rgb(cluster)) for cluster in known]
    return frozenset(
        k for k, one in enumerate(near) if any(one == n or color_space.means(n, one) for n in names)
    )


def find(
    cameras: Mapping[str, Watched],
    seen: Mapping[str, Resting],
    mobile: frozenset[int],
    wanted: frozenset[int],
) -> dict[str, Small]:
    """Where cameras see the one small thing of the wanted tints before the robot covers it; none where a camera sees
    several, which nothing tells apart."""
    found = {}
    for name, watched in cameras.items():
        first, _ = ends.of(watched, mobile)
        label = color_clusters.labelled(first.image, watched.clusters)
        mask = first.known & np.isin(label, list(wanted - mobile))
        for k, blob in enumerate(seen[name].blobs):
            if blob.cluster in wanted and k not in seen[name].robot:
                mask &= ~(blob.mask | blobs.ring(blob.mask))
        _, pieces, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
        areas = stats[:, cv2.CC_STAT_AREA].copy()
        areas[0] = 0
        small = np.flatnonzero(areas >= FEWEST)
        if len(small) > 1:
            return {}
        if len(small):
            found[name] = Small(pieces == small[0], wanted)
    return found


def _rgb(cluster: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    lab = (cluster / np.array([color_clusters.LIGHTNESS, 1, 1])).astype(np.float32)
    return cv2.cvtColor(lab.reshape(1, 1, 3), cv2.COLOR_Lab2RGB).reshape(3).astype(np.float64)
