"""What grid nodes do where they meet something solid, compiled: forces, then moving boxes, then what stands still.

A moving collider is a box with rounded edges: a row of centre (3), axes as columns (9, row by row), half sizes (3),
radius, velocity (3) and angular velocity (3), in metres and seconds. A ball or a capsule is a box without some sides.
"""

import math

import numpy as np

from rpaug.core.jit import inlined, kernel

COLUMNS = 22
TOUCH = 0.1  # of a particle's mass: a node that carries less does not make a contact


@inlined
def _meet(nodes, i, j, n, normal, wall, friction):
    """Nothing goes into a wall that moves with `wall`; friction after Coulomb, a negative one sticks.

    Returns the speed at which the node was going in, 0 if it was not.
    """
    vx, vy, vz = (
        nodes[i, j, n, 0] - wall[0],
        nodes[i, j, n, 1] - wall[1],
        nodes[i, j, n, 2] - wall[2],
    )
    into = vx * normal[0] + vy * normal[1] + vz * normal[2]
    if friction < 0.0:
        vx, vy, vz = 0.0, 0.0, 0.0
    elif into < 0.0:
        vx -= into * normal[0]
        vy -= into * normal[1]
        vz -= into * normal[2]
        slide = math.sqrt(vx * vx + vy * vy + vz * vz)
        keep = max(0.0, 1.0 + friction * into / slide) if slide > 0.0 else 0.0
        vx, vy, vz = keep * vx, keep * vy, keep * vz
    nodes[i, j, n, 0], nodes[i, j, n, 1], nodes[i, j, n, 2] = (
        wall[0] + vx,
        wall[1] + vy,
        wall[2] + vz,
    )
    return max(-into, 0.0)


@inlined
def _box_distance(box, x, y, z, normal):
    """Metres from a point to a rounded box, negative inside; fills `normal` with the way out."""
    px, py, pz = x - box[0], y - box[1], z - box[2]
    square, deepest, side = 0.0, -np.inf, 0
    normal[:] = 0.0
    for k in range(3):
        along = px * box[3 + k] + py * box[6 + k] + pz * box[9 + k]
        beyond = abs(along) - box[12 + k]
        sign = 1.0 if along >= 0 else -1.0
        if beyond > 0.0:
            square += beyond * beyond
            for r in range(3):
                normal[r] += sign * beyond * box[3 + 3 * r + k]
        if beyond > deepest:
            deepest, side = beyond, k
    if square > 0.0:
        length = math.sqrt(square)
        for r in range(3):
            normal[r] /= length
        return length - box[15]
    along = px * box[3 + side] + py * box[6 + side] + pz * box[9 + side]
    for r in range(3):
        normal[r] = box[3 + 3 * r + side] * (1.0 if along >= 0 else -1.0)
    return deepest - box[15]


@kernel
def advance(grids, gravity, dt, low, high):
    """Sum the momenta of several grids into velocities of the first, with gravity, in its slabs low..high."""
    nodes = grids[0]
    for i in range(low, high):
        for j in range(nodes.shape[1]):
            for n in range(nodes.shape[2]):
                m = 0.0
                for k in range(grids.shape[0]):
                    m += grids[k, i, j, n, 3]
                if m <= 0.0:
                    continue
                for c in range(3):
                    value = 0.0
                    for k in range(grids.shape[0]):
                        value += grids[k, i, j, n, c]
                    nodes[i, j, n, c] = value / m + dt * gravity[c]
                nodes[i, j, n, 3] = m


@inlined
def _mark(touched, what, i, j, n):
    """The 27 nodes of a particle, from their lowest."""
    for a in range(i, i + 3):
        for b in range(j, j + 3):
            for c in range(n, n + 3):
                touched[what, a, b, c] = True


@inlined
def _close(x, boxes, cell, low, high):
    """Numbers of the boxes that reach to where particles low..high are."""
    near = np.empty(len(boxes), np.int64)
    if len(boxes) == 0:
        return near
    least, most = np.full(3, np.inf), np.full(3, -np.inf)
    for p in range(low, high):
        for r in range(3):
            least[r], most[r] = min(least[r], x[p, r]), max(most[r], x[p, r])
    count = 0
    for b in range(len(boxes)):
        apart = False
        for r in range(3):
            half = boxes[b, 15] + cell
            for k in range(3):
                half += abs(boxes[b, 3 + 3 * r + k]) * boxes[b, 12 + k]
            apart = apart or least[r] > boxes[b, r] + half or most[r] < boxes[b, r] - half
        if not apart:
            near[count] = b
            count += 1
    return near[:count]


@kernel
def touching(x, radius, distance, normals, base, boxes, origin, cell, touched, low, high):
    """Mark the nodes of particles low..high, balls of `radius`, that touch what stands still (0) or a box (1).

    A node feels a wall once a particle that it carries does, not as soon as it carries anything: that would be the
    sooner the shorter the step.
    """
    normal = np.empty(3)
    near = _close(x, boxes, cell, low, high)
    inverse = 1.0 / cell
    for p in range(low, high):
        gx, gy, gz = (
            (x[p, 0] - origin[0]) * inverse,
            (x[p, 1] - origin[1]) * inverse,
            (x[p, 2] - origin[2]) * inverse,
        )
        i, j, n = int(gx + 0.5), int(gy + 0.5), int(gz + 0.5)
        si, sj, sn = base[0] + i, base[1] + j, base[2] + n
        away = distance[si, sj, sn]
        if away < radius[p] + cell:  # no particle is farther from its nearest node
            away += cell * (
                (gx - i) * normals[si, sj, sn, 0]
                + (gy - j) * normals[si, sj, sn, 1]
                + (gz - n) * normals[si, sj, sn, 2]
            )
            if away < radius[p]:
                _mark(touched, 0, int(gx - 0.5), int(gy - 0.5), int(gz - 0.5))
        for b in near:
            if _box_distance(boxes[b], x[p, 0], x[p, 1], x[p, 2], normal) < radius[p]:
                _mark(touched, 1, int(gx - 0.5), int(gy - 0.5), int(gz - 0.5))
                break


@kernel
def collide(
    nodes, touched, distance, normals, base, boxes, friction, box_friction, origin, cell, least
):
    """Apply contacts to velocities of touched nodes: boxes first, then what stands still, which gives no way.

    `distance` and `normals` cover a larger grid, in which node (0, 0, 0) here is node `base`. Returns the impulse
    given by what stands still (3), and for each box that on nodes with more than `least` kilograms, in newton seconds.
    """
    given, pushed = np.zeros(3), np.zeros(len(boxes))
    normal, wall, before = np.empty(3), np.zeros(3), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for b in range(len(boxes)):
        box = boxes[b]
        for r in range(3):
            half = box[15]
            for k in range(3):
                half += abs(box[3 + 3 * r + k]) * box[12 + k]
            first[r] = max(0, math.ceil((box[r] - half - origin[r]) / cell))
            last[r] = min(nodes.shape[r] - 1, math.floor((box[r] + half - origin[r]) / cell))
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for n in range(first[2], last[2] + 1):
                    if nodes[i, j, n, 3] <= 0.0 or not touched[1, i, j, n]:
                        continue
                    x, y, z = origin[0] + i * cell, origin[1] + j * cell, origin[2] + n * cell
                    if _box_distance(box, x, y, z, normal) >= 0.0:
                        continue
                    x, y, z = x - box[0], y - box[1], z - box[2]
                    wall[0] = box[16] + box[20] * z - box[21] * y
                    wall[1] = box[17] + box[21] * x - box[19] * z
                    wall[2] = box[18] + box[19] * y - box[20] * x
                    into = _meet(nodes, i, j, n, normal, wall, box_friction)
                    if nodes[i, j, n, 3] > least:
                        pushed[b] += into * nodes[i, j, n, 3]
    wall[:] = 0.0
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            for n in range(nodes.shape[2]):
                if not touched[0, i, j, n]:
                    continue
                m = nodes[i, j, n, 3]
                if m <= 0.0 or distance[base[0] + i, base[1] + j, base[2] + n] >= 0.0:
                    continue
                for c in range(3):
                    before[c] = nodes[i, j, n, c]
                    normal[c] = normals[base[0] + i, base[1] + j, base[2] + n, c]
                _meet(nodes, i, j, n, normal, wall, friction)
                for c in range(3):
                    given[c] += m * (nodes[i, j, n, c] - before[c])
    return given, pushed
