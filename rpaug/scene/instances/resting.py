"""The patches of one still camera's backdrop: which are the robot, and which left their place."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from rpaug.scene.instances import blobs
from rpaug.scene.instances.backdrop import Backdrop
from rpaug.scene.instances.blobs import Blob, ring
from rpaug.scene.instances.watched import Watched

TOUCHES = (
    0.08  # share of a resting patch's outline that lies beside what moves, if it is part of that
)
BARELY = 0.02  # the same, where it has the very color of what moves
SAME = 4.0  # weighted Lab: colors that differ by less are the same
CUT = 0.32  # share of a patch's outline that lies on the image's edge, from which it is no arm
RESTLESS = 0.5  # share of a patch that ever changed, from which it moves wherever it is
ISLAND = 0.9  # share of a patch's outline that lies on what never moves, if it stands there alone
ALONE = 0.1  # share of the frames in which such a patch and what is around it are seen undisturbed
WHOLE = 0.95  # share of it that is
AWAY = 0.5  # share of a thing's place that shows neither it nor what moves, in a frame in which it is not there
LEFT = 0.15  # share of the frames in which a thing that was moved is away
GONE = 0.15  # of its pixels that are then seen in another place, or something was only put on it


@dataclass(frozen=True)
class Resting:
    """One still camera before its patches have instance ids."""

    backdrop: Backdrop
    cluster: Int[np.ndarray, "h w"]
    blobs: list[Blob]
    mobile: frozenset[int]
    active: Bool[np.ndarray, "h w"]  # where anything ever changed
    away: Mapping[int, float]  # share of frames in which a patch is not in its place
    alone: Mapping[int, float]  # share of frames in which it and its surroundings are undisturbed
    shades: Mapping[int, Float[np.ndarray, "3"]]  # weighted Lab of what moves, by tint

    @classmethod
    def of(cls, watched: Watched, mobile: frozenset[int]) -> "Resting":
        """The patches of a camera's backdrop, and how often each is there and undisturbed."""
        found = blobs.find(watched.backdrop.image, watched.cluster, watched.clusters)
        elsewhere = ~np.isin(watched.labels, list(mobile)) & (watched.labels != watched.cluster)
        other = watched.changed & elsewhere
        away, alone = {}, {}
        for k, blob in enumerate(found):
            around = blob.mask | ring(blob.mask, 2)
            hidden = other[:, blob.mask].mean(1) > AWAY
            changed = (
                watched.changed[hidden] & (watched.labels[hidden] == blob.cluster) & ~blob.mask
            )
            gone = hidden.any() and np.median(changed.sum((1, 2))) >= GONE * blob.area
            away[k] = float(hidden.mean()) if gone else 0.0
            alone[k] = float((watched.changed[:, around].mean(1) < 1 - WHOLE).mean())
        return cls(
            watched.backdrop, watched.cluster, found, mobile, watched.active, away, alone, watched.shades(mobile)
        )  # fmt: skip

    @cached_property
    def robot(self) -> frozenset[int]:
        """Patches of a mobile tint beside which things change: the robot, where it stands for long."""
        found = set()
        for k, blob in enumerate(self.blobs):
            if blob.cluster not in self.mobile or self._stands_alone(k):
                continue
            near = self.active[ring(blob.mask) | blob.mask].mean()
            # A wall of the robot's tint is cut off by the image on most sides, an arm on one; and where both have the
            # very same color nothing tells them apart, so that both are left alone.
            shade = self.shades.get(blob.cluster)
            same = shade is not None and float(np.linalg.norm(blob.color - shade)) < SAME
            arm = (near > TOUCHES and blob.edge < CUT) or (near > BARELY and same)
            if arm or self.active[blob.mask].mean() > RESTLESS:
                found.add(k)
        return frozenset(found)

    @property
    def robot_mask(self) -> Bool[np.ndarray, "h w"]:
        """The pixels of those."""
        out = np.zeros(self.cluster.shape, bool)
        for k in self.robot:
            out |= self.blobs[k].mask
        return out

    @cached_property
    def left(self) -> frozenset[int]:
        """Patches of things that are not in their place in some of the frames."""
        return frozenset(
            k
            for k, blob in enumerate(self.blobs)
            if self.away[k] >= LEFT and blob.edge == 0 and blob.cluster not in self.mobile
        )

    def _stands_alone(self, k: int) -> bool:
        """Is a patch of the robot's tint a thing? A part of the robot is never seen without the rest of it."""
        blob = self.blobs[k]
        if blob.edge > 0 or self.alone[k] < ALONE:
            return False
        around = ring(blob.mask)
        touching = [
            other.mask[around].sum() for other in self.blobs if other.cluster in self.mobile
        ]
        return bool(sum(touching) <= (1 - ISLAND) * around.sum())
