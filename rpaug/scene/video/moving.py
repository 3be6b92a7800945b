"""What moves by itself in a video: segments whose flow no place in a still world explains.

A still point seen in two frames lies on its epipolar line, between where the nearest and the farthest would be
(Hartley and Zisserman 2004, chapter 9). Hands and what they carry do not. Flow is dense inverse search (Kroeger
et al. 2016). Boxes of hands that an annotator drew (Ego4D's FHO) say more where there are any.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float16, Float32, Float64, Int32, UInt16

from rpaug.core import geometry
from rpaug.core.jit import kernel
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.instances import joined

Box = tuple[float, float, float, float]  # left, top, right, bottom; pixels of a look
STEP = 2  # frames over which what moves is followed, 1 where the camera is quick
APART = (-2, -1, 1, 2)  # steps to the frames that one is compared with
QUICK = 0.08  # image widths in STEP frames, the median flow
SAMPLED = 5  # frames that tell how quick the camera is
FADING = 0.95  # a step: of what moved and rests
CONTRADICTED = 0.5  # of an image does not move as its poses say: they are wrong
ASIDE, DRIFT = 1.5, 0.05  # pixels, and share of the flow, that a still point may lie off its line
RETURNS = 1.5  # pixels: flow forth and back
KNOWN = 0.2  # of a segment's pixels have flow that returns
MOVING = 0.5  # of these lie off
LEAST = 0.002  # of an image: what is smaller is noise
LASTS = 4  # frames, a step apart: what moves for a shorter time is noise
BOXED = 0.6  # of a segment inside of a hand's box
FILLS = 0.9  # of a box that one segment fills: then it is what is behind


RULE = repr(
    (STEP, APART, QUICK, FADING, CONTRADICTED, ASIDE, DRIFT, RETURNS, KNOWN, MOVING, LEAST, LASTS)
)


@dataclass(frozen=True)
class Moving:
    """What moves by itself in each frame, and the frames that hardly move as their poses say."""

    masks: tuple[Bool[np.ndarray, "h w"], ...]
    contradicted: tuple[int, ...]


def find(
    look: Callable[[int], PosedFrame],
    count: int,
    spans: Sequence[tuple[float, float]],
    progress: Callable[[float], None] = lambda share: None,
) -> Moving:
    """Look at `count` frames. `spans` are the nearest and farthest that anything in each may be.

    What moved stays told apart while it rests between two motions; what moves for a moment alone is no hand.
    """
    engine = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    step = _step(look, count, engine)
    grey: dict[int, np.ndarray] = {}
    kept: dict[tuple[int, int], np.ndarray] = {}
    flows: dict[tuple[int, int], np.ndarray] = {}
    found, numbers = [], []
    for k in range(count):
        near = [k + n * step for n in APART if 0 <= k + n * step < count]
        off = []
        for j in near:
            for pair in ((k, j), (j, k)):
                for t in pair:
                    if t not in grey:
                        grey[t] = cv2.cvtColor(look(t).rgb, cv2.COLOR_RGB2GRAY)
                if pair not in flows:
                    flows[pair] = _flow(engine, grey[pair[0]], grey[pair[1]])
            off.append(_off(look(k), look(j), flows[k, j], flows[j, k], spans[k]))
            if abs(j - k) == step:
                kept[k, j] = flows[k, j].astype(np.float16)
        number = look(k).segments
        numbers.append(number.astype(np.uint16))
        found.append(_by_segment(number, off))
        grey.pop(k + step * min(APART), None)
        flows = {pair: flow for pair, flow in flows.items() if max(pair) > k}
        progress((k + 1) / count)
    wrong = tuple(k for k, mask in enumerate(found) if mask.mean() > CONTRADICTED)
    sure = [np.zeros_like(mask) if k in wrong else mask for k, mask in enumerate(found)]
    return Moving(tuple(lasting(list(_resting(numbers, sure, kept, step)), kept, step)), wrong)


def _step(look: Callable[[int], PosedFrame], count: int, engine: Any) -> int:
    """Frames between those that are compared: fewer where the camera is quick, whose flow would be lost."""
    lengths = []
    for k in sorted({int(t) for t in np.linspace(0, count - 1 - STEP, SAMPLED)} & {*range(count)}):
        a, b = (cv2.cvtColor(look(t).rgb, cv2.COLOR_RGB2GRAY) for t in (k, k + STEP))
        flow = _flow(engine, a, b)
        lengths.append(float(np.median(np.linalg.norm(flow, axis=-1))) / a.shape[1])
    return STEP if lengths and float(np.median(lengths)) < QUICK else 1


def _flow(engine: Any, one: np.ndarray, other: np.ndarray) -> Float32[np.ndarray, "h w 2"]:
    return np.asarray(engine.calc(one, other, None))


def _resting(
    numbers: Sequence[UInt16[np.ndarray, "h w"]],
    found: Sequence[Bool[np.ndarray, "h w"]],
    flows: Mapping[tuple[int, int], np.ndarray],
    step: int,
) -> Iterator[Bool[np.ndarray, "h w"]]:
    """What moves where neighbouring frames say so too, carried along by the flow while it rests."""

    def carried(values: Sequence[np.ndarray], k: int, j: int) -> np.ndarray:
        if (k, j) not in flows:
            return np.zeros(found[k].shape, np.float32)
        return _carried(values[j], flows[k, j], cv2.INTER_LINEAR)

    count = len(found)
    backed = [
        mask & (np.maximum(carried(found, k, k - step), carried(found, k, k + step)) > 0.5)
        for k, mask in enumerate(found)
    ]
    passes = []
    for way, order in ((-step, range(count)), (step, range(count - 1, -1, -1))):
        score = [mask.astype(np.float32) for mask in backed]
        for k in order:
            score[k] = np.maximum(score[k], FADING * carried(score, k, k + way))
        passes.append(score)
    for k, number in enumerate(numbers):
        mean = np.bincount(number.ravel(), (0.5 * (passes[0][k] + passes[1][k])).ravel())
        yield cleaned((mean > MOVING * np.bincount(number.ravel()))[number])


def lasting(
    found: Sequence[Bool[np.ndarray, "h w"]],
    flows: Mapping[tuple[int, int], Float16[np.ndarray, "h w 2"]],
    step: int,
) -> list[Bool[np.ndarray, "h w"]]:
    """What is found in LASTS frames or more, followed from one to the next by the flow between them."""
    parts, first = [], [0]
    for mask in found:
        count, labels = cv2.connectedComponents(mask.astype(np.uint8))
        parts.append(np.where(mask, labels + first[-1] - 1, -1))
        first.append(first[-1] + count - 1)
    edges = [np.zeros((0, 2), np.int64)]
    for (k, j), flow in flows.items():
        if j == k + step:
            there = _carried(parts[j] + 1, flow, cv2.INTER_NEAREST).astype(np.int64) - 1
            both = (parts[k] >= 0) & (there >= 0)
            edges.append(np.unique(np.stack([parts[k][both], there[both]], 1), axis=0))
    group = joined(first[-1], np.concatenate(edges))
    frame = np.repeat(np.arange(len(found)), np.diff(first))
    which = np.unique(np.stack([group, frame], 1), axis=0)[:, 0]
    enough = np.bincount(which, minlength=first[-1])[group] >= LASTS
    enough = np.append(enough, False).astype(bool)  # the last for what is in no part
    return [enough[part] for part in parts]


def _carried(values: np.ndarray, flow: np.ndarray, how: int) -> Float32[np.ndarray, "h w"]:
    """What each pixel of one frame is in the frame that its flow leads to; 0 outside of that."""
    height, width = values.shape
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    x, y = columns + flow[..., 0], rows + flow[..., 1]
    return np.asarray(cv2.remap(np.asarray(values, np.float32), x, y, how))


def _off(
    one: PosedFrame,
    other: PosedFrame,
    flow: Float32[np.ndarray, "h w 2"],
    back: Float32[np.ndarray, "h w 2"],
    span: tuple[float, float],
) -> Float32[np.ndarray, "h w"]:
    """1 where the flow leads away from all places that a still point could be at, 0 where not; NaN if it is unsure."""
    height, width = one.depth.shape
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    x, y = columns + flow[..., 0], rows + flow[..., 1]
    returned = cv2.remap(back, x, y, cv2.INTER_LINEAR, borderValue=(1e3, 1e3))
    way = geometry.inverse(other.cam_to_world) @ one.cam_to_world
    ahead = other.K @ way[:3, :3] @ np.linalg.inv(one.K)
    out = np.empty((height, width), np.float32)
    off_line(flow, returned, ahead, other.K @ way[:3, 3], np.array(span), out)
    return out


@kernel
def off_line(
    flow: Float32[np.ndarray, "h w 2"],
    returned: Float32[np.ndarray, "h w 2"],
    ahead: Float64[np.ndarray, "3 3"],
    beside: Float64[np.ndarray, "3"],
    span: Float64[np.ndarray, "2"],
    out: Float32[np.ndarray, "h w"],
) -> None:
    """Fill in `_off`: what is z ahead of pixel p lies at z * `ahead` p + `beside` in the other image, homogeneous."""
    ends = np.empty((2, 2))
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[r, c] = np.nan
            u, v = np.float64(flow[r, c, 0]), np.float64(flow[r, c, 1])
            if np.hypot(u + returned[r, c, 0], v + returned[r, c, 1]) >= RETURNS:
                continue
            shown = True
            for n in range(2):
                z = span[n] * (ahead[2, 0] * c + ahead[2, 1] * r + ahead[2, 2]) + beside[2]
                shown &= z > 1e-6
                for k in range(2):
                    at = span[n] * (ahead[k, 0] * c + ahead[k, 1] * r + ahead[k, 2]) + beside[k]
                    ends[n, k] = at / max(z, 1e-6)
            if not shown:
                continue
            along, down = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
            x, y = c + u - ends[0, 0], r + v - ends[0, 1]
            share = (x * along + y * down) / max(along * along + down * down, 1e-9)
            share = min(max(share, 0.0), 1.0)
            apart = np.hypot(x - share * along, y - share * down)
            out[r, c] = apart > ASIDE + DRIFT * np.hypot(u, v)


def _by_segment(
    number: Int32[np.ndarray, "h w"], off: Sequence[np.ndarray]
) -> Bool[np.ndarray, "h w"]:
    """Whole segments of which most is off in most pairs."""
    count = np.bincount(number.ravel())
    votes, asked = np.zeros(len(count)), np.zeros(len(count))
    for one in off:
        sure = np.isfinite(one)
        known = np.bincount(number[sure], minlength=len(count))
        bad = np.bincount(number[sure], one[sure], minlength=len(count))
        tells = known > KNOWN * count
        votes += tells & (bad > MOVING * known)
        asked += tells
    return cleaned((votes > 0.5 * asked)[number] & (asked > 0)[number])


def cleaned(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Without specks and pinholes."""
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    number, parts, stats, _ = cv2.connectedComponentsWithStats(closed)
    large = stats[:, cv2.CC_STAT_AREA] >= LEAST * mask.size
    large[0] = False
    return large[parts] if number > 1 else np.zeros_like(mask)


def boxed(look: PosedFrame, boxes: Sequence[Box]) -> Bool[np.ndarray, "h w"]:
    """What the boxes of hands are drawn around: segments that mostly lie inside, but for what fills a whole box."""
    height, width = look.depth.shape
    out = np.zeros((height, width), bool)
    rows, columns = np.mgrid[:height, :width]
    count = np.bincount(look.segments.ravel())
    for left, top, right, bottom in boxes:
        inside = (columns >= left) & (columns <= right) & (rows >= top) & (rows <= bottom)
        mine = np.bincount(look.segments[inside], minlength=len(count))
        hand = (mine > BOXED * count) & (mine <= FILLS * max(inside.sum(), 1))
        out |= hand[look.segments] & inside
    return out


def between(noted: Mapping[int, Sequence[Box]], frame: int, most: int) -> list[Box]:
    """Boxes at a frame, drawn between those of the noted frames around it that are at most `most` apart."""
    if frame in noted:
        return list(noted[frame])
    before = max((t for t in noted if t < frame), default=None)
    after = min((t for t in noted if t > frame), default=None)
    if before is None or after is None or after - before > most:
        return []
    if len(noted[before]) != len(noted[after]):
        return []
    share = (frame - before) / (after - before)
    return [
        (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]),
         a[2] + share * (b[2] - a[2]), a[3] + share * (b[3] - a[3]))
        for a, b in zip(noted[before], noted[after], strict=True)
    ]  # fmt: skip
