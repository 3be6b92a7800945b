"""Recorded pixels drawn as small planes into one z-buffer, seen from any camera.

Each recorded pixel becomes a *surfel*: the piece of plane that covers exactly the pixel's footprint, at the
recorded depth. Its slope comes from the depth of its neighbours: 1/z is affine in pixel coordinates on a plane,
so a plane in the world is three numbers in the image. Where a view stretches that piece, a finer recording of the
place is preferred, and a streak is not drawn: at grazing angles depth between pixels is a guess. Nothing is
triangulated across two objects, so there are no rubber sheets, and nothing is splatted as a disc, so there are no
cracks.

Depth is kept as 1/z in the buffer, and everything is computed in the target camera's own frame in float64, so a
scene far from the world's origin loses nothing. A recorded pixel without depth shows that nothing is there: it counts
as infinitely far (1/z = 0).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int32, UInt8

from rpaug.core.jit import inlined, kernel
from rpaug.render.lookup import add_color
from rpaug.render.outlines import BEFORE, BEHIND, HALF, INSIDE, WIDE, Footprints, footprints
from rpaug.render.pinhole import NEAR, intrinsics, map_ray, relative

SAME_SURFACE = 0.006  # of depth: closer than this, the earlier source is believed
TOUCH = 0.05  # of that: so close are what was put elsewhere and what it touches there
COARSER = (
    1 << 10
)  # added to the rank each time a view doubles a recorded pixel's length: later than any source
STREAK = 2  # doublings of its length at which a pixel at least twice as long as wide is not drawn
BEYOND = 1 << 16  # added to the rank of what reaches past its own pixel: later than any source
SLIVER = 1e-12  # pixels: less of the target than this a recorded pixel does not cover
PIECE = 128  # pixels of a row that are worked out at once
EARLIER = BEYOND >> 1  # taken from the rank of what comes before all others, however stretched


@dataclass(frozen=True)
class Gains:
    """Factors on the colors of some instance ids."""

    instance_ids: Int32[np.ndarray, "n"]
    factors: Float32[np.ndarray, "n 3"]


NO_GAINS = Gains(np.zeros(0, np.int32), np.zeros((0, 3), np.float32))


@dataclass(frozen=True)
class Source:
    """One recorded image whose pixels are drawn as surfels.

    `depth` is in metres, 0 or non-finite where the sensor saw nothing. `use` picks the pixels to draw (None: all);
    `distant` also draws those without depth, as infinitely far; `carved` drops what the witness saw through.
    `before` draws it as if it came earlier than all that are not. `lifted` are the footprints, if they were worked out
    before (with `lift`), and `gains` factors on its colors.
    """

    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]
    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    use: Bool[np.ndarray, "h w"] | None = None
    distant: bool = False
    carved: bool = False
    before: bool = False
    lifted: Footprints | None = None
    gains: Gains = NO_GAINS

    @property
    def nbytes(self) -> int:
        """Bytes that the images hold."""
        images = (self.rgb, self.depth, self.ids, self.use, self.lifted)
        return sum(each.nbytes for each in images if each is not None)


def lift(source: Source, tolerance: float = SAME_SURFACE) -> Source:
    """The source with its footprints worked out, for one that is drawn again and again."""
    return replace(source, lifted=footprints(nearness(source), source.ids, tolerance))


@dataclass(frozen=True)
class Rendered:
    """One view drawn from surfels: every plane comes from the same winner of the same z-buffer.

    `rgb` is display sRGB in 0..1; `depth` metres, 0 where nothing is or all is infinitely far; `ids` instance
    ids; `source` the index of the source that won, -1 where none did, which is where `hole` is set. `rough` is set
    where a surfel won that is stretched to twice its length, or reaches past its outline: half a guess.
    """

    rgb: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    source: Int16[np.ndarray, "h w"]
    hole: Bool[np.ndarray, "h w"]
    rough: Bool[np.ndarray, "h w"]

    @property
    def image(self) -> UInt8[np.ndarray, "h w 3"]:
        """The colors as 8-bit pixels."""
        return to_bytes(self.rgb)


@kernel
def to_bytes(rgb: Float32[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Colors in 0..1 as 8-bit pixels; undoes a division by 255 exactly."""
    out = np.empty(rgb.shape, np.uint8)
    for y in range(rgb.shape[0]):
        for x in range(rgb.shape[1]):
            for channel in range(3):
                value = min(max(rgb[y, x, channel], np.float32(0)), np.float32(1))
                out[y, x, channel] = np.uint8(np.rint(value * np.float32(255)))
    return out


def render(
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    size: tuple[int, int],
    sources: Sequence[Source],
    witness: Source | None = None,
    tolerance: float = SAME_SURFACE,
) -> Rendered:
    """Draw the sources' surfels as the camera `K`, `cam_to_world` of `size` (width, height) sees them.

    The nearest surfel wins, but within `tolerance` (a share) of its depth a less stretched one, and of those an
    earlier source, keeps the pixel; and any source comes before all that only reach past their outline or their own
    pixel. A `carved` source's surfel is dropped where `witness`, looking the same way at the same time, recorded
    something farther: what one can see through is not there.
    """
    width, height = size
    nearest = np.full((height, width), -1.0)
    rank = np.zeros((height, width), np.int64)
    source = np.full((height, width), -1, np.int16)
    pixel, ids = (np.zeros((height, width), np.int32) for _ in range(2))
    target = intrinsics(K)
    nobody, everything = np.zeros((0, 0)), np.zeros((0, 0), np.bool_)
    near_seen = nobody if witness is None else np.maximum(_near(witness), 0.0)
    lens, back = target, np.zeros((3, 4))
    if witness is not None:
        lens, back = intrinsics(witness.K), relative(cam_to_world, witness.cam_to_world)
    lifted = [each if each.lifted else lift(each, tolerance) for each in sources]
    lenses = [intrinsics(each.K) for each in lifted]
    homes = [relative(cam_to_world, each.cam_to_world) for each in lifted]
    for index, each in enumerate(lifted):
        prints = each.lifted
        assert prints is not None
        use = everything if each.use is None else each.use
        _draw(
            prints.near, use, each.ids, prints.slope, prints.edge, prints.line, lenses[index],
            relative(each.cam_to_world, cam_to_world), homes[index], target, index, index - EARLIER * each.before,
            near_seen if each.carved else nobody, lens, back, tolerance, nearest, rank, source, pixel, ids,
        )  # fmt: skip
    stretch = _stretch(rank)
    rgb = np.zeros((height, width, 3), np.float32)
    weight = np.zeros((height, width), np.float32)
    # Colors of the first are its own.
    first, others = np.argwhere(source == 0), np.argwhere(source > 0)
    for index, each in enumerate(lifted):
        assert each.lifted is not None
        use = everything if each.use is None else each.use
        add_color(
            each.rgb, each.ids, each.lifted.near, use, each.gains.instance_ids, each.gains.factors, lenses[index],
            homes[index], target, index, tolerance, others if index else first, nearest, source, pixel, stretch, ids,
            rgb, weight,
        )  # fmt: skip
    depth, hole, rough = _finish(rank, nearest, source, weight, rgb)
    return Rendered(rgb, depth, ids, source, hole, rough)


def carve(
    shown: Bool[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    witnesses: Sequence[Source],
    tolerance: float,
) -> None:
    """Unmark the pixels of a view whose points, at their depth, some witness saw through."""
    for witness in witnesses:
        near = np.maximum(_near(witness), 0.0)
        back, lens = relative(cam_to_world, witness.cam_to_world), intrinsics(witness.K)
        _carve(shown, depth, intrinsics(K), back, lens, near, tolerance)


@kernel
def _carve(shown, depth, target, back, lens, seen, tolerance):
    for v in range(shown.shape[0]):
        for u in range(shown.shape[1]):
            if shown[v, u] and depth[v, u] > 0.0:
                near = 1.0 / depth[v, u]
                p, q = (u - target[2]) / target[0], (v - target[3]) / target[1]
                shown[v, u] = not _seen_through(p, q, near, back, lens, seen, tolerance)


@kernel
def _stretch(rank):
    """How long the winner's recorded pixel is in the view, by the doublings that its rank holds."""
    out = np.empty(rank.shape)
    for v in range(rank.shape[0]):
        for u in range(rank.shape[1]):
            rank[v, u] += EARLIER * (rank[v, u] < 0)
            out[v, u] = 1 << (rank[v, u] % EARLIER // COARSER)
    return out


@kernel
def _finish(rank, nearest, source, weight, rgb):
    """Depth, hole and rough of a view; its colors, summed so far, become means."""
    depth = np.zeros(rank.shape, np.float32)
    hole, rough = np.empty(rank.shape, np.bool_), np.empty(rank.shape, np.bool_)
    for v in range(rank.shape[0]):
        for u in range(rank.shape[1]):
            if nearest[v, u] > 0:
                depth[v, u] = 1.0 / nearest[v, u]
            hole[v, u] = source[v, u] < 0
            rough[v, u] = rank[v, u] >= COARSER
            if weight[v, u] > 1:
                for channel in range(3):
                    rgb[v, u, channel] /= weight[v, u]
    return depth, hole, rough


def _near(source: Source) -> Float64[np.ndarray, "h w"]:
    return nearness(source) if source.lifted is None else source.lifted.near


def nearness(source: Source) -> Float64[np.ndarray, "h w"]:
    """1/z of each pixel of a recording: 0 is infinitely far, negative is not drawn."""
    known = np.isfinite(source.depth) & (source.depth > 0)
    absent = 0.0 if source.distant else -1.0
    return np.divide(
        1.0, source.depth, out=np.full(known.shape, absent), where=known, dtype=np.float64
    )


@kernel
# Long: one kernel is one function; what its innermost loop needs of a footprint are a score of numbers.
def _draw(
    near, use, ids, slope, edge, line, lens, pose, home, target, index, first, seen, witness, back, tolerance, nearest,
    rank, source, pixel, won,
):  # fmt: skip
    """Draw one source's surfels, of the pixels to `use` (none given: of all): rasterise each footprint, keep the
    nearest, leave out what was seen through."""
    # Long: one pass over a source's rows, whose parts share a dozen arrays.
    height, width = nearest.shape
    rays = (np.arange(width) - target[2]) / target[0]
    prints = np.empty((11, PIECE))
    for row in range(near.shape[0]):
        for begin in range(0, near.shape[1], PIECE):
            piece = slice(begin, begin + PIECE)
            if use.size and not use[row, piece].any():
                continue
            _project(
                near[row, piece], slope[row, piece].reshape(-1), edge[row, piece], row, begin, lens, pose, target,
                width, height, prints.reshape(-1),
            )  # fmt: skip
            for at in range(min(PIECE, near.shape[1] - begin)):
                left, right, top, bottom = (
                    prints[0, at],
                    prints[1, at],
                    prints[2, at],
                    prints[3, at],
                )
                column = begin + at
                if not (left <= right and top <= bottom) or (use.size and not use[row, column]):
                    continue
                doublings = _doublings(prints[9, at], prints[10, at])
                if doublings < 0:
                    continue
                place = first + COARSER * doublings
                here, ends = near[row, column], edge[row, column]
                half = HALF if ends == INSIDE else WIDE
                x, y, hit_here, dx, dy = (
                    prints[4, at],
                    prints[5, at],
                    prints[6, at],
                    prints[7, at],
                    prints[8, at],
                )
                for v in range(int(top), int(bottom) + 1):
                    q = (v - target[3]) / target[1]
                    for u in range(int(left), int(right) + 1):
                        hit = hit_here + dx * (u - x) + dy * (v - y) if here > 0.0 else 0.0
                        if hit < 0.0 or (here > 0.0 and hit == 0.0):
                            continue
                        if not _wins(hit, place, nearest[v, u], rank[v, u], tolerance):
                            continue
                        i, j, _ = map_ray(rays[u], q, hit, home, lens)
                        i, j = i - column, j - row
                        if not (abs(i) <= half and abs(j) <= half):
                            continue
                        order = place
                        if ends != INSIDE and not _covers(i, j, ends, line[row, column]):
                            if ends == BEFORE:
                                continue
                            order += BEYOND
                            if not _wins(hit, order, nearest[v, u], rank[v, u], tolerance):
                                continue
                        if seen.size and _seen_through(
                            rays[u], q, hit, back, witness, seen, tolerance
                        ):
                            continue
                        nearest[v, u] = hit
                        rank[v, u] = order
                        source[v, u] = index
                        pixel[v, u] = row * near.shape[1] + column
                        won[v, u] = ids[row, column]


@kernel
def _project(near, slope, edge, row, first, lens, pose, target, width, height, out):
    """Where the target sees the footprints of a row's pixels: centre (x, y), half width and height (NaN: not at all),
    1/z there and its change per pixel to the right and down, and of the map from recorded to drawn pixels the squares'
    sum and the determinant.

    The point at pixel ray r and inverse depth w maps to R r + w t, which also holds at infinity. It is affine in the
    pixel, so that a footprint's map is known from its centre and two steps. Without branches, for vectors.
    """
    right_x, right_y, right_z = pose[0, 0] / lens[0], pose[1, 0] / lens[0], pose[2, 0] / lens[0]
    down_x, down_y, down_z = pose[0, 1] / lens[1], pose[1, 1] / lens[1], pose[2, 1] / lens[1]
    q = (row - lens[3]) / lens[1]
    for k in range(len(near)):
        here, across, down = near[k], slope[2 * k], slope[2 * k + 1]
        half = HALF if edge[k] == INSIDE else WIDE
        p = (first + k - lens[2]) / lens[0]
        ahead = pose[2, 0] * p + pose[2, 1] * q + pose[2, 2] + here * pose[2, 3]
        right_ahead, down_ahead = right_z + across * pose[2, 3], down_z + down * pose[2, 3]
        turn = half * (abs(right_ahead) + abs(down_ahead))
        scale = 1.0 / ahead
        x = (pose[0, 0] * p + pose[0, 1] * q + pose[0, 2] + here * pose[0, 3]) * scale
        y = (pose[1, 0] * p + pose[1, 1] * q + pose[1, 2] + here * pose[1, 3]) * scale
        # Steps of a pixel to the right and down, at the centre. Towards a corner they grow by `larger` at most.
        a = target[0] * scale * (right_x + across * pose[0, 3] - x * right_ahead)
        b = target[0] * scale * (down_x + down * pose[0, 3] - x * down_ahead)
        c = target[1] * scale * (right_y + across * pose[1, 3] - y * right_ahead)
        d = target[1] * scale * (down_y + down * pose[1, 3] - y * down_ahead)
        larger = half * ahead / (ahead - turn)
        area = a * d - b * c
        # 1/z is affine in the target's pixels too.
        hit = here * scale
        per_right = scale * (across - hit * right_ahead) / area
        per_down = scale * (down - hit * down_ahead) / area
        # Not drawn: a corner behind the target camera or too near; what is seen from behind, edge on, or not a number.
        drawn = (
            (here >= 0.0)
            & (here >= half * (abs(across) + abs(down)))
            & (ahead - turn > NEAR)
            & (area > SLIVER)
        )
        x, y = target[0] * x + target[2], target[1] * y + target[3]
        wide, tall = larger * (abs(a) + abs(b)), larger * (abs(c) + abs(d))
        out[k] = np.ceil(max(0.0, x - wide)) if drawn else np.inf
        out[PIECE + k] = np.floor(min(width - 1.0, x + wide))
        out[2 * PIECE + k] = np.ceil(max(0.0, y - tall))
        out[3 * PIECE + k] = np.floor(min(height - 1.0, y + tall))
        out[4 * PIECE + k], out[5 * PIECE + k] = x, y
        out[6 * PIECE + k] = hit
        out[7 * PIECE + k] = per_right * d - per_down * c
        out[8 * PIECE + k] = per_down * a - per_right * b
        out[9 * PIECE + k] = a * a + b * b + c * c + d * d
        out[10 * PIECE + k] = area


@inlined
def _doublings(both, area):
    """How often a recorded pixel's length has doubled on the screen, or -1 for a streak.

    Length and width are the singular values of the map from recorded to drawn pixels, `both` the sum of their squares.
    """
    if both < 4.0:  # its length, of which this is the square or more, has not doubled
        return 0
    square = 0.5 * (both + math.sqrt(max(both * both - 4.0 * area * area, 0.0)))
    doublings = int(0.5 * math.log2(max(square, 1.0)))
    return -1 if doublings >= STREAK and square >= 2.0 * area else doublings


@inlined
def _covers(x, y, ends, line):
    """Whether a surfel shows the point (x, y) pixels from its centre: within its outline, or in its own pixel."""
    if ends == BEHIND:
        return abs(x) <= HALF and abs(y) <= HALF
    return line[0] * x + line[1] * y + line[2] >= 0.0


@inlined
def _wins(hit, order, held, rank, tolerance):
    """Whether 1/z = hit takes the pixel: it is nearer, or as near and comes earlier.

    Two surfaces recorded in one place are one if they are within the tolerance; but what was put elsewhere and what it
    touches there are two, so only their noise counts.
    """
    if held < 0.0 or order == rank:
        return hit > held
    close = tolerance if (order < 0) == (rank < 0) else tolerance - (1.0 - TOUCH) * SAME_SURFACE
    if order < rank:
        return hit * (1.0 + close) > held
    return hit > held * (1.0 + close)


@inlined
def _seen_through(p, q, near, back, witness, seen, tolerance):
    """Whether the witness recorded something clearly farther where it would see this point of a ray (p, q, 1)."""
    column, row, ahead = map_ray(p, q, near, back, witness)
    if not ahead > NEAR:
        return False
    height, width = seen.shape
    if not (-0.5 <= column < width - 0.5 and -0.5 <= row < height - 0.5):
        return False
    recorded = seen[int(np.floor(row + 0.5)), int(np.floor(column + 0.5))]
    return recorded * (1.0 + tolerance) * ahead < near
