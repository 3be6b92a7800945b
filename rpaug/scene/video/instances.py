"""Instances of a video's still world: segments of its frames, joined where they lie on each other.

What a segment is in one image is told by color alone, so that its outline is the image's own; which segments of
several images are one thing is told by where they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64

from rpaug.core import geometry
from rpaug.core.pixels import bounds, filled, grown, nearest
from rpaug.scene.instances import color_clusters, grouping, outlines
from rpaug.scene.video import clear
from rpaug.scene.video.clear import ClearThing
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.linked import joined
from rpaug.scene.video.support_look import SupportLook

BACKGROUND = 1  # instance id of all that is no thing
FIRST = 2
CELL = 0.015  # of the median depth: of the cells that tell where a thing is
FEWEST = 12  # cells of a thing
MOST = 150  # things
SEEN = 2  # looks that show a thing, at least
PARTNERS = 2  # looks that one is compared with: the next ones, and those most like it
MUTUAL = 0.5  # of each of two segments lies on the other, if they are one thing
SAME = 0.15  # of depth: farther apart is something else
FEW = 10  # pixels: what is seen of a segment
SHARE = 0.3  # of a segment's points must be the thing's
SLIVER = 0.003  # of an image: smaller segments that are no thing's go to their neighbours
RIM = 1  # pixels around a thing that are part support, part thing
FLAT = 0.65  # share of what lies in the support's plane of its pixels: a chair before it has 0.59
NEAR = 0.12  # of depth: so near to the plane counts as in it
BROAD = 0.02  # of all pixels: what is smaller lies on the support and is no part of it
APART = 9.0  # weighted Lab: what lies in that plane and differs by more is something else
REST = 0.3  # of a thing's size: so far from it are pixels of its color its own
FOREIGN = 0.3  # of a segment has the support's color, or it is none of it
PLAIN = 0.8  # of an instance has its middle color, if it has one color
ALIKE = 0.5  # of a segment has the support's color, if it is a part of it
OWN = 0.08  # of a thing's size: so deep its segments take the blur around it
FUSED = 0.4  # of the cells of each of two groups are the other's too, if they are one thing
ALIKE_THERE = (
    4.5  # weighted Lab: what is so near to the support's color at its place is the support
)
COVER = np.ones((3, 3), np.uint8)  # pixels: of what covers the support less is noise
BETWEEN = np.ones((5, 5), np.uint8)  # pixels of a segment's middle show nothing else so near
SOME = 3  # pixels of a group in a cell that count
LAYERS = 4  # groups in a cell that are compared
REACH = 2**20  # cells


@dataclass(frozen=True, eq=False)
class Support:
    """What things stand on in one piece of a video: its instances, and their color in weighted Lab.

    Of the `sightings` of its points, which structure from motion measured, the share `measured` lies in its plane.
    Where one frame shows it another one shows something else, `disputed` of its pixels. `look` is that of its places;
    `clear` stand on it and have its color.
    """

    instance_ids: frozenset[int]
    color: Float32[np.ndarray, "3"]
    sightings: int = 0
    measured: float = 0.0
    disputed: float = 0.0
    look: SupportLook | None = None
    clear: tuple[ClearThing, ...] = ()


@dataclass(frozen=True)
class LevelInstance:
    """An instance of a piece whose measured points lie at one height; of its `sightings` the share `measured` does.

    `height` is above the support's plane, as a share of the camera's height above that; negative below.
    """

    piece: int
    instance_id: int
    height: float
    sightings: int
    measured: float


@dataclass(frozen=True, eq=False)
class InstanceMap:
    """Handles by cell of the world (`codes` in rising order, and the instance id of each), and the supports: one of
    each piece of the video, None where it has none, all at one height. `levels` are the other level surfaces.
    """

    cell: float
    codes: Int64[np.ndarray, "n"]
    instance_ids: Int32[np.ndarray, "n"]
    count: int
    supports: tuple[Support | None, ...] = ()
    level: float | None = None
    levels: tuple[LevelInstance, ...] = ()

    @cached_property
    def support(self) -> frozenset[int]:
        """Instance ids of all supports."""
        return frozenset().union(*(one.instance_ids for one in self.supports if one))

    def support_of(self, look: PosedFrame) -> Support | None:
        """The support of a frame's piece."""
        return self.supports[look.piece] if look.piece < len(self.supports) else None

    def scaled(self, factor: float) -> "InstanceMap":
        """The same in a world that is `factor` times as large."""
        level = None if self.level is None else factor * self.level
        supports = tuple(
            replace(one, look=one.look and one.look.scaled(factor)) if one else None
            for one in self.supports
        )
        return replace(self, cell=factor * self.cell, level=level, supports=supports)

    @property
    def every(self) -> list[int]:
        """All instance ids."""
        return [BACKGROUND, *range(FIRST, FIRST + self.count)]

    def at(self, points: Float32[np.ndarray, "n 3"]) -> Int32[np.ndarray, "n"]:
        """Handles of points in the world."""
        found = self._known(points)
        return np.where(found > 0, found, BACKGROUND).astype(np.int32)

    def of(
        self,
        look: PosedFrame,
        named: Int32[np.ndarray, "h w"],
        beside: Sequence[tuple[PosedFrame, Int32[np.ndarray, "h w"]]] = (),
    ) -> Int32[np.ndarray, "h w"]:
        """Handles of one frame's pixels, from what its segments are `named` and those of the frames `beside` it."""
        told = self.segmented(look, self._told(look, named, beside))
        joined = self._joined(look, self._ended(look, told))
        return self._grown(self._ended_large(look, joined)).astype(np.int32)

    def segmented(
        self, look: PosedFrame, named: Int32[np.ndarray, "h w"]
    ) -> Int32[np.ndarray, "h w"]:
        """The same by segment, by what colors say of the support and of what stands on it."""
        told = self._as_elsewhere(look, self._cleared(look, named))
        support = self.support_of(look)
        if support is None or support.look is None:
            return told
        held = np.isin(told, list(support.instance_ids))
        return clear.marked(look, told, held, support.look, support.clear)

    def _told(
        self,
        look: PosedFrame,
        named: Int32[np.ndarray, "h w"],
        beside: Sequence[tuple[PosedFrame, Int32[np.ndarray, "h w"]]],
    ) -> Int32[np.ndarray, "h w"]:
        """The same with segments that no cell names named as most of the pixels that the frames `beside` it show there:
        what the image's edge cuts off has its depth off, and so lies in no known cell."""
        patch = look.segments
        votes = np.zeros((int(patch.max()) + 1, FIRST + self.count), np.int64)
        for other, ids in beside:
            row, column, z = look.sees(other.points)
            inside = row >= 0
            row, column, z, seen = row[inside], column[inside], z[inside], ids[inside]
            near = np.abs(look.depth[row, column] - z) < SAME * z
            np.add.at(votes, (patch[row[near], column[near]], seen[near]), 1)
        best, total = votes.argmax(1), votes.sum(1)
        sure = votes[np.arange(len(votes)), best] > MUTUAL * total
        sure &= (best >= FIRST) & (total > MUTUAL * np.bincount(patch.ravel()))
        return np.where((named == BACKGROUND) & sure[patch], best[patch], named).astype(np.int32)

    def covered(
        self,
        look: PosedFrame,
        ids: Int32[np.ndarray, "h w"],
        moving: Bool[np.ndarray, "h w"],
        about: Bool[np.ndarray, "h w"],
    ) -> Bool[np.ndarray, "h w"]:
        """What moves by itself, with what beside it is called support and unlike what other frames show there: a hand
        that rests, or whose segment took in some of the table, covers that. `about` is what moves in frames near by."""
        support = self.support_of(look)
        if support is None or support.look is None or not about.any():
            return moving
        held = np.isin(ids, list(support.instance_ids)) & ~moving
        unlike = held & (support.look.off(look, held) > APART)
        unlike = cv2.morphologyEx(unlike.astype(np.uint8), cv2.MORPH_OPEN, COVER) > 0
        _, parts = cv2.connectedComponents(grown(unlike | about, RIM).astype(np.uint8))
        return moving | (unlike & np.isin(parts, np.unique(parts[about])))

    def _as_elsewhere(
        self, look: PosedFrame, named: Int32[np.ndarray, "h w"]
    ) -> Int32[np.ndarray, "h w"]:
        """The same with segments that look, place by place, as other frames show the support there.

        A part that one frame shows apart, or whose depth is off because the image's edge cuts it off, is no instance of
        its own.
        """
        support = self.support_of(look)
        if support is None or support.look is None:
            return named
        patch, held = look.segments, np.isin(named, list(support.instance_ids))
        off = support.look.off(look, held)
        share = np.bincount(patch.ravel(), ((off < APART) & ~held).ravel()) / np.bincount(
            patch.ravel()
        )
        # Of a segment that took in something else, an arm, what looks the same.
        same = cv2.morphologyEx(
            (~held & (off < ALIKE_THERE)).astype(np.uint8), cv2.MORPH_OPEN, BETWEEN
        )
        _, parts, stats, _ = cv2.connectedComponentsWithStats(same)
        large = (stats[parts, cv2.CC_STAT_AREA] > SLIVER * patch.size) & (same > 0)
        own = ((share > FLAT)[patch] | large) & ~held
        return np.where(own, min(support.instance_ids), named)

    def _known(self, points: Float64[np.ndarray, "n 3"]) -> Int32[np.ndarray, "n"]:
        """Handles of the cells that points are in, 0 of cells without one."""
        if not len(self.codes):
            return np.zeros(len(points), np.int32)
        asked = _packed(np.floor(points / self.cell).astype(np.int64))
        place = np.minimum(np.searchsorted(self.codes, asked), len(self.codes) - 1)
        return np.where(self.codes[place] == asked, self.instance_ids[place], 0).astype(np.int32)

    def _cleared(
        self, look: PosedFrame, named: Int32[np.ndarray, "h w"]
    ) -> Int32[np.ndarray, "h w"]:
        """The same without segments of the support, or of another instance of one color, that have little of its color,
        be it that of this frame: what was put there, is carried past or stands before it fills its cells too."""
        patch, shown = look.segments, color_clusters.weighted(look.rgb)
        count, out = np.bincount(patch.ravel()), named.copy()
        held, support = np.isin(named, list(self.support)), self.support_of(look)
        parts = [(held, [support.color])] if support and held.any() else []
        parts += [
            (named == one, [])
            for one in sorted({*np.unique(named).tolist()} - {BACKGROUND, *self.support})
        ]
        for mask, known in parts:
            about = np.isin(patch, np.unique(patch[mask]))
            there, own = shown[about], np.zeros(held.shape, bool)
            for color in (*known, np.median(shown[mask], 0)):  # exposure may have changed
                own[about] |= np.linalg.norm(there - color, axis=-1) < APART
                own[about] |= color_clusters.shaded(there, color)
            if known or own[mask].mean() > PLAIN:
                foreign = np.bincount(patch.ravel(), own.ravel()) < FOREIGN * count
                out[mask & foreign[patch]] = BACKGROUND
        return out

    def rough(self, look: PosedFrame) -> np.ndarray:
        """What a frame's segments are by the cells that they fill."""
        patch = look.segments
        known = self._known(look.points.reshape(-1, 3)).reshape(patch.shape)
        number = int(patch.max()) + 1
        votes = np.zeros((number, FIRST + self.count), np.int64)
        np.add.at(votes, (patch.ravel(), known.ravel()), 1)
        best = votes[:, FIRST:].argmax(1) + FIRST if self.count else np.full(number, BACKGROUND)
        enough = votes[np.arange(number), best] >= SHARE * votes.sum(1)
        if support := self.support_of(look):
            lies = ~enough & self._lies(look, support, number)
            best[lies], enough = min(support.instance_ids), enough | lies
        sliver = ~enough & (votes.sum(1) < SLIVER * patch.size)
        return _spread(np.where(enough, best, BACKGROUND)[patch], sliver[patch])

    def _lies(self, look: PosedFrame, support: Support, number: int) -> Bool[np.ndarray, "k"]:
        """Which of a frame's segments lie in the support's plane and have its color: a part of it that a frame shows
        otherwise than the rest do (blurred, or cut off) is no named instance."""
        assert self.level is not None
        patch = look.segments.ravel()
        flat = np.bincount(patch, in_plane(look, self.level).ravel(), minlength=number)
        near = np.linalg.norm(color_clusters.weighted(look.rgb) - support.color, axis=-1) < APART
        alike = np.bincount(patch, near.ravel(), minlength=number)
        count = np.bincount(patch, minlength=number)
        return (flat > FLAT * count) & (alike > ALIKE * count)

    def _small(self, named: np.ndarray) -> np.ndarray:
        """Which instance ids are of small things, not of what they stand on or before."""
        out = np.bincount(named.ravel(), minlength=FIRST + self.count) < BROAD * named.size
        out[[BACKGROUND, *self.support]] = False
        return out

    def _ended(self, look: PosedFrame, named: np.ndarray) -> np.ndarray:
        """Small things cut anew where their own colors end: segments of blurred images take what is around."""
        first = grouping.AROUND + 1
        known = np.arange(FIRST + self.count, dtype=np.int32) + first
        known[[BACKGROUND]] = grouping.AROUND
        known[list(self.support)] = grouping.SUPPORT
        only = frozenset(known[self._small(named)].tolist())
        cut = outlines.cut(look.rgb, known[named], only, OWN)
        # What was given back takes the nearest name of what things stand on or before.
        given = (cut != known[named]) & (cut < first)
        rest = _spread(named, known[named] >= first)
        return np.where(given, rest, np.where(cut >= first, cut - first, named))

    def _joined(self, look: PosedFrame, named: np.ndarray) -> np.ndarray:
        """Instances with the pixels around them that have their color there, more or less lit, and not that of what
        they are named as: segments of a shaded surface end anywhere, and what is left of it would keep its color."""
        shown, out = color_clusters.weighted(look.rgb), named.copy()
        color = cache(lambda one: np.median(shown[named == one], 0))
        small = self._small(named)
        for instance_id in sorted({*np.unique(named).tolist()} - {BACKGROUND}):
            everywhere = named == instance_id
            reach = max(2, round(REST * float(np.sqrt(everywhere.sum()))))
            window = bounds(everywhere, reach)
            mine, names, here = everywhere[window], named[window], shown[window]
            near = grown(mine, reach) & ~mine
            own = color(instance_id)
            if not small[instance_id]:
                own = here.reshape(-1, 3)[nearest(_inside(mine))[0]]
            rows = np.flatnonzero(near)
            color_of, names_of = here.reshape(-1, 3)[rows], names.reshape(-1)[rows]
            like = np.broadcast_to(own, here.shape).reshape(-1, 3)[rows]
            off = np.linalg.norm(color_of - like, axis=-1)
            taken = (off < APART) | color_clusters.shaded(color_of, like)
            for other in np.unique(names_of[taken]).tolist():
                theirs = np.flatnonzero(taken & (names_of == other))
                apart = np.linalg.norm(color_of[theirs] - color(other), axis=-1)
                foreign = apart > np.maximum(off[theirs], APART)
                foreign &= ~color_clusters.shaded(color_of[theirs], color(other))
                near_own = np.linalg.norm(color(other) - color(instance_id)) < 2 * APART
                taken[theirs] = foreign & (not near_own)
            loose = np.zeros(mine.shape, bool)
            loose.reshape(-1)[rows[taken]] = True
            if loose.any():
                _, parts = cv2.connectedComponents((loose | mine).astype(np.uint8))
                out[window][loose & np.isin(parts, np.unique(parts[mine]))] = instance_id
        return out

    def _ended_large(self, look: PosedFrame, named: np.ndarray) -> np.ndarray:
        """Large instances with what lies between them and the middle of what is around, a blurred outline or a sliver,
        where it is more like them."""
        shown, out, small = color_clusters.weighted(look.rgb), named.copy(), self._small(named)
        middle = cv2.erode(named.astype(np.float32), BETWEEN) == cv2.dilate(
            named.astype(np.float32), BETWEEN
        )
        for instance_id in np.flatnonzero(np.bincount(named[middle & ~small[named]])).tolist():
            if instance_id in (BACKGROUND, *self.support):
                continue
            window = bounds(named == instance_id, len(BETWEEN))
            mine, inner, here = named[window] == instance_id, middle[window], shown[window]
            free = grown(mine, len(BETWEEN) - 1) & ~mine & ~inner & ~small[named[window]]
            if not free.any() or not (inner & ~mine).any():
                continue
            colors = [here.reshape(-1, 3)[nearest(inner & one)[0][free]] for one in (mine, ~mine)]
            own, theirs = (np.linalg.norm(here[free] - color, axis=-1) for color in colors)
            rows, columns = np.nonzero(free)
            taken = own < theirs
            out[window][rows[taken], columns[taken]] = instance_id
        return out

    def _grown(self, named: np.ndarray) -> np.ndarray:
        """Small things with the pixels around them that their blurred outlines take of the support."""
        around = np.isin(named, [BACKGROUND, *self.support])
        thing = self._small(named)[named]
        near = grown(thing, RIM)
        return np.where(near & around, _spread(named, ~thing), named) if thing.any() else named


def _inside(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """What is marked without its rim, whose colors are mixed; all of it where nothing is left."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return inner if inner.any() else mask


def _spread(named: np.ndarray, open_: np.ndarray) -> np.ndarray:
    """Names with those of open pixels taken from the nearest other one: what lies along outlines belongs to a side."""
    if not open_.any() or open_.all():
        return named
    return filled(named, ~open_, window=3)


def find(looks: Sequence[PosedFrame]) -> InstanceMap:
    """The things that several looks show: segments of theirs that lie on each other, and the cells they fill."""
    size = float(np.median([np.median(look.depth) for look in looks]))
    cell = CELL * size
    first = np.cumsum([0, *(int(look.segments.max()) + 1 for look in looks)])
    group = joined(int(first[-1]), _links(looks, first))
    shown = _shown_in(group, first)
    keys = [np.floor(look.points / cell).astype(np.int64).reshape(-1, 3) for look in looks]
    codes, of = np.unique(_packed(np.concatenate(keys)), return_inverse=True)
    named = np.concatenate(
        [group[look.segments.ravel() + start] for look, start in zip(looks, first, strict=False)]
    )
    hidden = np.concatenate([look.moves.ravel() for look in looks])
    named = np.where(~hidden & (shown[named] >= SEEN), named, -1)
    named = np.append(_fused(of, named, len(group)), -1)[named]
    mine = _most(of, named, len(codes))
    number, sizes = np.unique(mine, return_counts=True)
    order = [h for _, h in sorted(zip(-sizes, number, strict=True)) if h >= 0]
    kept = [h for h in order if sizes[np.searchsorted(number, h)] >= FEWEST][:MOST]
    held = np.isin(mine, kept)
    number_of = np.zeros(len(group) + 1, np.int32)
    number_of[np.array(kept, np.int64)] = FIRST + np.arange(len(kept), dtype=np.int32)
    return InstanceMap(cell, codes[held], number_of[mine[held]], len(kept))


def _links(looks: Sequence[PosedFrame], first: np.ndarray) -> np.ndarray:
    """Pairs of segments, one of each of two looks, each of which mostly lies on the other."""
    pairs = []
    for i, look in enumerate(looks):
        for j in partners(looks, i):
            there, back = _overlap(look, looks[j]), _overlap(looks[j], look).T
            rows, columns = np.nonzero((there > MUTUAL) & (back > MUTUAL))
            pairs.append(np.stack([rows + first[i], columns + first[j]], 1))
    return np.concatenate(pairs) if pairs else np.zeros((0, 2), np.int64)


def partners(looks: Sequence[PosedFrame], i: int) -> list[int]:
    """The next looks, and the later ones that see most alike: those that look from nearly the same place."""
    own = looks[i].cam_to_world
    reach = float(np.median(looks[i].depth))
    apart = {}
    for j in range(i + 1, len(looks)):
        other = looks[j].cam_to_world
        turned = np.arccos(np.clip(own[:3, 2] @ other[:3, 2], -1, 1))
        apart[j] = float(np.linalg.norm(own[:3, 3] - other[:3, 3])) / reach + float(turned)
    return sorted({*list(apart)[:PARTNERS], *sorted(apart, key=apart.__getitem__)[:PARTNERS]})


def _overlap(one: PosedFrame, other: PosedFrame) -> np.ndarray:
    """Which share of each segment that the other look sees lies on which of its segments."""
    row, column, z = other.sees(one.points)
    inside = row >= 0
    found = other.depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    inside &= np.abs(found - z) < SAME * z
    a, b = one.segments[inside], other.segments[row[inside], column[inside]]
    shape = int(one.segments.max()) + 1, int(other.segments.max()) + 1
    count = np.bincount(a * shape[1] + b, minlength=shape[0] * shape[1]).reshape(shape)
    return count / np.maximum(count.sum(1, keepdims=True), FEW)


def _shown_in(group: np.ndarray, first: np.ndarray) -> np.ndarray:
    """In how many looks each group has a segment."""
    shown = np.zeros(len(group), np.int64)
    for start, stop in pairwise(first.tolist()):
        shown[np.unique(group[start:stop])] += 1
    return shown


def _fused(cell: np.ndarray, name: np.ndarray, count: int) -> np.ndarray:
    """A number for each of `count` groups, the same for those that fill the same cells: one thing, seen in two parts
    of the video that no pair of looks joins."""
    given = name >= 0
    codes, votes = np.unique(cell[given].astype(np.int64) * count + name[given], return_counts=True)
    where, group = np.divmod(codes[votes >= SOME], count)
    size = np.bincount(group, minlength=count)
    both = [np.stack([group[:-k], group[k:]], 1)[where[:-k] == where[k:]] for k in range(1, LAYERS)]
    pairs, shared = np.unique(np.concatenate(both), axis=0, return_counts=True)
    return joined(count, pairs[shared > FUSED * size[pairs].max(1)])


def _most(cell: np.ndarray, name: np.ndarray, count: int) -> np.ndarray:
    """The most frequent name of each cell."""
    low = name - name.min()
    pairs, votes = np.unique(cell.astype(np.int64) * (low.max() + 1) + low, return_counts=True)
    order = np.lexsort((pairs, -votes))
    owner = pairs[order] // (low.max() + 1)
    where = np.unique(owner, return_index=True)[1]
    out = np.full(count, -1)
    out[owner[where]] = pairs[order][where] % (low.max() + 1) + name.min()
    return out


def _packed(cells: np.ndarray) -> np.ndarray:
    """Three whole numbers in one, which sorts faster; what is farther than REACH cells is brought there."""
    near = np.clip(cells, -REACH, REACH - 1) + REACH
    return (near[:, 0] * 2 * REACH + near[:, 1]) * 2 * REACH + near[:, 2]


def in_plane(look: PosedFrame, level: float) -> Bool[np.ndarray, "h w"]:
    """Which pixels lie in the plane z = `level`, as far as a frame's depth tells."""
    met = plane_depth(look.K, look.cam_to_world, look.depth.shape, level)
    return (met > 0) & (np.abs(met / look.depth - 1) < NEAR)


def plane_depth(
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    shape: tuple[int, ...],
    level: float,
) -> Float64[np.ndarray, "h w"]:
    """Depth at which each pixel's ray meets the plane z = `level`; 0 where it never does."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    x, y = geometry.slopes(columns, rows, K)
    down = cam_to_world[2, 0] * x + cam_to_world[2, 1] * y + cam_to_world[2, 2]
    with np.errstate(divide="ignore"):
        met = (level - cam_to_world[2, 3]) / down
    return np.where(np.isfinite(met) & (met > 0), met, 0.0)
