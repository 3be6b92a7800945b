"""Particles to grid and back, compiled: moving least squares MPM with affine momentum and quadratic B-splines.

Hu et al. 2018, "A Moving Least Squares Material Point Method with Displacement Discontinuity and Two-Way Rigid Body
Coupling", section 4; affine momentum after Jiang et al. 2015. Grids are windows around the particles: node (i, j, n) of
one lies at `origin + cell * (i, j, n)`. Channels of a node are momentum (3) and mass, later velocity (3) and mass.
"""

import numpy as np

from rpaug.core.jit import inlined, kernel


@inlined
def _weights(x):
    return 0.5 * (1.5 - x) * (1.5 - x), 0.75 - (x - 1.0) * (x - 1.0), 0.5 * (x - 0.5) * (x - 0.5)


@inlined
def _around(x, p, origin, inverse, wx, wy, wz):
    """The lowest of the 27 nodes that particle p lies among, and where it lies from there in cells.

    Fills `wx`, `wy` and `wz` with what the three nodes along each axis weigh.
    """
    gx = (x[p, 0] - origin[0]) * inverse
    gy = (x[p, 1] - origin[1]) * inverse
    gz = (x[p, 2] - origin[2]) * inverse
    bx, by, bz = int(gx - 0.5), int(gy - 0.5), int(gz - 0.5)
    fx, fy, fz = gx - bx, gy - by, gz - bz
    wx[0], wx[1], wx[2] = _weights(fx)
    wy[0], wy[1], wy[2] = _weights(fy)
    wz[0], wz[1], wz[2] = _weights(fz)
    return bx, by, bz, fx, fy, fz


@kernel
def scatter(x, v, C, tau, mass, nodes, origin, cell, dt, low, high):
    """Momentum and mass of particles low..high, added onto `nodes`; `tau` is initial volume times Kirchhoff stress."""
    inverse = 1.0 / cell
    k = 4.0 * inverse * inverse * dt
    wx, wy, wz = np.empty(3), np.empty(3), np.empty(3)
    a = np.empty((3, 3))
    for p in range(low, high):
        m = mass[p]
        bx, by, bz, fx, fy, fz = _around(x, p, origin, inverse, wx, wy, wz)
        for r in range(3):
            for c in range(3):
                a[r, c] = (m * C[p, r, c] - k * tau[p, r, c]) * cell
        # Affine momentum at the corner node of the stencil; steps of one cell add a column of `a`.
        px = m * v[p, 0] - a[0, 0] * fx - a[0, 1] * fy - a[0, 2] * fz
        py = m * v[p, 1] - a[1, 0] * fx - a[1, 1] * fy - a[1, 2] * fz
        pz = m * v[p, 2] - a[2, 0] * fx - a[2, 1] * fy - a[2, 2] * fz
        for i in range(3):
            for j in range(3):
                w2 = wx[i] * wy[j]
                qx = px + i * a[0, 0] + j * a[0, 1]
                qy = py + i * a[1, 0] + j * a[1, 1]
                qz = pz + i * a[2, 0] + j * a[2, 1]
                for n in range(3):
                    w = w2 * wz[n]
                    nodes[bx + i, by + j, bz + n, 0] += w * (qx + n * a[0, 2])
                    nodes[bx + i, by + j, bz + n, 1] += w * (qy + n * a[1, 2])
                    nodes[bx + i, by + j, bz + n, 2] += w * (qz + n * a[2, 2])
                    nodes[bx + i, by + j, bz + n, 3] += w * m


@kernel
def gather(x, v, C, F, D, nodes, origin, cell, dt, low, high):
    """Velocities and their gradients back from the grid; particles move on, with what they are deformed by.

    `F` is the elastic deformation, which a law may take back in part, and `D` the whole one since the start.
    """
    inverse = 1.0 / cell
    wx, wy, wz = np.empty(3), np.empty(3), np.empty(3)
    b, f = np.empty((3, 3)), np.empty((3, 3))
    for p in range(low, high):
        bx, by, bz, fx, fy, fz = _around(x, p, origin, inverse, wx, wy, wz)
        vx, vy, vz = 0.0, 0.0, 0.0
        b[:] = 0.0
        for i in range(3):
            dx = i - fx
            for j in range(3):
                dy = j - fy
                w2 = wx[i] * wy[j]
                for n in range(3):
                    dz = n - fz
                    w = w2 * wz[n]
                    ux = w * nodes[bx + i, by + j, bz + n, 0]
                    uy = w * nodes[bx + i, by + j, bz + n, 1]
                    uz = w * nodes[bx + i, by + j, bz + n, 2]
                    vx += ux
                    vy += uy
                    vz += uz
                    b[0, 0] += ux * dx
                    b[0, 1] += ux * dy
                    b[0, 2] += ux * dz
                    b[1, 0] += uy * dx
                    b[1, 1] += uy * dy
                    b[1, 2] += uy * dz
                    b[2, 0] += uz * dx
                    b[2, 1] += uz * dy
                    b[2, 2] += uz * dz
        v[p, 0], v[p, 1], v[p, 2] = vx, vy, vz
        x[p, 0] += dt * vx
        x[p, 1] += dt * vy
        x[p, 2] += dt * vz
        for r in range(3):
            for c in range(3):
                C[p, r, c] = 4.0 * inverse * b[r, c]
        _grow(F, p, C, dt, f)
        _grow(D, p, C, dt, f)


@inlined
def _grow(F, p, C, dt, f):
    """Row p of F becomes (1 + dt C) F; `f` is room to work in."""
    for r in range(3):
        for c in range(3):
            f[r, c] = F[p, r, c]
    for r in range(3):
        for c in range(3):
            F[p, r, c] = f[r, c] + dt * (
                C[p, r, 0] * f[0, c] + C[p, r, 1] * f[1, c] + C[p, r, 2] * f[2, c]
            )


@kernel
def reach(x, v, low, high):
    """The box that the particles are in, as (low (3), high (3)), and their highest speed."""
    out = np.empty((2, 3))
    out[0], out[1] = np.inf, -np.inf
    most = 0.0
    for p in range(low, high):
        square = 0.0
        for k in range(3):
            out[0, k] = min(out[0, k], x[p, k])
            out[1, k] = max(out[1, k], x[p, k])
            square += v[p, k] * v[p, k]
        most = max(most, square)
    return out, np.sqrt(most)


@kernel
def hold(x, v, least, most):
    """Put particles that left the box `least`..`most` back onto its side, without the speed that took them there.

    Returns how many there were; what is not a number goes to the middle, at rest.
    """
    count = 0
    for p in range(len(x)):
        out = False
        for k in range(3):
            if not (x[p, k] == x[p, k] and v[p, k] == v[p, k]):
                x[p, k], v[p, k] = 0.5 * (least[k] + most[k]), 0.0
                out = True
            elif x[p, k] < least[k]:
                x[p, k], v[p, k] = least[k], max(v[p, k], 0.0)
                out = True
            elif x[p, k] > most[k]:
                x[p, k], v[p, k] = most[k], min(v[p, k], 0.0)
                out = True
        count += out
    return count
