"""What an episode of color images alone shows: a support, things on it, what lies around, and what moves.

In a camera that stands still the median over time is the backdrop, cut into patches of one tint. Where a frame differs
from it something moves: the robot, or a thing that left its place, told by tint. Patches that look alike in several
cameras are one thing. In a camera that moves there is no backdrop, and a thing is whatever has its tint.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Int32, UInt8

from rpaug.core import pixels, sampling
from rpaug.core.types import Episode
from rpaug.scene.instances import (
    backdrop,
    color_clusters,
    gripped,
    grouping,
    lasting,
    named,
    outlines,
    rgb_settling,
    support,
    watched,
)
from rpaug.scene.instances.backdrop import Backdrop
from rpaug.scene.instances.gripped import Gripped
from rpaug.scene.instances.grouping import AROUND, MOVING, SUPPORT
from rpaug.scene.instances.outlined import Outlined
from rpaug.scene.instances.resting import Resting
from rpaug.scene.instances.rgb_settling import NAMED, CameraInstances
from rpaug.scene.instances.watched import Watched

LOOSE = 100_000  # instance ids from here on are of what never rests, by tint
LOOKED = 8  # frames in which patches of color are held against outlines
WALLS = 3  # tints that walls and a floor have at most
SHOWN = 0.05  # share of an image from which its surroundings are judged
UNDER = 0.5  # share of a patch under outlines from which it is the things that they are of


@dataclass(frozen=True)
class CameraInstanceMap:
    """All cameras' parts, and what each instance id does; `outlined` is what models found by words, on top of that."""

    clusters: color_clusters.ColorClusters
    cameras: Mapping[str, CameraInstances]
    support: frozenset[int]
    background: frozenset[int]
    moving: frozenset[int]
    manipulated: frozenset[int]
    instance_ids: frozenset[int]
    gripped: Gripped = field(default_factory=Gripped)
    outlined: Outlined | None = None

    @property
    def roles(self) -> dict[str, frozenset[int]]:
        """Handles by role, those that are known."""
        found = {
            "manipulated": self.manipulated,
            "robot": self.moving,
            "table": self.support,
            "background": self.background,
        }
        return {name: instance_ids for name, instance_ids in found.items() if instance_ids}

    @property
    def plainness(self) -> float:
        """The share of the surroundings that as many tints cover as walls and a floor have, in the camera that shows
        least of it. The rest is things: a tint then tells neither surroundings nor support from what stands there."""
        shares = [1.0]
        for part in self.cameras.values():
            around = part.cluster[np.isin(part.resting, list(self.background))]
            if len(around) > SHOWN * part.resting.size:
                counts = np.sort(np.bincount(around))[::-1]
                shares.append(float(counts[:WALLS].sum() / len(around)))
        return min(shares)

    def ids(self, name: str, t: int, image: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
        """Handles of a camera's image at time t."""
        found = self._by_color(name, image)
        return found if self.outlined is None else self.outlined.over(found, name, t)

    def _by_color(self, name: str, image: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
        part = self.cameras[name]
        if part.backdrop.dead:
            return np.zeros(image.shape[:2], np.int32)
        label = color_clusters.labelled(image, self.clusters)
        if part.backdrop.still:
            return rgb_settling.instance_ids(part, label, image)
        table = np.zeros(len(self.clusters), np.int32)
        table[list(part.mine)] = list(part.mine.values())
        return table[label]


def find(episode: Episode, outlined: Outlined | None = None) -> CameraInstanceMap:
    """Look at all cameras and tell what there is; what models outlined is so whatever its colors are."""
    drops = {name: backdrop.find(view, episode.length) for name, view in episode.views.items()}
    known = _clusters(episode, drops)
    still = {
        name: watched.watch(episode.views[name], episode.length, drop, known)
        for name, drop in drops.items()
        if drop.still and not drop.dead
    }
    seen, loose = _resting(still, len(known))
    on = support.find(seen, known)
    groups = grouping.grouped(seen, on, known)
    carried = grouping.carried(seen, groups, known)
    parts: dict[str, CameraInstances] = {}
    for name, drop in drops.items():
        if name in seen:
            parts[name] = _part(seen[name], groups[name], carried, loose)
        else:
            mine = {} if drop.dead else grouping.by_cluster(seen, groups, len(known))
            empty = np.zeros(drop.image.shape[:2], np.int32)
            parts[name] = CameraInstances(
                drop, empty, empty.astype(np.int64), frozenset(), {}, mine
            )
    if not carried and not loose:
        parts = _untinted(episode, still, seen, parts, known)
    found = _given(known, parts, any(part.active.any() for part in seen.values()))
    if outlined is not None:
        found = _overlaid(episode, found, outlined)
    return _with_gripped(episode, found)


def _overlaid(episode: Episode, found: CameraInstanceMap, outlined: Outlined) -> CameraInstanceMap:
    """The same with what models outlined on top. A patch of color that moved and lies in an outline is that thing's."""
    parts, instance_ids = {}, found.instance_ids
    under: dict[
        int, dict[int, int]
    ] = {}  # pixels of each patch that moved, by the outline over them
    for name, part in found.cameras.items():
        view = episode.views[name]
        there = outlined.at(name, 0)
        there[part.backdrop.changed(view.rgb(0))] = 0
        parts[name] = replace(part, resting=_under(part.resting, there))
        for t in sampling.frames(episode.length, LOOKED):
            above, below = outlined.at(name, t), found.ids(name, t, view.rgb(t))
            for patch in found.manipulated:
                over, counts = np.unique(above[below == patch], return_counts=True)
                for one, count in zip(over.tolist(), counts.tolist(), strict=True):
                    seen = under.setdefault(patch, {})
                    seen[one] = seen.get(one, 0) + count
    moved = set[int]()
    for patch in found.manipulated:
        seen = under.get(patch, {})
        most = max(seen, key=lambda one: seen[one], default=0)
        moved.add(most or patch)
    return replace(
        found,
        cameras=parts,
        instance_ids=instance_ids | outlined.instance_ids,
        manipulated=frozenset(moved),
        outlined=outlined,
    )


def _under(
    resting: Int32[np.ndarray, "h w"], there: Int32[np.ndarray, "h w"]
) -> Int32[np.ndarray, "h w"]:
    """The instance ids with what models outlined on top. The rim that is left over of a patch of color under an outline
    is a mixture of it and what is around, and goes with that."""
    out, outlined = Outlined.on_top(resting, there), there > 0
    for patch in set(np.unique(resting[outlined]).tolist()) - {SUPPORT, AROUND, MOVING}:
        held = resting == patch
        if outlined[held].mean() >= UNDER and (around := ~held & ~outlined).any():
            rim = held & ~outlined
            out[rim] = resting.reshape(-1)[pixels.nearest(around)[0][rim]]
    return out


def _with_gripped(episode: Episode, found: CameraInstanceMap) -> CameraInstanceMap:
    """The same with what the gripper closes on, where its opening tells when. What moved and is something else is not
    what it manipulates."""
    opening = episode.robot.gripper_open
    if opening is None:
        return found
    start = gripped.closes(opening)
    still = {
        n: one for n, one in found.cameras.items() if one.backdrop.still and not one.backdrop.dead
    }
    if start is None or not still:
        return found

    def shown(t: int) -> dict[str, Int32[np.ndarray, "h w"]]:
        return {name: found.ids(name, t, episode.views[name].rgb(t)) for name in still}

    resting = {name: one.resting for name, one in still.items()}
    held = gripped.find(resting, shown, start, episode.length - 1)
    if held.thing is not None and held.thing not in found.manipulated:
        return replace(found, gripped=held, manipulated=frozenset([held.thing]))
    if found.manipulated:  # it is what was seen to move, and no part of support or surroundings
        held = replace(held, within=frozenset())
    return replace(found, gripped=held)


def _untinted(
    episode: Episode,
    still: Mapping[str, Watched],
    seen: Mapping[str, Resting],
    parts: Mapping[str, CameraInstances],
    known: color_clusters.ColorClusters,
) -> dict[str, CameraInstances]:
    """The parts with what the robot acted on, where no tint of its own was seen to leave its place."""
    mobile = frozenset().union(*(part.mobile for part in seen.values()))
    came = lasting.find(still, seen, mobile)
    wanted = frozenset() if came else named.asked(episode.descriptions, known)
    small = named.find(still, seen, mobile, wanted) if wanted else {}
    return {
        name: replace(part, came=came.get(name), small=small.get(name))
        for name, part in parts.items()
    }


def _clusters(episode: Episode, drops: Mapping[str, Backdrop]) -> color_clusters.ColorClusters:
    """The tints of all images that show anything."""
    looks = []
    for name, drop in drops.items():
        if drop.dead:
            continue
        # What never rests is on no backdrop, and a camera that moves has none.
        times = sampling.frames(episode.length, 2 if drop.still else 5)
        looks += [drop.image] if drop.still else []
        looks += [episode.views[name].rgb(t) for t in times]
    return color_clusters.find(looks) if looks else np.zeros((0, 3), np.float32)


def _resting(still: Mapping[str, Watched], count: int) -> tuple[dict[str, Resting], frozenset[int]]:
    """The patches of all still cameras, the robot taken away where it stood for long; and the tints that never rest."""
    mobile, loose = watched.mobile(still.values(), count)
    found = {}
    for name, one in still.items():
        robot = Resting.of(one, mobile).robot_mask
        found[name] = Resting.of(one.without(robot, mobile) if robot.any() else one, mobile)
    return found, loose


def _part(
    seen: Resting, instance_ids: Mapping[int, int], carried: Mapping[int, int], loose: Iterable[int]
) -> CameraInstances:
    """A camera's part once its patches have instance ids; `loose` tints get instance ids of their own."""
    resting = np.zeros(seen.cluster.shape, np.int32)
    for k, blob in enumerate(seen.blobs):
        resting[blob.mask] = instance_ids[k]
    never = {cluster: LOOSE + cluster for cluster in loose}
    resting = outlines.cut(seen.backdrop.image, resting)
    return CameraInstances(
        seen.backdrop, resting, seen.cluster, seen.mobile, never | dict(carried), {}
    )


def _given(
    known: color_clusters.ColorClusters, parts: Mapping[str, CameraInstances], active: bool
) -> CameraInstanceMap:
    used = {
        h
        for part in parts.values()
        for h in (*np.unique(part.resting).tolist(), *part.mine.values(), *part.moved.values())
    }
    used |= {MOVING} if active else set()
    used |= {NAMED for part in parts.values() if part.small is not None}
    moved = frozenset(h for part in parts.values() for h in part.moved.values()) & used
    moved |= used & {NAMED}
    return CameraInstanceMap(
        known,
        parts,
        frozenset({SUPPORT} & used),
        frozenset({AROUND} & used),
        frozenset({MOVING} & used),
        moved,
        frozenset(used) - {0},
    )
