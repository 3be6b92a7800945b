"""What one image says about each factor, as a few numbers, measured against a camera of the recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

from rpaug.diagnosis import parts, things
from rpaug.diagnosis.align import Aligned, align
from rpaug.diagnosis.evaluation import CameraShot
from rpaug.diagnosis.messages import Factor
from rpaug.diagnosis.reference import First, ReferenceCamera

# Each factor's numbers, and the difference in each that means nothing: what re-measuring the same scene varies by.
NUMBERS: Mapping[Factor, tuple[tuple[str, float], ...]] = {
    "object position": (("right", 0.01), ("down", 0.01)),
    "object color": (("lightness", 4.0), ("red", 3.0), ("yellow", 3.0)),
    "object texture": (("hue", 1.5), ("edges", 0.02)),
    "object size": (("logarithm", 0.06),),
    "lighting": (("red", 0.04), ("green", 0.04), ("blue", 0.04), ("unevenness", 0.03)),
    "table": (("lightness", 3.0), ("red", 2.0), ("yellow", 2.0), ("contrast", 0.03), ("edges", 0.03)),
    "background": (("lightness", 3.0), ("red", 2.0), ("yellow", 2.0), ("contrast", 0.03), ("edges", 0.03)),
    "distractor": (("area", 0.02), ("likeness to the target", 0.1)),
    "camera": (("right", 0.012), ("down", 0.012), ("scale", 0.05), ("turn", 0.035)),
}  # fmt: skip
MINE, STATIC = "manipulated", ("table", "background", "robot")
UNLIKE = 30.0  # Lab units, lightness halved: a thing whose color is as far from the target's is not like it at all
DARKEST = 0.06  # of the usual light: what is darker cannot be told from noise
Seen = dict[Factor, Float64[np.ndarray, "k"]]


@dataclass(frozen=True)
class SightCamera:
    """A camera of the recordings, prepared: where things are looked for, and rosters of what stands there."""

    plate: ReferenceCamera
    within: Bool[np.ndarray, "h w"]
    table: Bool[np.ndarray, "h w"]
    background: Bool[np.ndarray, "h w"]
    palette: Float32[np.ndarray, "n 3"]  # colors of all but the thing to act on
    rosters: tuple[things.Roster, ...] = ()
    given: tuple[
        things.Roster, ...
    ] = ()  # the same by the recordings' masks, without the one to act on
    colors: tuple[Float32[np.ndarray, "3"], ...] = ()  # of the thing to act on, in Lab


def stage(plate: ReferenceCamera) -> SightCamera:
    """What measuring needs to know of a camera."""
    near = cv2.dilate(plate.usually("robot", 0.2).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    edge = np.ones((5, 5), np.uint8)
    background = cv2.erode(plate.usually("background").astype(np.uint8), edge) > 0
    far = cv2.dilate(plate.usually("background").astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    within = ~near & ~far
    table = within & plate.usually("table")
    others = np.concatenate([_others(one, within) for one in plate.firsts])
    made = SightCamera(plate, within, table, background & ~near, things.palette(others))
    return replace(
        made,
        rosters=tuple(roster(one, made) for one in plate.firsts),
        given=tuple(_given(one, made) for one in plate.firsts),
        colors=tuple(_mine(one) for one in plate.firsts if one.mask(MINE).any()),
    )


def _known(first: First) -> frozenset[int]:
    """Ids of all that has a role."""
    return frozenset().union(*(first.roles.get(role, frozenset()) for role in (MINE, *STATIC)))


def _others(first: First, within: Bool[np.ndarray, "h w"]) -> Float32[np.ndarray, "n 3"]:
    """The colors of what else stood in a recording's first frame, its outlines left out."""
    mask = within & ~np.isin(first.ids, [0, *_known(first)])
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return _lab(first.image.astype(np.float32))[inner]


def _mine(first: First) -> Float32[np.ndarray, "3"]:
    """The color of the thing to act on in a recording's first frame."""
    lab = _lab(first.image.astype(np.float32))
    return np.asarray(np.median(lab[first.mask(MINE)], 0), np.float32)


def _given(first: First, made: SightCamera) -> things.Roster:
    """What else stood in a recording's first frame, by its mask."""
    lab = _lab(first.image.astype(np.float32))
    known = _known(first)
    found = things.by_ids(first.ids, made.within, lab)
    return things.Roster([one for i, one in found.items() if i not in known], None)


def roster(first: First, made: SightCamera) -> things.Roster:
    """What stood in a recording's first frame: found by color as in any image, the target told by its mask."""
    lab = _lab(first.image.astype(np.float32))
    found, _ = things.by_color(lab, made.within, made.palette)
    target = first.mask("manipulated")
    shared = [int((one.mask & target).sum()) for one in found]
    if not shared or max(shared) < parts.LEAST:
        return things.Roster(found, None)
    return things.Roster(found, int(np.argmax(shared)))


def measured(
    shot: CameraShot,
    roles: Mapping[str, frozenset[int]],
    made: SightCamera,
    without: int | None = None,
) -> Seen:
    """The numbers of one image; what cannot be told is absent. `without` leaves one recording's roster out."""
    image = shot.image()
    ids = shot.ids() if shot.ids is not None and roles else None
    aligned = align(image, made.plate)
    if aligned is None:
        return {}
    if ids is not None and ids.shape != made.within.shape:
        h, w = made.within.shape
        ids = cv2.resize(ids.astype(np.float32), (w, h), interpolation=cv2.INTER_NEAREST).astype(
            int
        )
    out: Seen = {"camera": _camera(aligned)}
    gain, uneven = _light(aligned, made.plate)
    out["lighting"] = np.array([*np.log(gain), uneven])
    lab = _lab(np.minimum(aligned.image / gain, 400))
    flat = ids is None and things.table(lab, made.within & aligned.valid)
    for factor, where, role in (
        ("table", made.table if ids is not None else flat & made.table, "table"),
        ("background", made.background, "background"),
    ):
        region = where & aligned.valid
        if ids is not None and roles.get(role):
            region = region & np.isin(aligned.warp(ids), list(roles[role]))
        if region.sum() >= 100:
            out[factor] = np.array([*np.median(lab[region], 0), *_pattern(lab, region)])  # type: ignore[index]
    target, strange = _things(lab, aligned, ids, roles, made, without)
    area = np.sqrt(sum(one.mask.sum() for one in strange) / lab.shape[0] ** 2)
    out["distractor"] = np.array([area, _likeness(strange, made)])
    if target is not None:
        out["object position"] = target.place.astype(np.float64)
        out["object color"] = target.color.astype(np.float64)
        out["object size"] = np.array([target.size])
        out["object texture"] = _print(lab, target.mask)
    return out


def _things(
    lab: Float32[np.ndarray, "h w 3"],
    aligned: Aligned,
    ids: Int32[np.ndarray, "h w"] | None,
    roles: Mapping[str, frozenset[int]],
    made: SightCamera,
    without: int | None,
) -> tuple[things.TableInstance | None, list[things.TableInstance]]:
    """The thing to act on, if it is seen, and what no recording has."""
    within = made.within & aligned.valid
    if ids is None:
        rosters = [one for k, one in enumerate(made.rosters) if k != without]
        target, strange = things.recognised(*things.by_color(lab, within, made.palette), rosters)
        return target, list(strange)
    given = things.by_ids(aligned.warp(ids), within, lab)
    mine = roles.get(MINE, frozenset())
    static = frozenset().union(*(roles.get(role, frozenset()) for role in STATIC))
    target = max((one for i, one in given.items() if i in mine), key=lambda t: t.size, default=None)
    rest = [one for i, one in given.items() if i not in mine | static]
    usual = [one for k, one in enumerate(made.given) if k != without]
    return target, list(things.unknown(rest, usual))


def _likeness(strange: Sequence[things.TableInstance], made: SightCamera) -> float:
    """How much the color of something that no recording has is like the target's in them, 0 to 1."""
    apart = [
        np.linalg.norm((one.color - usual) * things.DARKENED)
        for one in strange
        for usual in made.colors
    ]
    return max(0.0, 1 - float(min(apart, default=UNLIKE)) / UNLIKE)


def _camera(aligned: Aligned) -> Float64[np.ndarray, "4"]:
    return np.array([*aligned.shift, np.log(aligned.scale), aligned.turn])


def _light(aligned: Aligned, plate: ReferenceCamera) -> tuple[Float32[np.ndarray, "3"], float]:
    """By how much the robot is brighter than usual, per channel, and how unevenly: the robot keeps its own colors."""
    region = cv2.erode(plate.robot.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    region &= aligned.valid
    if region.sum() < 20:
        region = plate.robot & aligned.valid
    usual, now = plate.mean[region], aligned.image[region]
    gain = np.maximum(now.mean(0) / np.maximum(usual.mean(0), 1), DARKEST)
    ratio = np.log((now.mean(1) + 6) / ((usual * gain).mean(1) + 6))
    spread = float(np.percentile(ratio, 80) - np.percentile(ratio, 20))
    return gain.astype(np.float32), spread


def _pattern(
    lab: Float32[np.ndarray, "h w 3"], region: Bool[np.ndarray, "h w"]
) -> Float64[np.ndarray, "2"]:
    """How much a surface varies, and how sharply from pixel to pixel, over its own lightness."""
    level = max(20.0, float(np.median(lab[..., 0][region])))
    spread = np.sqrt(sum(np.var(lab[..., c][region]) for c in range(3)))
    right = region[:, 1:] & region[:, :-1]
    down = region[1:] & region[:-1]
    steps = [
        *np.linalg.norm(np.diff(lab, axis=1)[right], axis=1),
        *np.linalg.norm(np.diff(lab, axis=0)[down], axis=1),
    ]
    return np.array([spread / level, (np.mean(steps) if steps else 0.0) / level])


def _print(
    lab: Float32[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> Float64[np.ndarray, "2"]:
    """How much the hue varies on a thing, and the middling step from pixel to pixel: its faces differ in lightness
    alone, and their edges are few."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    inner = inner if inner.sum() >= 9 else mask
    level = max(20.0, float(np.median(lab[..., 0][inner])))
    hues = parts.hue(lab)[inner]
    varied = float(np.linalg.norm(hues - np.median(hues, 0), axis=1).mean())
    right, down = inner[:, 1:] & inner[:, :-1], inner[1:] & inner[:-1]
    steps = np.concatenate(
        [
            np.linalg.norm(np.diff(lab, axis=1)[right], axis=1),
            np.linalg.norm(np.diff(lab, axis=0)[down], axis=1),
        ]
    )
    return np.array([varied, (np.median(steps) if len(steps) else 0.0) / level])


def _lab(image: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
    return cv2.cvtColor(np.clip(image / 255, 0, 1.5).astype(np.float32), cv2.COLOR_RGB2Lab)
