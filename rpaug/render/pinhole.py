"""From one camera's pixels into another's, in double precision and relative to each other.

`rpaug.core.geometry` goes by way of the world, on whole arrays. Kernels that draw one recording into another camera
need what it cannot give: no digits are lost far from the world's origin, a camera maps onto itself exactly, and a pixel
is mapped by its 1/z without its point.
"""

import numpy as np
from jaxtyping import Float64

from rpaug.core.jit import kernel

NEAR = 1e-3  # of a surfel's recorded depth: a corner nearer to the target camera than this is not drawn


@kernel
def intrinsics(K: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "4"]:
    """Focal lengths and principal point (fx, fy, cx, cy) in pixels."""
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])


@kernel
def relative(here, there):
    """From camera `here` into camera `there`: two 4x4 poses in, the upper 3x4 of a rigid motion out.

    Centres are subtracted first, to keep digits far from the origin; and the rotation is inverted (by cofactors)
    rather than transposed, since recorded ones are orthonormal to float32 only. A camera maps onto itself exactly.
    """
    out = np.zeros((3, 4))
    if (here == there).all():
        out[0, 0] = out[1, 1] = out[2, 2] = 1.0
        return out
    turn = there[:3, :3]
    cofactors = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            cofactors[i, j] = turn[a, c] * turn[b, d] - turn[a, d] * turn[b, c]
    scale = 1.0 / (
        turn[0, 0] * cofactors[0, 0] + turn[0, 1] * cofactors[0, 1] + turn[0, 2] * cofactors[0, 2]
    )
    for i in range(3):
        for k in range(3):
            for j in range(4):
                part = here[k, j] - there[k, 3] if j == 3 else here[k, j]
                out[i, j] += scale * cofactors[k, i] * part
    return out


@kernel
def map_pixel(u, v, near, target, pose, lens):
    """Pixel (column, row) and depth ratio, in another camera, of the target's pixel (u, v) at 1/z = near."""
    return map_ray((u - target[2]) / target[0], (v - target[3]) / target[1], near, pose, lens)


@kernel
def map_ray(p, q, near, pose, lens):
    """The same of the target's ray (p, q, 1)."""
    ahead = pose[2, 0] * p + pose[2, 1] * q + pose[2, 2] + near * pose[2, 3]
    column = pose[0, 0] * p + pose[0, 1] * q + pose[0, 2] + near * pose[0, 3]
    row = pose[1, 0] * p + pose[1, 1] * q + pose[1, 2] + near * pose[1, 3]
    return lens[0] * column / ahead + lens[2], lens[1] * row / ahead + lens[3], ahead
