"""Instances that words were found by: one mask in some frames becomes one id in all frames and all cameras.

In each camera the masks of one phrase are linked over time into tracks. Between two masks a thing that rests is where
both of them show it and the image shows the same; one that moves is carried by optical flow, a few frames far. What is
seen too seldom to be a thing is none. Phrases whose tracks lie on each other name one thing, and a phrase that
means one thing in every camera that shows it means the same one in all of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Int32, UInt8

from rpaug.core.types import CameraView, Episode
from rpaug.providers.finder import AskedImage, Finder, overlap, plain
from rpaug.scene.instances.image_edges import onto_edges

RULE = "outlined 7"  # changes with what is made of the same masks, and is part of their name in the cache
FIRST_ID = 200_000  # instance ids from here on are of things that words were found by
LINKED = 0.3  # intersection over union of one thing's masks in two frames that follow each other
NEAR = 0.5  # of a mask's width, its middle moves at most between two of them if they do not overlap
SAME = 0.6  # median overlap of two phrases' tracks that are one thing's
OFTEN = (
    0.34  # share of the frames asked, from its first to its last, in which a thing is seen at least
)
LASTS = 2  # frames at least in which a thing is seen; of few frames asked that share of them
MOSTLY = 0.5  # share of a track's masks that go on the one before, if it does not leap all the time
SURELY = 0.6  # of the surest track's score: weaker ones are no second thing of a phrase
ALIKE = 2.5  # times as many pixels that a thing has in the next frame at most
UNFITTING = 1e-6  # how well what came from far goes on: worse than all else
RESTS = (
    0.8  # share of the smaller of two masks in the larger one, between which a thing has not moved
)
STAYS = 0.5  # share of a mask that looks the same in a frame before all others, or after: it was there as well
CARRIED = 8  # frames that optical flow carries a mask through
UNLIKE = 12.0  # grey levels that a pixel and its neighbours differ by on average: it shows something else
FEWEST = 4  # pixels of a mask

Mask = Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Outlined:
    """`ids[camera][t]` are the instance ids of what was found, 0 elsewhere; `names` the ids of each phrase, none for
    one that was looked for in vain; `notes` say in sentences how much was seen of each."""

    ids: Mapping[str, UInt8[np.ndarray, "t h w"]]
    names: Mapping[str, frozenset[int]]
    notes: tuple[str, ...] = ()

    @property
    def instance_ids(self) -> frozenset[int]:
        """All that was found."""
        return frozenset().union(*self.names.values())

    @property
    def moved(self) -> frozenset[int]:
        """What does not lie in some camera where it lay at first."""
        out = set[int]()
        for stack in self.ids.values():
            for number in np.unique(stack[stack > 0]).tolist():
                seen = [mask for mask in stack == number if mask.any()]
                if _held(seen[0], seen[-1]) < RESTS:
                    out.add(FIRST_ID - 1 + number)
        return frozenset(out)

    def at(self, camera: str, t: int) -> Int32[np.ndarray, "h w"]:
        """The instance ids of one frame."""
        found = self.ids[camera][t].astype(np.int32)
        return np.where(found > 0, found + (FIRST_ID - 1), 0).astype(np.int32)

    def over(self, ids: Int32[np.ndarray, "h w"], camera: str, t: int) -> Int32[np.ndarray, "h w"]:
        """The instance ids of one frame, with those of what was found in their place."""
        return self.on_top(ids, self.at(camera, t))

    def shown(self, view: CameraView, camera: str) -> CameraView:
        """A view whose ids have those of what was found in their place."""
        read = view.ids
        assert read is not None
        return replace(view, ids=lambda t: self.over(read(t), camera, t), inferred=True)

    @staticmethod
    def on_top(
        ids: Int32[np.ndarray, "h w"], found: Int32[np.ndarray, "h w"]
    ) -> Int32[np.ndarray, "h w"]:
        """One map of ids where it has any, else another."""
        return np.where(found > 0, found, ids).astype(np.int32)


@dataclass(eq=False)
class _MaskTrack:
    """One thing of one camera under one phrase: its masks by frame, and their scores."""

    words: list[str]
    masks: dict[int, Mask] = field(default_factory=dict)
    scores: list[float] = field(default_factory=list)

    @property
    def score(self) -> float:
        return float(np.median(self.scores))

    def add(self, t: int, mask: Mask, score: float) -> None:
        self.masks[t] = mask
        self.scores.append(score)


def find(
    episode: Episode, phrases: Sequence[str], finder: Finder, progress: Callable[[float], None]
) -> Outlined:
    """Ask for all phrases in all cameras. `progress` is told the share that is done."""
    wanted = [one for one in dict.fromkeys(map(plain, phrases)) if finder.knows(episode.key, one)]
    tracks: dict[str, list[_MaskTrack]] = {}
    for number, (name, view) in enumerate(episode.views.items()):
        asked = finder.frames(episode.key, name, episode.length)
        found = [list[_MaskTrack]() for _ in wanted]
        for done, t in enumerate(asked):
            shown = AskedImage(episode.key, name, t, view.rgb(t))
            for k, words in enumerate(wanted):
                masks = [(one.mask, one.score) for one in finder(shown, words)]
                _link(found[k], words, t, [(m, s) for m, s in masks if m is not None])
            progress((number + (done + 1) / len(asked)) / len(episode.views))
        kept = [track for some in found for track in _lasting(some, asked)]
        tracks[name] = _merged(kept)
    things = _across(tracks, wanted)
    ids = {
        name: _drawn(
            view,
            episode.length,
            [(k, thing[name]) for k, thing in enumerate(things) if name in thing],
        )
        for name, view in episode.views.items()
    }
    return _told(wanted, things, ids, list(episode.views))


def _link(
    tracks: list[_MaskTrack], words: str, t: int, found: Sequence[tuple[Mask, float]]
) -> None:
    """Add one frame's masks to the tracks that they go on, the best fitting first; others begin new ones.

    Where a frame shows one thing and one is known it is that, however far it came: it was carried, or seen seldom.
    """
    found = [(mask, score) for mask, score in found if mask.sum() >= FEWEST]
    known = [one for one in tracks if len(one.masks) >= LASTS] or tracks
    last = {id(track): track.masks[max(track.masks)] for track in tracks}
    sole = len(found) == len(known) == 1
    fits = sorted(
        (
            (_fit(mask, last[id(track)], far=sole and track is known[0]), k, n)
            for n, (mask, _) in enumerate(found)
            for k, track in enumerate(tracks)
        ),
        key=lambda one: -one[0],
    )
    taken, used = set[int](), set[int]()
    for fit, k, n in fits:
        if fit > 0 and k not in taken and n not in used:
            tracks[k].add(t, *found[n])
            taken.add(k)
            used.add(n)
    for n, (mask, score) in enumerate(found):
        if n not in used:
            tracks.append(_MaskTrack([words]))
            tracks[-1].add(t, mask, score)


def _fit(mask: Mask, before: Mask, *, far: bool = False) -> float:
    """How well a mask goes on an earlier one: their overlap, or how near a thing of that size came; 0 for not, unless
    it may come from `far`."""
    shared = overlap(mask, before)
    if shared >= LINKED:
        return 1.0 + shared
    size, old = float(mask.sum()), float(before.sum())
    least = UNFITTING if far else 0.0
    if not 1 / ALIKE < size / old < ALIKE:
        return least
    off = np.argwhere(mask).mean(0) - np.argwhere(before).mean(0)
    return max(least, 1.0 - float(np.hypot(*off)) / (NEAR * 2 * np.sqrt(max(size, old))))


def _steady(track: _MaskTrack, asked: Sequence[int]) -> None:
    """Take out what is another thing for a moment, where most masks go on the one before: a mask that goes on neither
    neighbour although these agree, or that stands beside frames that show nothing."""
    times, order = sorted(track.masks), {t: k for k, t in enumerate(asked)}
    links = [_fit(track.masks[b], track.masks[a]) > 0 for a, b in pairwise(times)]
    if not links or np.mean(links) < MOSTLY:
        return
    masks = dict(track.masks)
    for k, t in enumerate(times):
        beside = [one for one in (k - 1, k + 1) if 0 <= one < len(times)]
        if any(links[min(k, one)] for one in beside):
            continue
        alone = any(abs(order[times[one]] - order[t]) > 1 for one in beside)
        agree = len(beside) == 2 and _fit(masks[times[k + 1]], masks[times[k - 1]]) > 0
        if alone or agree:
            del track.masks[t]


def _lasting(tracks: Sequence[_MaskTrack], asked: Sequence[int]) -> list[_MaskTrack]:
    """The tracks that are things: seen often enough, and sure enough beside the surest."""
    for track in tracks:
        _steady(track, asked)
    often = [
        one
        for one in tracks
        if len(one.masks) >= min(LASTS, int(np.ceil(OFTEN * len(asked))))
        and len(one.masks) >= OFTEN * sum(min(one.masks) <= t <= max(one.masks) for t in asked)
    ]
    best = max((one.score for one in often), default=0.0)
    return _joined([one for one in often if one.score >= SURELY * best])


def _joined(tracks: Sequence[_MaskTrack]) -> list[_MaskTrack]:
    """The tracks of one phrase, those that follow each other as one: it went out of sight between them."""
    out = list[_MaskTrack]()
    for track in sorted(tracks, key=lambda one: min(one.masks)):
        earlier = [one for one in out if max(one.masks) < min(track.masks)]
        others = [one for one in tracks if one is not track and _together(one, track)]
        if len(earlier) == 1 and not others:
            earlier[0].masks.update(track.masks)
            earlier[0].scores += track.scores
        else:
            out.append(track)
    return out


def _together(one: _MaskTrack, other: _MaskTrack) -> bool:
    """Are both there at some time?"""
    return min(one.masks) <= max(other.masks) and min(other.masks) <= max(one.masks)


def _merged(tracks: Sequence[_MaskTrack]) -> list[_MaskTrack]:
    """Each thing once: tracks that lie on each other are one, known by all of their phrases."""
    out = list[_MaskTrack]()
    for track in sorted(tracks, key=lambda one: (-len(one.masks), one.words)):
        for other in out:
            shared = track.masks.keys() & other.masks.keys()
            alike = [overlap(track.masks[t], other.masks[t]) for t in shared]
            if alike and float(np.median(alike)) >= SAME:
                other.words += [one for one in track.words if one not in other.words]
                break
        else:
            out.append(track)
    return out


def _across(
    tracks: Mapping[str, Sequence[_MaskTrack]], wanted: Sequence[str]
) -> list[dict[str, _MaskTrack]]:
    """Things by camera: what a phrase means where it means one thing in every camera that shows it. What it means
    several of in some camera is as many things for each camera alone."""
    things = list[dict[str, _MaskTrack]]()
    held = dict[int, dict[str, _MaskTrack]]()  # by track
    for words in wanted:
        seen = {name: [one for one in some if words in one.words] for name, some in tracks.items()}
        seen = {name: some for name, some in seen.items() if some}
        single = all(len(some) == 1 for some in seen.values())
        groups = [{n: s[0] for n, s in seen.items()}] if single else [
            {name: one} for name, some in seen.items() for one in some
        ]  # fmt: skip
        for group in filter(None, groups):
            known = {id(held[id(one)]): held[id(one)] for one in group.values() if id(one) in held}
            thing = next(iter(known.values()), None)
            if len(known) > 1:
                continue  # other phrases tell these apart
            if thing is None:
                thing = {}
                things.append(thing)
            for name, one in group.items():
                if name not in thing and id(one) not in held:
                    thing[name] = one
                    held[id(one)] = thing
    return things


def _drawn(
    view: CameraView, length: int, tracks: Sequence[tuple[int, _MaskTrack]]
) -> UInt8[np.ndarray, "t h w"]:
    """Numbers (1 and up) of the things that each pixel of a camera shows; of two, that which is smaller there. Outlines
    are moved onto the image's edges."""
    shape = view.camera.height, view.camera.width
    out = np.zeros((length, *shape), np.uint8)
    if not tracks:
        return out
    sizes = np.full((length, *shape), np.iinfo(np.int32).max, np.int32)
    for number, track in tracks:
        for t, mask in _filled(view, length, track.masks).items():
            mask = onto_edges(view.rgb(t), mask)
            size = int(mask.sum())
            over = mask & (size < sizes[t])
            out[t][over], sizes[t][over] = number + 1, size
    return out


def _filled(view: CameraView, length: int, masks: Mapping[int, Mask]) -> dict[int, Mask]:
    """The masks, and those of the frames between them and at both ends as far as they can be told."""
    out, known = dict(masks), sorted(masks)
    for near, times in ((known[0], range(known[0])), (known[-1], range(known[-1] + 1, length))):
        for t in times if view.camera.fixed else ():
            shown = _resting(view, t, masks, near, near)
            if shown.sum() >= STAYS * masks[near].sum():
                out[t] = shown
    for before, after in pairwise(known):
        if after - before < 2:
            continue
        rests = view.camera.fixed and _held(masks[before], masks[after]) >= RESTS
        for t in range(before + 1, after):
            near, far = (before, after) if t - before <= after - t else (after, before)
            if rests:
                out[t] = _resting(view, t, masks, near, far)
            elif abs(t - near) <= CARRIED:
                out[t] = _carried(view, masks[near], near, t)
    return {t: mask for t, mask in out.items() if mask.sum() >= FEWEST}


def _held(one: Mask, other: Mask) -> float:
    """The share of the smaller mask that lies in the larger one: what covers a part of a thing does not move it."""
    return float((one & other).sum()) / max(1, min(int(one.sum()), int(other.sum())))


def _resting(view: CameraView, t: int, masks: Mapping[int, Mask], near: int, far: int) -> Mask:
    """Where a thing that rests shows in a frame between two others: its pixels that look as in one of them."""
    image = view.rgb(t).astype(np.int16)
    out = np.zeros_like(masks[near])
    for other in (near, far):
        off = np.abs(image - view.rgb(other)).max(-1).astype(np.float32)
        out |= masks[other] & (cv2.blur(off, (3, 3)) < UNLIKE)  # neighbours do not share noise
    return out


def _carried(view: CameraView, mask: Mask, near: int, t: int) -> Mask:
    """A mask of frame `near` where optical flow (dense inverse search, Kroeger et al. 2016) takes it in frame t."""
    now, then = (cv2.cvtColor(view.rgb(k), cv2.COLOR_RGB2GRAY) for k in (t, near))
    if min(now.shape) < 16:
        return mask
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    way = search.calc(now, then, np.zeros((*now.shape, 2), np.float32))
    rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]].astype(np.float32)
    moved = cv2.remap(
        mask.astype(np.float32),
        columns + way[..., 0],
        rows + way[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
    )
    there = cv2.remap(
        view.rgb(near),
        columns + way[..., 0],
        rows + way[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    off = np.abs(there.astype(np.int16) - view.rgb(t)).max(-1).astype(np.float32)
    return (moved > 0.5) & (cv2.blur(off, (3, 3)) < 2 * UNLIKE)  # else something hides it


def _told(
    wanted: Sequence[str],
    things: Sequence[Mapping[str, _MaskTrack]],
    ids: Mapping[str, UInt8[np.ndarray, "t h w"]],
    cameras: Sequence[str],
) -> Outlined:
    names: dict[str, frozenset[int]] = {}
    notes = list[str]()
    for words in wanted:
        found = [
            (k, thing)
            for k, thing in enumerate(things)
            if any(words in one.words for one in thing.values())
        ]
        names[words] = frozenset(FIRST_ID + k for k, _ in found)
        if not found:
            notes.append(f"{words!r}: the models found none")
        for k, thing in found:
            score = min(one.score for one in thing.values())
            frames = ", ".join(
                f"{int((ids[name] == k + 1).any((1, 2)).sum())} frames of {name}"
                for name in cameras
                if name in thing
            )
            notes.append(
                f"{words!r}: instance {FIRST_ID + k} by models, {frames}, sure {score:.2f}"
            )
    return Outlined(ids, names, tuple(notes))
