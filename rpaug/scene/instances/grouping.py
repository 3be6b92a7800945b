"""Handles for the patches of all cameras: patches that look alike in several of them are one thing."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from rpaug.scene.instances import color_clusters
from rpaug.scene.instances import support as standing
from rpaug.scene.instances.blobs import Blob, ring
from rpaug.scene.instances.resting import Resting

MOVING, SUPPORT, AROUND = (
    1,
    2,
    3,
)  # instance ids: what moves, what things stand on, walls and floor; things come after
ALIKE = 9.0  # weighted Lab: patches of two cameras that differ by more are two things
SIZES = 6.0  # times larger, at most, that a thing is in another camera
SIDES = 1.9  # times darker, at most, that a thing's side in the shade is
COLORFUL = 22.0  # chroma from which a patch beside the support is a thing, and not wall or floor


def grouped(
    cameras: Mapping[str, Resting],
    support: Mapping[str, frozenset[int]],
    known: color_clusters.ColorClusters,
) -> dict[str, dict[int, int]]:
    """The instance id of every camera's patches."""
    out: dict[str, dict[int, int]] = {name: {} for name in cameras}
    things: list[tuple[bool, dict[str, int]]] = []
    carried: dict[int, int] = {}
    order = sorted(
        (
            (blob.area / part.cluster.size, name, k)
            for name, part in cameras.items()
            for k, blob in enumerate(part.blobs)
        ),
        key=lambda one: (-one[0], one[1], one[2]),
    )
    for _, name, k in order:
        part = cameras[name]
        if k in part.robot:
            out[name][k] = MOVING
        elif k in support.get(name, frozenset()):
            out[name][k] = SUPPORT
        elif k in part.left:
            # It may be anywhere and of any size in another camera: its tint alone tells it.
            cluster = part.blobs[k].cluster
            like = [one for one in carried if one == cluster or _sides(known[one], known[cluster])]
            carried[cluster] = carried[like[0]] if like else len(things)
            if not like:
                things.append((False, {}))
            out[name][k] = AROUND + 1 + carried[cluster]
        else:
            on = standing.stands_on(part, k, support.get(name, frozenset()))
            if not on and _dull(part.blobs[k]):
                out[name][k] = AROUND
                continue
            fits = [
                (gap, number)
                for number, (stands, members) in enumerate(things)
                if members
                and name not in members
                and stands == on
                and (gap := _gap(cameras, members, part, k, known)) is not None
            ]
            number = min(fits)[1] if fits else len(things)
            if not fits:
                things.append((on, {}))
            things[number][1][name] = k
            out[name][k] = AROUND + 1 + number
    return {name: _joined(part, out[name], known) for name, part in cameras.items()}


def carried(
    cameras: Mapping[str, Resting],
    groups: Mapping[str, Mapping[int, int]],
    known: color_clusters.ColorClusters,
) -> dict[int, int]:
    """The instance id of each tint that was seen to leave its place, and of the tints of its other sides.

    Where several cameras see things change, two must have seen it: what leaves its place in one alone is a shadow, a
    cable or a gap. A tint that the support has too tells of nothing that it was carried.
    """
    lying = {
        part.blobs[k].cluster
        for name, part in cameras.items()
        for k, instance_id in groups[name].items()
        if instance_id == SUPPORT
    }
    found = {}
    seen = Counter(
        one for name, part in cameras.items() for one in {groups[name][k] for k in part.left}
    )
    enough = min(2, sum(bool(part.active.any()) for part in cameras.values()))
    for name, part in cameras.items():
        for k in sorted(part.left):
            left = groups[name][k] > AROUND and seen[groups[name][k]] >= enough
            if left and part.blobs[k].cluster not in lying:
                found[part.blobs[k].cluster] = groups[name][k]
    mobile = frozenset().union(*(part.mobile for part in cameras.values()))
    sides = {
        cluster: instance_id
        for cluster in range(len(known))
        for own, instance_id in found.items()
        if cluster not in mobile | lying and _sides(known[cluster], known[own])
    }
    return sides | found


def _joined(
    part: Resting, instance_ids: dict[int, int], known: color_clusters.ColorClusters
) -> dict[int, int]:
    """The same with a thing's lit and shaded sides under the instance id of the larger."""
    out = dict(instance_ids)
    for k, blob in enumerate(part.blobs):  # largest first
        around = ring(blob.mask)
        for j, other in enumerate(part.blobs[k + 1 :], k + 1):
            if min(out[k], out[j]) <= AROUND or out[k] == out[j]:
                continue
            if (
                _sides(known[blob.cluster], known[other.cluster])
                and (around & other.mask).sum() > 2
            ):
                out[j] = out[k]
    return out


def _sides(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(color_clusters.shaded(one, other, SIDES))


def by_cluster(
    cameras: Mapping[str, Resting], groups: Mapping[str, Mapping[int, int]], count: int
) -> dict[int, int]:
    """The instance id of each tint: that of the largest thing which has it, or one of its own."""
    best: dict[int, tuple[float, int]] = {}
    last = AROUND
    for name, part in cameras.items():
        for k, instance_id in groups[name].items():
            share = part.blobs[k].area / part.cluster.size
            last = max(last, instance_id)
            if instance_id != MOVING and share > best.get(part.blobs[k].cluster, (0.0, 0))[0]:
                best[part.blobs[k].cluster] = (share, instance_id)
    return {
        cluster: best[cluster][1] if cluster in best else last + 1 + cluster
        for cluster in range(count)
    }


def _dull(blob: Blob) -> bool:
    """Is a patch beside the support rather wall or floor than a thing?"""
    large = blob.area > standing.LARGE * blob.mask.size and blob.edge > 0
    return large or bool(np.linalg.norm(blob.color[1:]) < COLORFUL)


def _gap(
    cameras: Mapping[str, Resting],
    members: Mapping[str, int],
    part: Resting,
    k: int,
    known: color_clusters.ColorClusters,
) -> float | None:
    """How unlike a patch is to a thing's patches in other cameras; None if it is none of it."""
    blob, worst = part.blobs[k], 0.0
    for name, other in members.items():
        mate = cameras[name].blobs[other]
        ratio = (blob.area / blob.mask.size) / (mate.area / mate.mask.size)
        off = float(np.linalg.norm(blob.color - mate.color))
        same = mate.cluster == blob.cluster and off < ALIKE
        # A camera that looks from elsewhere sees more of a thing's sides in the shade.
        lit = same or (
            (_sides(known[mate.cluster], known[blob.cluster]) or mate.cluster == blob.cluster)
            and _sides(mate.color, blob.color)
        )
        if not lit or not 1 / SIZES < ratio < SIZES:
            return None
        worst = max(worst, off + abs(float(np.log(ratio))))
    return worst
