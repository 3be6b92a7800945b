"""What an episode of colour images alone shows: a support, things on it, what lies around, and what moves.

In a camera that stands still the median over time is the backdrop, cut into patches of one tint. Where a frame differs
from it something moves: the robot, or a thing that left its place, told by tint. Patches that look alike in several
cameras are one thing. In a camera that moves there is no backdrop, and a thing is whatever has its tint.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Int32, UInt8

from rpaug.scene import sampling
from rpaug.scene.rgb_only import backdrop, blobs, tints
from rpaug.scene.rgb_only.backdrop import Backdrop
from rpaug.scene.rgb_only.blobs import Blob, ring
from rpaug.types import Episode

MOVING, SUPPORT, AROUND = (
    1,
    2,
    3,
)  # handles: what moves, what things stand on, walls and floor; things come after
LOOSE = 100_000  # handles from here on are of what never rests, by tint
FRAMES = 20  # of each camera, from which motion is told
MOBILE = 0.5  # of the most mobile tint's share of pixels that change: others that reach it move too
CARRIED = 0.6  # share of a tint's pixels that changed, from which nothing of it rests
OFTEN = 0.25  # of all changes that a mobile tint has part in, or it is a thing that was moved
REACH = 0.05  # of the image's width: an uncovered pixel is not farther from the patch it belongs to
LOCAL = 10.0  # weighted Lab: an uncovered pixel looks like the nearest pixel of its patch
TOUCHES = (
    0.08  # share of a resting patch's outline that lies beside what moves, if it is part of that
)
BARELY = 0.02  # the same, where it has the very colour of what moves
SAME = 4.0  # weighted Lab: colours that differ by less are the same
CUT = 0.32  # share of a patch's outline that lies on the image's edge, from which it is no arm
RESTLESS = 0.5  # share of a patch that ever changed, from which it moves wherever it is
ALIKE = 9.0  # weighted Lab: patches of two cameras that differ by more are two things
SIZES = 6.0  # times larger, at most, that a thing is in another camera
WITHIN = 0.8  # share of a thing inside the support's outline, if it stands there
ON = 0.5  # share of a thing's outline that lies on the support, if it stands there
AWAY = 0.5  # share of a thing's place that shows neither it nor what moves, in a frame in which it is not there
LEFT = 0.15  # share of the frames in which a thing that was moved is away
COLOURFUL = 22.0  # chroma from which a patch beside the support is a thing, and not wall or floor
LARGE = 0.05  # share of the image from which it is wall or floor whatever its colour, if the image cuts it off
SPREAD = 0.35  # of the image: how far from its middle the support is looked for


@dataclass(frozen=True)
class Camera:
    """One camera's part: `resting` are the handles of its backdrop, `moved` those that leave their place.

    `mobile` are the tints of what moves, `mine` the handle of each tint in a camera that moves itself.
    """

    backdrop: Backdrop
    resting: Int32[np.ndarray, "h w"]
    tint: Int[np.ndarray, "h w"]
    mobile: frozenset[int]
    moved: Mapping[int, int]
    mine: Mapping[int, int]


@dataclass(frozen=True)
class Things:
    """All cameras' parts, and what each handle does."""

    tints: tints.Tints
    cameras: Mapping[str, Camera]
    support: frozenset[int]
    background: frozenset[int]
    moving: frozenset[int]
    manipulated: frozenset[int]
    handles: frozenset[int]

    @property
    def roles(self) -> dict[str, frozenset[int]]:
        """Handles by role, those that are known."""
        found = {
            "manipulated": self.manipulated,
            "robot": self.moving,
            "table": self.support,
            "background": self.background,
        }
        return {name: handles for name, handles in found.items() if handles}

    def ids(self, name: str, image: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
        """Handles of one image of a camera."""
        camera = self.cameras[name]
        if camera.backdrop.dead:
            return np.zeros(image.shape[:2], np.int32)
        label = tints.labelled(image, self.tints)
        if not camera.backdrop.still:
            table = np.zeros(len(self.tints), np.int32)
            table[list(camera.mine)] = list(camera.mine.values())
            return table[label]
        changed = camera.backdrop.changed(image)
        return _tidied(_settled(camera, label, changed, image), changed)


def find(episode: Episode) -> Things:
    """Look at all cameras and tell what there is."""
    drops = {name: backdrop.find(view, episode.length) for name, view in episode.views.items()}
    alive = {name: drop for name, drop in drops.items() if not drop.dead}
    still = {name: drop for name, drop in alive.items() if drop.still}
    moving = [n for n in alive if n not in still]
    looks = [drop.image for drop in still.values()]
    for name in still:  # what never rests is on no backdrop
        looks += [episode.views[name].rgb(t) for t in sampling.frames(episode.length, 2)]
    for name in moving:
        times = sampling.frames(episode.length, 5)
        looks += [episode.views[name].rgb(t) for t in times]
    known = tints.find(looks) if looks else np.zeros((0, 3), np.float32)
    frames = {name: _Look.at(episode, name, drop, known) for name, drop in still.items()}
    mobile, loose = _mobile(frames.values(), len(known))
    seen = {name: _Seen.of(look, mobile, known) for name, look in frames.items()}
    support = _support(seen)
    groups = _grouped(seen, support)
    parts: dict[str, Camera] = {}
    for name, drop in drops.items():
        if name in seen:
            parts[name] = seen[name].camera(groups[name], loose)
        else:
            mine = _by_tint(seen, groups, len(known)) if name in moving else {}
            empty = np.zeros(drop.image.shape[:2], np.int32)
            parts[name] = Camera(drop, empty, empty.astype(np.int64), frozenset(), {}, mine)
    used = {
        h
        for part in parts.values()
        for h in (*np.unique(part.resting).tolist(), *part.mine.values(), *part.moved.values())
    }
    used |= {MOVING for part in seen.values() if part.active.any()}
    tables = frozenset({SUPPORT} & used)
    moved = frozenset(h for part in parts.values() for h in part.moved.values()) & used
    return Things(
        known,
        parts,
        tables,
        frozenset({AROUND} & used),
        frozenset({MOVING} & used),
        moved,
        frozenset(used) - {0},
    )


@dataclass(frozen=True)
class _Look:
    """Some frames of a still camera: where each differs from the backdrop, and the tints of both."""

    backdrop: Backdrop
    tint: Int[np.ndarray, "h w"]
    frames: list[tuple[Bool[np.ndarray, "h w"], Int[np.ndarray, "h w"]]]
    moving: Mapping[int, Float[np.ndarray, "n 3"]]  # weighted Lab of some changed pixels, by tint

    @classmethod
    def at(cls, episode: Episode, name: str, drop: Backdrop, known: tints.Tints) -> "_Look":
        frames = []
        moving: dict[int, list[np.ndarray]] = {}
        for t in sampling.frames(episode.length, FRAMES):
            image = episode.views[name].rgb(t)
            changed, label = drop.changed(image), tints.labelled(image, known)
            frames.append((changed, label))
            for tint in np.unique(label[changed]).tolist():
                some = image[changed & (label == tint)]
                some = some[:: max(1, len(some) // 200)]
                moving.setdefault(tint, []).append(tints.weighted(some))
        shades = {tint: np.concatenate(parts) for tint, parts in moving.items()}
        return cls(drop, tints.labelled(drop.image, known), frames, shades)


@dataclass(frozen=True)
class _Seen:
    """One still camera before its patches have handles."""

    backdrop: Backdrop
    tint: Int[np.ndarray, "h w"]
    blobs: list[Blob]
    mobile: frozenset[int]
    active: Bool[np.ndarray, "h w"]  # where anything ever changed
    away: Mapping[int, float]  # share of frames in which a patch is not in its place
    shades: Mapping[int, Float[np.ndarray, "3"]]  # weighted Lab of what moves, by tint

    @classmethod
    def of(cls, look: "_Look", mobile: frozenset[int], known: tints.Tints) -> "_Seen":
        found = blobs.find(look.backdrop.image, look.tint, known)
        gone = np.zeros(len(found))
        for changed, label in look.frames:
            other = changed & ~np.isin(label, list(mobile)) & (label != look.tint)
            gone += [other[blob.mask].mean() > AWAY for blob in found]
        active = np.any([changed for changed, _ in look.frames], axis=0)
        shades = {tint: np.median(look.moving[tint], 0) for tint in mobile if tint in look.moving}
        away = {k: float(n) / len(look.frames) for k, n in enumerate(gone)}
        return cls(look.backdrop, look.tint, found, mobile, active, away, shades)

    @cached_property
    def resting_robot(self) -> frozenset[int]:
        """Patches of a mobile tint beside which things change: the robot, where it stands for long."""
        found = set()
        for k, blob in enumerate(self.blobs):
            if blob.tint not in self.mobile:
                continue
            near = self.active[ring(blob.mask) | blob.mask].mean()
            # A wall of the robot's tint is cut off by the image on most sides, an arm on one; and where both have the
            # very same colour nothing tells them apart, so that both are left alone.
            shade = self.shades.get(blob.tint)
            same = shade is not None and float(np.linalg.norm(blob.colour - shade)) < SAME
            arm = (near > TOUCHES and blob.edge < CUT) or (near > BARELY and same)
            if arm or self.active[blob.mask].mean() > RESTLESS:
                found.add(k)
        return frozenset(found)

    @cached_property
    def left(self) -> frozenset[int]:
        """Patches of things that are not in their place in some of the frames."""
        return frozenset(
            k
            for k, blob in enumerate(self.blobs)
            if self.away[k] >= LEFT and blob.edge == 0 and blob.tint not in self.mobile
        )

    def camera(self, handles: Mapping[int, int], loose: frozenset[int]) -> Camera:
        """The camera's part once its patches have handles; `loose` tints get handles of their own."""
        resting = np.zeros(self.tint.shape, np.int32)
        for k, blob in enumerate(self.blobs):
            resting[blob.mask] = handles[k]
        moved = {self.blobs[k].tint: handles[k] for k in self.left if handles[k] > AROUND}
        never = {tint: LOOSE + tint for tint in loose if tint not in moved}
        return Camera(self.backdrop, resting, self.tint, self.mobile, never | moved, {})


def _mobile(looks: Iterable[_Look], count: int) -> tuple[frozenset[int], frozenset[int]]:
    """The tints of what moves, on one side or the other of most changes and seldom where nothing changes; and those of
    what it carries all the time, which are seen almost only where something changes."""
    involved, moving, shown = np.zeros(count), np.zeros(count), np.zeros(count)
    entering = np.zeros(count, bool)  # what a gripper carries is seldom cut off by the image's edge
    total = 0
    for look in looks:
        for changed, label in look.frames:
            total += int(changed.sum())
            shown += np.bincount(label.reshape(-1), minlength=count)
            moving += np.bincount(label[changed], minlength=count)
            entering[[k for k in np.unique(label[changed]) if _enters(label == k, changed)]] = True
            either = [changed & ((label == k) | (look.tint == k)) for k in range(count)]
            involved += [int(one.sum()) for one in either]
    mobility = moving / np.maximum(shown, 1)
    often = (involved >= OFTEN * max(total, 1)) & entering
    if not total or not often.any():
        return frozenset(), frozenset()
    most = mobility[often].max()
    mobile = often & (mobility > MOBILE * most)
    loose = ~mobile & ~entering & (mobility > CARRIED) & (shown > blobs.LEAST * shown.sum())
    return frozenset(np.flatnonzero(mobile).tolist()), frozenset(np.flatnonzero(loose).tolist())


def _enters(mask: Bool[np.ndarray, "h w"], changed: Bool[np.ndarray, "h w"]) -> bool:
    """Does a piece of the mask in which something changed reach the image's edge?"""
    _, pieces = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    rim = np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])
    return bool(np.intersect1d(rim[rim > 0], pieces[mask & changed]).size)


def _settled(
    camera: Camera,
    label: Int[np.ndarray, "h w"],
    changed: Bool[np.ndarray, "h w"],
    image: UInt8[np.ndarray, "h w 3"],
) -> Int32[np.ndarray, "h w"]:
    """Handles of a frame: the backdrop's; where it changed a thing that was moved, what was uncovered, or the robot."""
    out = np.where(changed, MOVING, camera.resting).astype(np.int32)
    open_ = changed & ~np.isin(label, list(camera.mobile))
    for tint, handle in camera.moved.items():
        out[open_ & (label == tint)] = handle
    still_open = open_ & ~np.isin(label, list(camera.moved))
    shown = tints.weighted(image)
    behind = tints.weighted(camera.backdrop.image)
    reach = max(2.0, REACH * label.shape[1])
    for tint in np.unique(label[still_open]):
        source = ~changed & (camera.tint == tint) & (camera.resting != MOVING)
        if not source.any():
            continue
        off, nearest = cv2.distanceTransformWithLabels(
            (~source).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        table = np.zeros(nearest.max() + 1, np.int64)
        table[nearest[source]] = np.flatnonzero(source)
        here = still_open & (label == tint) & (off <= reach)
        place = table[nearest[here]]
        alike = np.linalg.norm(shown[here] - behind.reshape(-1, 3)[place], axis=-1) < LOCAL
        rows = np.flatnonzero(here)[alike]
        out.reshape(-1)[rows] = camera.resting.reshape(-1)[place[alike]]
    return out


def _tidied(
    ids: Int32[np.ndarray, "h w"], changed: Bool[np.ndarray, "h w"]
) -> Int32[np.ndarray, "h w"]:
    """Where something changed, lone pixels go with their neighbours."""
    names, flat = np.unique(ids, return_inverse=True)
    if not changed.any() or len(names) > 255:
        return ids
    smooth = np.zeros(ids.shape, np.float32)
    best = np.full(ids.shape, -1, np.int64)
    flat = flat.reshape(ids.shape)
    for k in range(len(names)):
        votes = cv2.blur((flat == k).astype(np.float32), (3, 3), borderType=cv2.BORDER_REPLICATE)
        votes += np.float32(0.12) * (flat == k)
        best = np.where(votes > smooth, k, best)
        smooth = np.maximum(votes, smooth)
    return np.where(changed, names[best], ids).astype(np.int32)


def _support(seen: Mapping[str, _Seen]) -> dict[str, frozenset[int]]:
    """The patches of each camera that things stand on: of the tint that covers most around the images' middles."""
    score: dict[int, float] = {}
    for part in seen.values():
        h, w = part.tint.shape
        down, right = np.mgrid[0:h, 0:w]
        off = ((down / h - 0.55) ** 2 + (right / w - 0.5) ** 2) / (2 * SPREAD**2)
        weight = np.exp(-off) / (h * w)
        robot = part.resting_robot
        for k, blob in enumerate(part.blobs):
            if k not in robot:
                score[blob.tint] = score.get(blob.tint, 0.0) + float(weight[blob.mask].sum())
    if not score:
        return {}
    best = max(score, key=lambda tint: score[tint])
    out = {}
    for name, part in seen.items():
        robot = part.resting_robot
        same = [k for k, blob in enumerate(part.blobs) if blob.tint == best and k not in robot]
        if same:
            # What the robot's arm cuts off from the largest patch belongs to it.
            first = part.blobs[same[0]]
            alike = [
                k
                for k in same
                if np.linalg.norm(part.blobs[k].colour - first.colour) < ALIKE
                and part.blobs[k].area > 0.02 * first.area
            ]
            out[name] = frozenset(alike)
    return out


def _grouped(
    seen: Mapping[str, _Seen], support: Mapping[str, frozenset[int]]
) -> dict[str, dict[int, int]]:
    """Handles of every camera's patches, patches that look alike in several cameras being one thing."""
    out: dict[str, dict[int, int]] = {name: {} for name in seen}
    things: list[tuple[bool, dict[str, int]]] = []
    carried: dict[int, int] = {}
    order = sorted(
        ((part.blobs[k].area / part.tint.size, name, k) for name, part in seen.items() for k in range(len(part.blobs))),
        key=lambda one: (-one[0], one[1], one[2]),
    )  # fmt: skip
    for _, name, k in order:
        part = seen[name]
        if k in part.resting_robot:
            out[name][k] = MOVING
        elif k in support.get(name, frozenset()):
            out[name][k] = SUPPORT
        elif k in part.left:
            # It may be anywhere and of any size in another camera: its tint alone tells it.
            tint = part.blobs[k].tint
            if tint not in carried:
                carried[tint] = len(things)
                things.append((False, {}))
            out[name][k] = AROUND + 1 + carried[tint]
        else:
            on = _lies_on(part, k, support.get(name, frozenset()))
            if not on and _dull(part.blobs[k]):
                out[name][k] = AROUND
                continue
            fits = [
                (gap, number)
                for number, (stands, members) in enumerate(things)
                if members
                and name not in members
                and stands == on
                and (gap := _gap(seen, members, part, k)) is not None
            ]
            number = min(fits)[1] if fits else len(things)
            if not fits:
                things.append((on, {}))
            things[number][1][name] = k
            out[name][k] = AROUND + 1 + number
    return out


def _hull(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The convex outline of all pixels of a mask, filled."""
    out = np.zeros(mask.shape, np.uint8)
    rows, columns = np.nonzero(mask)
    if len(rows) > 2:
        corners = cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32))
        cv2.fillConvexPoly(out, corners, 1)
    return out > 0


def _dull(blob: Blob) -> bool:
    """Is a patch beside the support rather wall or floor than a thing?"""
    large = blob.area > LARGE * blob.mask.size and blob.edge > 0
    return large or bool(np.linalg.norm(blob.colour[1:]) < COLOURFUL)


def _gap(
    seen: Mapping[str, _Seen], members: Mapping[str, int], part: _Seen, k: int
) -> float | None:
    """How unlike a patch is to a thing's patches in other cameras; None if it is none of it."""
    blob, worst = part.blobs[k], 0.0
    for name, other in members.items():
        known = seen[name].blobs[other]
        ratio = (blob.area / blob.mask.size) / (known.area / known.mask.size)
        off = float(np.linalg.norm(blob.colour - known.colour))
        if known.tint != blob.tint or off > ALIKE or not 1 / SIZES < ratio < SIZES:
            return None
        worst = max(worst, off + abs(float(np.log(ratio))))
    return worst


def _lies_on(part: _Seen, k: int, support: frozenset[int]) -> bool:
    """Does a patch lie within the support's outline, or does most of its own border on it?

    Patches on patches count through those below.
    """
    if part.blobs[k].edge > 0.1:
        return False
    carrier = np.zeros(part.tint.shape, bool)
    for s in support:
        carrier |= part.blobs[s].mask
    if (
        part.blobs[k].edge == 0
        and (_hull(carrier) & part.blobs[k].mask).sum() > WITHIN * part.blobs[k].area
    ):
        return True
    for _ in range(2):
        around = ring(part.blobs[k].mask)
        if carrier[around].mean() >= ON:
            return True
        for j, blob in enumerate(part.blobs):
            if j != k and blob.edge == 0 and carrier[ring(blob.mask)].mean() >= ON:
                carrier = carrier | blob.mask
    return False


def _by_tint(
    seen: Mapping[str, _Seen], groups: Mapping[str, Mapping[int, int]], count: int
) -> dict[int, int]:
    """The handle of each tint: that of the largest thing which has it, or one of its own."""
    best: dict[int, tuple[float, int]] = {}
    last = AROUND
    for name, part in seen.items():
        for k, handle in groups[name].items():
            share = part.blobs[k].area / part.tint.size
            last = max(last, handle)
            if handle != MOVING and share > best.get(part.blobs[k].tint, (0.0, 0))[0]:
                best[part.blobs[k].tint] = (share, handle)
    return {tint: best[tint][1] if tint in best else last + 1 + tint for tint in range(count)}
