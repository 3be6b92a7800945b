"""Some frames of a camera that stands still: where each differs from the backdrop, and which tints move."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from rpaug.core import sampling
from rpaug.core.types import CameraView
from rpaug.scene.instances import blobs, color_clusters
from rpaug.scene.instances.backdrop import Backdrop

FRAMES = 20  # of each camera, from which motion is told
MOBILE = 0.5  # of the most mobile tint's share of pixels that change: others that reach it move too
CARRIED = 0.6  # share of a tint's pixels that changed, from which nothing of it rests
OFTEN = 0.25  # of all changes that a mobile tint has part in, or it is a thing that was moved
FEW = 4  # changed pixels of a tint that are none
ENTERS = 0.3  # share of the frames in which a tint of the robot's reaches the image's edge, of those in which it moves
OPEN = 0.25  # share of the frames in which what the robot covers must be seen for it to be believed
STEADY = 6.0  # weighted Lab: what is seen there in those frames differs by no more


@dataclass(frozen=True)
class Watched:
    """`shown` are frames of a camera, `changed` where each differs from the backdrop, `labels` their tints.

    `tint` are the backdrop's.
    """

    backdrop: Backdrop
    cluster: Int[np.ndarray, "h w"]
    shown: np.ndarray  # (t, h, w, 3) uint8
    changed: Bool[np.ndarray, "t h w"]
    labels: Int[np.ndarray, "t h w"]
    clusters: color_clusters.ColorClusters

    @property
    def active(self) -> Bool[np.ndarray, "h w"]:
        """Where anything ever changed."""
        return np.any(self.changed, axis=0)

    def shades(self, mobile: Iterable[int]) -> Mapping[int, Float[np.ndarray, "3"]]:
        """The middle color, in weighted Lab, of what changed in each of these tints."""
        found = {}
        for cluster in mobile:
            some = self.shown[self.changed & (self.labels == cluster)]
            if len(some):
                found[cluster] = np.median(
                    color_clusters.weighted(some[:: max(1, len(some) // 4000)]), 0
                )
        return found

    def without(self, robot: Bool[np.ndarray, "h w"], mobile: frozenset[int]) -> "Watched":
        """The same before the backdrop that frames show where the robot, which stood there for long, is away."""
        away = ~np.isin(self.labels, list(mobile)) & robot
        times = away.sum(0)
        seen = np.ma.masked_array(
            color_clusters.weighted(self.shown), ~np.repeat(away[..., None], 3, -1)
        )
        middle = np.ma.median(seen, axis=0)
        spread = np.ma.median(np.abs(seen - middle), axis=0).filled(np.inf).max(-1)
        known = robot & (times >= max(2.0, OPEN * len(self.shown))) & (spread < STEADY)
        if not known.any():
            return self
        colors = np.ma.masked_array(self.shown, seen.mask)
        image = self.backdrop.image.copy()
        image[known] = np.ma.median(colors, axis=0).filled(0)[known].astype(np.uint8)
        drop = replace(self.backdrop, image=image)
        changed = np.stack([drop.changed(one) for one in self.shown])
        return replace(
            self,
            backdrop=drop,
            cluster=color_clusters.labelled(image, self.clusters),
            changed=changed,
        )


def watch(
    view: CameraView, length: int, drop: Backdrop, known: color_clusters.ColorClusters
) -> Watched:
    """Look at frames of a camera before its backdrop."""
    shown = np.stack([view.rgb(t) for t in sampling.frames(length, FRAMES)])
    changed = np.stack([drop.changed(image) for image in shown])
    labels = np.stack([color_clusters.labelled(image, known) for image in shown])
    return Watched(drop, color_clusters.labelled(drop.image, known), shown, changed, labels, known)


def mobile(cameras: Iterable[Watched], count: int) -> tuple[frozenset[int], frozenset[int]]:
    """The tints of what moves, on one side or the other of most changes and seldom where nothing changes; and those of
    what it carries all the time, which are seen almost only where something changes."""
    moving, shown = np.zeros(count), np.zeros(count)
    pairs = np.zeros((count, count))  # changed pixels by the tint they show and the backdrop's
    enters, changes = np.zeros(count), np.zeros(count)  # frames
    for watched in cameras:
        for changed, label in zip(watched.changed, watched.labels, strict=True):
            shown += np.bincount(label.reshape(-1), minlength=count)
            moving += np.bincount(label[changed], minlength=count)
            np.add.at(pairs, (label[changed], watched.cluster[changed]), 1)
            found = np.flatnonzero(np.bincount(label[changed], minlength=count) >= FEW)
            changes[found] += 1
            enters[[k for k in found if _enters(label == k, changed)]] += 1
    entering = (
        enters > ENTERS * changes
    )  # what a gripper carries is seldom cut off by the image's edge
    mobility = moving / np.maximum(shown, 1)
    movers = _movers(pairs, mobility, entering)
    if not movers.any():
        return frozenset(), frozenset()
    loose = ~movers & ~entering & (mobility > CARRIED) & (shown > blobs.SMALL * shown.sum())
    return frozenset(np.flatnonzero(movers).tolist()), frozenset(np.flatnonzero(loose).tolist())


def _movers(
    pairs: Float[np.ndarray, "k k"], mobility: Float[np.ndarray, "k"], able: Bool[np.ndarray, "k"]
) -> Bool[np.ndarray, "k"]:
    """The tints that explain changes, each most of those that the ones before it leave unexplained.

    What a robot covers and uncovers changes as often as the robot, but never without it.
    """
    found, total, left = np.zeros(len(mobility), bool), pairs.sum(), pairs.copy()
    if not total:
        return found
    involved = pairs.sum(0) + pairs.sum(1) - np.diag(pairs)
    often = able & (involved >= OFTEN * total)
    if not often.any():
        return found
    enough = often & (mobility > MOBILE * mobility[often].max())
    for cluster in np.argsort(-mobility, kind="stable"):
        explained = left[cluster].sum() + left[:, cluster].sum() - left[cluster, cluster]
        if enough[cluster] and explained >= OFTEN * total:
            found[cluster] = True
            left[cluster] = left[:, cluster] = 0
    return found


def _enters(mask: Bool[np.ndarray, "h w"], changed: Bool[np.ndarray, "h w"]) -> bool:
    """Does a piece of the mask in which something changed reach the image's edge?"""
    _, pieces = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    rim = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    return bool(np.intersect1d(rim[rim > 0], pieces[mask & changed]).size)
