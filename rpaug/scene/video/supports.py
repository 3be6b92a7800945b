"""The supports of a video: which instances are the surface that things stand on, piece by piece, and how sure that is.

Depth is swept where images have texture, and filled in elsewhere: a plain floor beside a counter gets the counter's.
What structure from motion measured, the points that a frame saw itself, therefore has the last word.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

from rpaug.scene.instances import color_clusters
from rpaug.scene.video import clear
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.instances import (
    APART,
    BACKGROUND,
    BROAD,
    FIRST,
    FLAT,
    MUTUAL,
    NEAR,
    SAME,
    InstanceMap,
    LevelInstance,
    Support,
    in_plane,
    partners,
)
from rpaug.scene.video.support_look import shown

FEWEST = 12  # sightings of points that tell where an instance lies
NOISE = 3.0  # standard deviations of the points of a support about its plane
EXACT = 0.02  # of the height above it: less noise is not told
Sightings = tuple[
    Int32[np.ndarray, "n"], Float64[np.ndarray, "n"]
]  # instance id, depth by that of the plane


def with_supports(
    things: InstanceMap, looks: Sequence[PosedFrame], level: float, count: int
) -> InstanceMap:
    """The same in a world whose z is up, with the plane at `level` as the support of each of `count` pieces."""
    found, levels = list[Support | None](), list[LevelInstance]()
    for piece in range(count):
        own = [look for look in looks if look.piece == piece]
        if not own:
            found.append(None)
            continue
        ids = [things.rough(look) for look in own]
        seen = _sightings(own, ids, level)
        noise = _noise(seen[1])
        named = _named(things, own, ids, level, _off(seen, noise, FIRST + things.count))
        found.append(_support(own, ids, named, seen, noise))
        levels += _levels(own, ids, named, seen, noise, piece) if named else []
    made = replace(things, supports=tuple(found), level=level, levels=tuple(levels))
    told = list[Support | None]()
    for k in range(count):
        one = _settled(made, [look for look in looks if look.piece == k], k)
        made = replace(made, count=made.count + len(one.clear if one else ()))
        told.append(one)
    return replace(made, supports=tuple(told))


def _settled(found: InstanceMap, looks: Sequence[PosedFrame], piece: int) -> Support | None:
    """A piece's support with what its places look like, what of its color stands on it, and how far frames dispute it;
    ids of what is found there follow those of all instances."""
    support, level = found.supports[piece], found.level
    if support is None or level is None:
        return None

    def masks(by: InstanceMap) -> list[Bool[np.ndarray, "h w"]]:
        named = [by.segmented(look, by.rough(look)) for look in looks]
        return [
            np.isin(one, list(support.instance_ids)) & ~look.moves
            for one, look in zip(named, looks, strict=True)
        ]

    shows = masks(found)
    look = shown(looks, shows, level, found.cell)
    known = replace(support, look=look, clear=clear.find(looks, shows, look, FIRST + found.count))
    others = tuple(known if k == piece else one for k, one in enumerate(found.supports))
    return replace(known, disputed=_disputed(looks, masks(replace(found, supports=others))))


def _named(
    things: InstanceMap,
    looks: Sequence[PosedFrame],
    ids: Sequence[np.ndarray],
    level: float,
    off: Bool[np.ndarray, "k"],
) -> set[int]:
    """The instance that has most of the plane, and those of its color that mostly lie in it and are large in a frame,
    but for those that were measured to lie elsewhere. What has another color lies on it."""
    count, pixels = FIRST + things.count, looks[0].depth.size
    shown = np.stack([np.bincount(one.ravel(), minlength=count) for one in ids])
    there = [one[in_plane(look, level)] for one, look in zip(ids, looks, strict=True)]
    share = np.bincount(np.concatenate(there), minlength=count) / np.maximum(shown.sum(0), 1)
    flat = (share > FLAT) & ~off & (shown.max(0) > BROAD * pixels)
    flat[:FIRST] = False
    if not flat.any():
        return set()
    most = int((flat * share * shown.sum(0)).argmax())
    color = _color(looks, ids, {most})
    apart = {
        one: np.linalg.norm(_color(looks, ids, {one}) - color)
        for one in np.flatnonzero(flat).tolist()
    }
    return {one for one, off in apart.items() if off < APART}


def _sightings(looks: Sequence[PosedFrame], ids: Sequence[np.ndarray], level: float) -> Sightings:
    """Of every point that a frame saw: the instance it lies on there, and its depth as a multiple of the plane's."""
    names, depths = [np.zeros(0, np.int32)], [np.zeros(0)]
    for look, one in zip(looks, ids, strict=True):
        row, column, _ = look.sees(look.sighted)
        inside = row >= 0
        inside[inside] = ~look.moves[row[inside], column[inside]]
        eye = look.cam_to_world[2, 3]
        names.append(one[row[inside], column[inside]])
        depths.append((eye - look.sighted[inside, 2]) / max(eye - level, 1e-9))
    return np.concatenate(names), np.concatenate(depths)


def _noise(depths: Float64[np.ndarray, "n"]) -> float:
    """How far points of the plane lie off it, as a share of the height above it."""
    near = np.abs(depths - 1)
    near = near[near < NEAR]
    spread = NOISE * 1.4826 * float(np.median(near)) if len(near) else NEAR
    return min(max(spread, EXACT), NEAR)


def _off(seen: Sightings, noise: float, count: int) -> Bool[np.ndarray, "k"]:
    """Which instances were measured to lie elsewhere than in the plane."""
    names, depths = seen
    total = np.bincount(names, minlength=count)
    inside = np.bincount(names[np.abs(depths - 1) < noise], minlength=count)
    return (total >= FEWEST) & (inside < MUTUAL * total)


def _support(
    looks: Sequence[PosedFrame],
    ids: Sequence[np.ndarray],
    named: set[int],
    seen: Sightings,
    noise: float,
) -> Support | None:
    if not named:
        return None
    own = np.isin(seen[0], list(named))
    inside = np.abs(seen[1][own] - 1) < noise
    return Support(
        frozenset(named),
        _color(looks, ids, named),
        int(own.sum()),
        float(inside.mean()) if own.any() else 0.0,
    )


def _disputed(looks: Sequence[PosedFrame], masks: Sequence[Bool[np.ndarray, "h w"]]) -> float:
    """The share of what frames show of the support that others, which see the same place, show as something else."""
    other, total = 0, 0
    for i in range(len(looks)):
        for j in partners(looks, i):
            for a, b in ((i, j), (j, i)):
                row, column, z = looks[b].sees(looks[a].points[masks[a]])
                inside = row >= 0
                row, column, z = row[inside], column[inside], z[inside]
                met = np.abs(looks[b].depth[row, column] - z) < SAME * z
                met &= ~looks[b].moves[row, column]
                total += int(met.sum())
                other += int((~masks[b][row[met], column[met]]).sum())
    return other / max(total, 1)


def _levels(
    looks: Sequence[PosedFrame],
    ids: Sequence[np.ndarray],
    named: set[int],
    seen: Sightings,
    noise: float,
    piece: int,
) -> list[LevelInstance]:
    """The other instances that are large in some frame and whose points lie at one height, the largest first."""
    (names, depths), out = seen, list[LevelInstance]()
    pixels = np.bincount(np.concatenate([image.ravel() for image in ids]))
    for one in np.argsort(-pixels, kind="stable").tolist():
        own = depths[names == one]
        large = max((image == one).mean() for image in ids) > BROAD
        if one in (BACKGROUND, *named) or not large or len(own) < FEWEST:
            continue
        middle = float(np.median(own))
        share = float((np.abs(own - middle) < noise * middle).mean())
        if share > FLAT:
            out.append(LevelInstance(piece, one, 1 - middle, len(own), share))
    return out


def _color(
    looks: Sequence[PosedFrame], ids: Sequence[np.ndarray], named: set[int]
) -> Float32[np.ndarray, "3"]:
    """The middle color of instances, in weighted Lab."""
    masks = [np.isin(one, list(named)) for one in ids]
    colors = [
        color_clusters.weighted(look.rgb[mask])
        for look, mask in zip(looks, masks, strict=True)
        if mask.any()
    ]
    return np.asarray(np.median(np.concatenate(colors), 0), np.float32)
