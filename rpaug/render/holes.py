"""Pixels nobody ever saw, filled by continuing the background that lies behind what hid them.

A hole opens where something near moved aside in the image, so what belongs there continues the farther of its two
sides. From a hole pixel we walk in eight directions to the first drawn pixel and continue its plane (1/z is affine
on a plane); of two opposite walks the farther surface counts, or the nearer where both meet in a corner. Neighbours
then vote on which thing it is, so that two backgrounds meet along a line. Beyond the frame of what a camera recorded
nothing moved aside: there the nearest end is continued, be it of an arm. And where the camera looked through a
continued surface, that is not there; nor is it beyond a straight edge of the face that it belongs to.

Colors are mirrored at the hole's edge, and not from the edge itself, where they are mixed. The hole mask stays with
the picture so that nobody takes it for a recording.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int32

from rpaug.core.jit import inlined, kernel
from rpaug.render.pinhole import NEAR, intrinsics, map_pixel, relative
from rpaug.render.zbuffer import Rendered, Source, nearness

FARNESS = 4  # a surface half as far must be 2**4 times closer in the image to be preferred
SAME_LAYER = 0.03  # of 1/z: walks that end on planes this close blend their colors
VOTES, REACH = 3, 3  # rounds of voting, and the pixels on each side that vote
CLEAN = 2  # steps behind a hole's edge, where colors are mixed no more
AXES = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows and columns of a step
HIDDEN, OUTSIDE, REFUTED = 0, 1, 2  # what a camera says of a surface that it did not record


@dataclass(frozen=True)
class Edges:
    """Straight edges at which flat faces of resting things end, in the world.

    `faces` and `sides` are planes (unit normal, offset): a point of the thing that lies on the face, at the negative
    side of `sides`, is beyond the edge.
    """

    instance_ids: Int32[np.ndarray, "n"]
    faces: Float64[np.ndarray, "n 4"]
    sides: Float64[np.ndarray, "n 4"]

    def without(self, instance_ids: frozenset[int]) -> "Edges":
        """The edges of other things than these."""
        rest = ~np.isin(self.instance_ids, list(instance_ids))
        return Edges(self.instance_ids[rest], self.faces[rest], self.sides[rest])


NO_EDGES = Edges(np.zeros(0, np.int32), np.zeros((0, 4)), np.zeros((0, 4)))


@dataclass(frozen=True)
class Witness:
    """A camera that recorded `source`, and the view, `K` and `cam_to_world`, whose holes it is asked about.

    `edges` are where resting things end.
    """

    source: Source
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]
    edges: Edges = NO_EDGES

    def judged(
        self,
        rows: np.ndarray,
        columns: np.ndarray,
        ends: np.ndarray,
        edge: Float64[np.ndarray, "n 8"],
        found: np.ndarray,
        plane: Float64[np.ndarray, "n 8"],
    ) -> np.ndarray:
        """Per pixel and way: HIDDEN behind what was recorded, OUTSIDE its frame, or REFUTED: seen through, or beyond an
        edge of its face.

        What continues there is `found` with 1/z = `plane` (brought onto the face that it starts on), from `ends` with
        1/z = `edge`.
        """
        lines, target = self.edges, intrinsics(self.K)
        beyond = np.zeros(plane.shape, np.bool_)
        _bound(
            rows, columns, ends, edge, found, target, self.cam_to_world, lines.instance_ids, lines.faces, lines.sides,
            plane, beyond,
        )  # fmt: skip
        seen = np.maximum(nearness(self.source), 0.0)
        back = relative(self.cam_to_world, self.source.cam_to_world)
        out = np.where(beyond, np.int8(REFUTED), np.int8(HIDDEN))
        _judge(rows, columns, plane, target, back, intrinsics(self.source.K), seen, out)
        return out


def fill(view: Rendered, witness: Witness | None = None) -> Rendered:
    """The view with its holes filled in color, depth and ids; `hole` and `source` stay as they were.

    A `witness` tells what is hidden from what lies outside the recorded frame. A view in which nothing was drawn stays
    black with depth 0.
    """
    if not view.hole.any() or view.hole.all():
        return view
    depth = view.depth.astype(np.float64)
    near = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    rgb, ids, hole = view.rgb.copy(), view.ids.copy(), view.hole.copy()
    while (
        hole.any()
    ):  # again where no walk from a pixel reaches a drawn one, or only what cannot be there
        rows, columns = np.nonzero(hole)
        ends, steps, away, plane = _walks(near, ids, hole, view.hole, rows, columns)
        at, kind = (ends[..., 0], ends[..., 1]), np.zeros(plane.shape, np.int8)
        edge = near[at]
        if witness:
            kind = witness.judged(rows, columns, ends, edge, ids[at], plane)
            if (kind == REFUTED).all():
                kind[:] = HIDDEN  # something has to be there
        ends, away, plane, kind = _better(ends, steps, away, edge, plane, kind)
        chosen = _vote(ids, hole, rows, columns, ends, away, plane, kind)
        _continue(rgb, near, ids, hole, rows, columns, ends, away, plane, chosen)
    filled = np.divide(1.0, near, out=np.zeros_like(near), where=near > 0)
    return replace(
        view, rgb=rgb, ids=ids, depth=np.where(view.hole, filled, view.depth).astype(np.float32)
    )


@kernel
def _judge(rows, columns, plane, target, back, lens, seen, out):
    """What a camera (`lens`, reached by `back`) that saw 1/z = `seen` says of each continued surface."""
    height, width = seen.shape
    for n in range(len(rows)):
        for way in range(8):
            near = plane[n, way]
            if not near < np.inf:
                out[n, way] = REFUTED
            if out[n, way] == REFUTED:
                continue
            x, y, ahead = map_pixel(columns[n], rows[n], near, target, back, lens)
            inside = ahead > NEAR and -0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5
            if not inside:
                out[n, way] = OUTSIDE
            elif seen[int(y + 0.5), int(x + 0.5)] * (1.0 + SAME_LAYER) * ahead < near:
                out[n, way] = REFUTED


@kernel
def _bound(
    rows, columns, ends, edge, found, target, pose, instance_ids, faces, sides, plane, beyond
):
    """Continue, where a walk ends on a face (there 1/z = `edge`), that face, and tell where it is beyond its edges."""
    start, ray = np.empty(3), np.empty(3)
    for n in range(len(rows)):
        _ray(rows[n], columns[n], target, pose, ray)
        for way in range(8):
            if not (0.0 < edge[n, way] < np.inf and plane[n, way] < np.inf):
                continue  # a walk that reached nothing ends nowhere
            _ray(ends[n, way, 0], ends[n, way, 1], target, pose, start)
            for k in range(len(instance_ids)):
                if instance_ids[k] != found[n, way]:
                    continue
                off, height, toward = 0.0, faces[k, 3], 0.0
                for a in range(3):
                    off += faces[k, a] * start[a]
                    height -= faces[k, a] * pose[a, 3]
                    toward += faces[k, a] * ray[a]
                if abs(off / edge[n, way] - height) * edge[n, way] > SAME_LAYER:
                    continue
                near = toward / height if abs(height) > NEAR else 0.0
                over = -sides[k, 3] * near
                for a in range(3):
                    over += sides[k, a] * (pose[a, 3] * near + ray[a])
                if near <= 0.0 or over < -SAME_LAYER:
                    beyond[n, way] = True
                else:
                    plane[n, way] = near


@inlined
def _ray(row, column, target, pose, out):
    """The direction of a pixel in the world, one metre deep."""
    across, down = (column - target[2]) / target[0], (row - target[3]) / target[1]
    for a in range(3):
        out[a] = pose[a, 0] * across + pose[a, 1] * down + pose[a, 2]


@kernel
def _walks(near, ids, hole, made, rows, columns):
    """Per hole pixel and way (opposite ones are neighbours), where a walk ends, its steps and length, and 1/z continued
    from its end."""
    ends = np.zeros((len(rows), 8, 2), np.int32)
    steps = np.full((len(rows), 8), -1)
    away = np.full((len(rows), 8), np.inf)
    plane = np.full((len(rows), 8), np.inf)
    for n in range(len(rows)):
        for way in range(8):
            sign = 1 - 2 * (way % 2)
            down, right = sign * AXES[way // 2][0], sign * AXES[way // 2][1]
            i, j, count, edge, tilt = _walk(near, ids, hole, made, rows[n], columns[n], down, right)
            if count < 0:
                continue
            ends[n, way, 0], ends[n, way, 1] = i, j
            steps[n, way], away[n, way] = count, count * np.sqrt(1.0 * down * down + right * right)
            plane[n, way] = edge + tilt * count
    return ends, steps, away, plane


@kernel
def _better(ends, steps, away, edge, plane, kind):
    """Per axis the end, the length, 1/z and what is said of the better of two opposite walks, REFUTED ones last."""
    count = len(ends)
    at, far = np.zeros((count, 4, 2), np.int32), np.full((count, 4), np.inf)
    layer, said = np.full((count, 4), np.inf), np.full((count, 4), REFUTED, np.int8)
    for n in range(count):
        for axis in range(4):
            a, b = 2 * axis, 2 * axis + 1
            if steps[n, a] < 0 and steps[n, b] < 0:
                continue
            if steps[n, a] < 0 or steps[n, b] < 0:
                first = steps[n, a] > 0
            elif (kind[n, a] == REFUTED) != (kind[n, b] == REFUTED):
                first = kind[n, b] == REFUTED
            else:
                up, down = edge[n, a], edge[n, b]
                rise, fall = (plane[n, a] - up) / steps[n, a], (plane[n, b] - down) / steps[n, b]
                first = _continues(up, rise, steps[n, a], down, fall, steps[n, b])
            way = a if first else b
            at[n, axis], far[n, axis] = ends[n, way], away[n, way]
            layer[n, axis], said[n, axis] = plane[n, way], kind[n, way]
    return at, far, layer, said


@kernel
def _continues(edge, slope, steps, rim, tilt, paces):
    """Whether the first of two opposite planes is the one seen here: the farther, unless they meet in a corner.

    They do where each lies in front of the other's continuation at its own end, as wall and floor of a room; there
    the nearer is seen. Each plane is 1/z at its end, its change per step towards here, and the steps.
    """
    corner = edge > rim + tilt * (steps + paces) and rim > edge + slope * (steps + paces)
    return (edge + slope * steps > rim + tilt * paces) == corner


@kernel
def _walk(near, ids, hole, made, row, column, down, right):
    """First pixel that way which is no hole, the steps to it (-1: none), its 1/z, and how that changes per step back.

    What was `made` up in an earlier round tells no slope.
    """
    height, width = hole.shape
    i, j, steps = row, column, 0
    while hole[i, j]:
        i, j, steps = i + down, j + right, steps + 1
        if not (0 <= i < height and 0 <= j < width):
            return i, j, -1, 0.0, 0.0
    edge = near[i, j]
    a, b = i + down, j + right
    if (
        not (0 <= a < height and 0 <= b < width)
        or made[a, b]
        or made[i, j]
        or ids[a, b] != ids[i, j]
    ):
        return i, j, steps, edge, 0.0
    slope = edge - near[a, b]
    believable = 0.5 * edge < edge + slope * steps < 2.0 * edge
    return i, j, steps, edge, slope if believable else 0.0


@kernel
def _vote(ids, hole, rows, columns, ends, away, plane, kind):
    """The axis each hole pixel continues: short and far, then of the thing most of its neighbours continue."""
    chosen = np.full(len(rows), -1)
    thing = np.full(hole.shape, -1)
    for n in range(len(rows)):
        chosen[n] = _cheapest(ids, ends[n], away[n], plane[n], kind[n], -1)
        if chosen[n] >= 0:
            thing[rows[n], columns[n]] = ids[ends[n, chosen[n], 0], ends[n, chosen[n], 1]]
    for _ in range(VOTES):
        before = thing.copy()
        for n in range(len(rows)):
            best, most = -1, 0
            for axis in range(4):
                if away[n, axis] < np.inf and kind[n, axis] != REFUTED:
                    instance_id = ids[ends[n, axis, 0], ends[n, axis, 1]]
                    votes = _count(before, rows[n], columns[n], instance_id)
                    if votes > most or (
                        votes == most and instance_id == before[rows[n], columns[n]]
                    ):
                        best, most = instance_id, votes
            if most:
                chosen[n] = _cheapest(ids, ends[n], away[n], plane[n], kind[n], best)
                thing[rows[n], columns[n]] = best
    return chosen


@kernel
def _count(thing, row, column, instance_id):
    votes = 0
    for i in range(max(0, row - REACH), min(thing.shape[0], row + REACH + 1)):
        for j in range(max(0, column - REACH), min(thing.shape[1], column + REACH + 1)):
            votes += thing[i, j] == instance_id
    return votes


@kernel
def _cheapest(ids, ends, away, plane, kind, instance_id):
    """The walk of least length * (1/z) ** FARNESS, among those that end on `instance_id` (-1: any); -1 if none."""
    best, chosen = np.inf, -1
    farthest = plane.min()
    for axis in range(4):
        if not away[axis] < np.inf or kind[axis] == REFUTED:
            continue
        if instance_id >= 0 and ids[ends[axis, 0], ends[axis, 1]] != instance_id:
            continue
        nearness = (
            1.0
            if plane[axis] == farthest or kind[axis] == OUTSIDE
            else plane[axis] / max(farthest, 1e-3 * plane[axis])
        )
        if away[axis] * nearness**FARNESS < best:
            best, chosen = away[axis] * nearness**FARNESS, axis
    return chosen


@inlined
def _clean(ids, hole, row, column, down, right, most):
    """The drawn pixel of the same thing up to so many steps on: at an outline colors are mixed."""
    i, j = row, column
    for _ in range(most):
        a, b = i + down, j + right
        if not (0 <= a < hole.shape[0] and 0 <= b < hole.shape[1]) or hole[a, b]:
            break
        if ids[a, b] != ids[row, column]:
            break
        i, j = a, b
    return i, j


@kernel
def _continue(rgb, near, ids, hole, rows, columns, ends, away, plane, chosen):
    """Write the chosen surfaces into the images, colors blended over walks to the same one."""
    missing = hole.copy()
    for n in range(len(rows)):
        if chosen[n] < 0:
            continue
        row, column, layer = rows[n], columns[n], plane[n, chosen[n]]
        instance_id = ids[ends[n, chosen[n], 0], ends[n, chosen[n], 1]]
        total = red = green = blue = 0.0
        for axis in range(4):
            i, j = ends[n, axis]
            same = away[n, axis] < np.inf and ids[i, j] == instance_id
            if same and abs(plane[n, axis] - layer) <= SAME_LAYER * layer:
                weight = 1.0 / away[n, axis] ** 2
                down, right = i - row, j - column
                pace = max(abs(down), abs(right))
                a, b = _clean(ids, missing, i, j, down // pace, right // pace, max(CLEAN, pace))
                total += weight
                red += weight * rgb[a, b, 0]
                green += weight * rgb[a, b, 1]
                blue += weight * rgb[a, b, 2]
        rgb[row, column, 0], rgb[row, column, 1] = red / total, green / total
        rgb[row, column, 2] = blue / total
        near[row, column] = layer
        ids[row, column] = instance_id
        hole[row, column] = False
