"""Real spherical harmonics to degree 3 and their slopes, in the order and with the signs of 3DGS."""

from rpaug.core.jit import inlined

C0 = 0.28209479177387814
C1 = 0.4886025119029199
C2 = 1.0925484305920792
C2Z = 0.31539156525252005
C2X = 0.5462742152960396
C3 = 0.5900435899266435
C3XYZ = 2.890611442640554
C3M = 0.4570457994644658
C3Z = 0.3731763325901154
C3X = 1.445305721320277


@inlined
def basis(x, y, z, count, out):
    """out[:count] = the harmonics in the unit direction (x, y, z)."""
    out[0] = C0
    if count > 1:
        out[1], out[2], out[3] = -C1 * y, C1 * z, -C1 * x
    if count > 4:
        xx, yy, zz = x * x, y * y, z * z
        out[4], out[5], out[6] = C2 * x * y, -C2 * y * z, C2Z * (2 * zz - xx - yy)
        out[7], out[8] = -C2 * x * z, C2X * (xx - yy)
        if count > 9:
            out[9], out[10] = -C3 * y * (3 * xx - yy), C3XYZ * x * y * z
            out[11] = -C3M * y * (4 * zz - xx - yy)
            out[12] = C3Z * z * (2 * zz - 3 * xx - 3 * yy)
            out[13] = -C3M * x * (4 * zz - xx - yy)
            out[14], out[15] = C3X * z * (xx - yy), -C3 * x * (xx - 3 * yy)


@inlined
def slope(x, y, z, count, weight):
    """Gradient by (x, y, z) of the sum of weight[k] * harmonic k; `weight` is one number per harmonic."""
    dx = dy = dz = 0.0
    if count > 1:
        dx, dy, dz = -C1 * weight[3], -C1 * weight[1], C1 * weight[2]
    if count > 4:
        dx += C2 * (y * weight[4] - z * weight[7]) + 2 * x * (C2X * weight[8] - C2Z * weight[6])
        dy += C2 * (x * weight[4] - z * weight[5]) - 2 * y * (C2X * weight[8] + C2Z * weight[6])
        dz += -C2 * (y * weight[5] + x * weight[7]) + 4 * C2Z * z * weight[6]
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        dx += (
            -6 * C3 * x * y * weight[9] + C3XYZ * y * z * weight[10] + 2 * C3M * x * y * weight[11]
        )
        dx += -6 * C3Z * x * z * weight[12] - C3M * (4 * zz - 3 * xx - yy) * weight[13]
        dx += 2 * C3X * x * z * weight[14] - 3 * C3 * (xx - yy) * weight[15]
        dy += -3 * C3 * (xx - yy) * weight[9] + C3XYZ * x * z * weight[10]
        dy += -C3M * (4 * zz - xx - 3 * yy) * weight[11] - 6 * C3Z * y * z * weight[12]
        dy += (
            2 * C3M * x * y * weight[13]
            - 2 * C3X * y * z * weight[14]
            + 6 * C3 * x * y * weight[15]
        )
        dz += C3XYZ * x * y * weight[10] - 8 * C3M * z * (y * weight[11] + x * weight[13])
        dz += C3Z * (6 * zz - 3 * xx - 3 * yy) * weight[12] + C3X * (xx - yy) * weight[14]
    return dx, dy, dz
