"""The image formation model in plain torch: slow, clear, differentiable, and the truth for every backend.

Projection is EWA splatting (Zwicker et al. 2001) as in 3DGS (Kerbl et al. 2023, arXiv 2308.04079), the
antialiased opacity is Mip-Splatting's (Yu et al. 2024, arXiv 2311.16493), the compositing rules are gsplat's.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rpaug.render.splat.settings import LARGEST, Rendering, Settings, Splats, View


@dataclass(frozen=True)
class Projected:
    """Gaussians on the image plane, those that can be seen only, in their first order.

    `factor` holds (l11, l21, l22) of the lower-triangular L with conic = 2 L L^T, so that a pixel at offset
    (dx, dy) has exponent s = (l11 dx + l21 dy)^2 + (l22 dy)^2 and alpha = opacity * exp(-s).
    """

    rows: Int[Tensor, "m"]
    centre: Float[Tensor, "m 2"]
    factor: Float[Tensor, "m 3"]
    opacity: Float[Tensor, "m"]
    depth: Float[Tensor, "m"]
    color: Float[Tensor, "m 3"]
    nonfinite: int


@dataclass(frozen=True)
class Composited:
    """Per pixel: blended values, light left over, and the Gaussian at which half of it was gone (-1: none)."""

    values: Float[Tensor, "h w c"]
    transmittance: Float[Tensor, "h w"]
    surface: Int[Tensor, "h w"]


def rotations(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Rotation matrices of quaternions (w, x, y, z) of any length; the identity for 0."""
    square = (quats * quats).sum(1, keepdim=True)
    unit = quats / torch.where(square == 0, torch.ones_like(square), square).sqrt()
    w, x, y, z = unit.unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def covariance_matrices(
    quats: Float[Tensor, "n 4"] | None,
    scales: Float[Tensor, "n 3"] | None,
    covariances: Float[Tensor, "n 6"] | None,
) -> Float[Tensor, "n 3 3"]:
    """World covariances, from either of the two ways to give a Gaussian's shape."""
    if covariances is not None:
        xx, xy, xz, yy, yz, zz = covariances.unbind(1)
        return torch.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], -1).reshape(-1, 3, 3)
    assert quats is not None
    assert scales is not None
    axes = rotations(quats) * scales[:, None]
    return axes @ axes.transpose(1, 2)


def harmonics(direction: Float[Tensor, "n 3"], count: int) -> Float[Tensor, "n count"]:
    """The first `count` real spherical harmonics in the order and with the signs of 3DGS."""
    x, y, z = direction.unbind(1)
    xx, yy, zz = x * x, y * y, z * z
    basis = [
        0.28209479177387814 * torch.ones_like(x),
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return torch.stack(basis[:count], -1)


def finite_rows(*arrays: Tensor | None) -> Bool[Tensor, "n"]:
    """Rows in which every given array is finite."""
    given = [array.isfinite() for array in arrays if array is not None]
    return torch.stack([a.flatten(1).all(1) if a.ndim > 1 else a for a in given]).all(0)


# Long: the whole projection in the order of the formulas, as the oracle of all backends.
def project(
    means: Float[Tensor, "n 3"],
    opacities: Float[Tensor, "n"],
    sh: Float[Tensor, "n k 3"],
    quats: Float[Tensor, "n 4"] | None,
    scales: Float[Tensor, "n 3"] | None,
    covariances: Float[Tensor, "n 6"] | None,
    features: Float[Tensor, "n f"] | None,
    view: View,
    settings: Settings,
) -> Projected:
    """Carry Gaussians onto the image plane; what cannot be drawn is left out and gets no gradient."""
    pose = torch.as_tensor(view.world_to_camera, dtype=means.dtype, device=means.device)
    turn, centre = pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]
    fx, fy, cx, cy = (float(view.K[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))

    finite = finite_rows(means, opacities, sh, quats, scales, covariances, features)
    in_front = (means.detach() - centre) @ turn[2] >= settings.near
    rows = torch.nonzero(finite & in_front)[:, 0]

    offset = means[rows] - centre
    x, y, z = (offset @ turn.T).unbind(1)
    # Far outside the image the linearised projection explodes: follow it up to a margin only.
    margin = settings.frustum_margin
    left, right = -(cx + 0.5) / fx, (view.width - 0.5 - cx) / fx
    top, bottom = -(cy + 0.5) / fy, (view.height - 0.5 - cy) / fy
    wide, high = margin * view.width / (2 * fx), margin * view.height / (2 * fy)
    across = (x / z).clamp(left - wide, right + wide)
    down = (y / z).clamp(top - high, bottom + high)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([fx / z, zero, -fx * across / z], -1),
            torch.stack([zero, fy / z, -fy * down / z], -1),
        ],
        -2,
    )
    to_image = jacobian @ turn
    shape = covariance_matrices(
        *(None if a is None else a[rows] for a in (quats, scales, covariances))
    )
    flat = to_image @ shape @ to_image.transpose(1, 2)
    a, b, c = flat[:, 0, 0] + settings.dilation, flat[:, 0, 1], flat[:, 1, 1] + settings.dilation
    determinant = a * c - b * b
    column, row = fx * x / z + cx, fy * y / z + cy

    sane = (a + c < LARGEST) & (column.abs() < LARGEST) & (row.abs() < LARGEST)
    opacity = opacities[rows].clamp(max=1.0)
    if settings.antialiased:
        sharp = flat[:, 0, 0] * flat[:, 1, 1] - b * b
        ratio = sharp / determinant
        opacity = opacity * torch.where(ratio > 1e-12, ratio, torch.full_like(ratio, 1e-12)).sqrt()
    drawn = sane & (determinant > 0) & (opacity >= settings.alpha_floor)

    direction = offset / offset.norm(dim=1, keepdim=True)
    basis = harmonics(direction, sh.shape[1])
    color = (0.5 + (basis[:, :, None] * sh[rows]).sum(1)).clamp(min=0.0)

    keep = torch.nonzero(drawn)[:, 0]
    a, b, c, determinant = a[keep], b[keep], c[keep], determinant[keep]
    factor = torch.stack([(c / determinant).sqrt(), -b / (c * determinant).sqrt(), c.rsqrt()], -1)
    return Projected(
        rows[keep],
        torch.stack([column, row], -1)[keep],
        factor * 0.5**0.5,
        opacity[keep],
        z[keep],
        color[keep],
        int((~finite).sum() + (~sane).sum()),
    )


def composite(
    projected: Projected,
    values: Float[Tensor, "m c"],
    width: int,
    height: int,
    settings: Settings,
) -> Composited:
    """Blend front to back, exactly, pixel by pixel; equal depths blend in the order of their rows."""
    order = torch.argsort(projected.depth, stable=True)
    centre, factor = projected.centre[order], projected.factor[order]
    opacity, values, rows = projected.opacity[order], values[order], projected.rows[order]
    columns = torch.arange(width, dtype=centre.dtype)
    lines = []
    for line in range(height):
        dx, dy = columns[:, None] - centre[:, 0], line - centre[:, 1]
        exponent = (factor[:, 0] * dx + factor[:, 1] * dy) ** 2 + (factor[:, 2] * dy) ** 2
        alpha = (opacity * torch.exp(-exponent)).clamp(max=settings.alpha_max)
        alpha = torch.where(alpha >= settings.alpha_floor, alpha, 0.0)
        after = torch.cumprod(1 - alpha, 1)
        before = torch.cat([torch.ones_like(after[:, :1]), after], 1)[:, :-1]
        # Once a splat would exhaust the light it and all behind it are left out.
        live = (after > settings.transmittance_stop) & (alpha > 0)
        weight = torch.where(live, alpha * before, 0.0)
        left = torch.where(live, 1 - alpha, 1.0).prod(1)
        halves = (live & (before > 0.5) & (after <= 0.5)).int()
        surface = torch.full((width,), -1)
        if len(rows):
            surface = torch.where(halves.any(1), rows[halves.argmax(1)], surface)
        lines.append((weight @ values, left, surface))
    blended, transmittance, surface = (torch.stack(parts) for parts in zip(*lines, strict=True))
    return Composited(blended, transmittance, surface)


class Images(NamedTuple):
    """Images as tensors, differentiable by whatever the Gaussians' tensors depend on."""

    color: Float[Tensor, "h w 3"]
    depth: Float[Tensor, "h w"]
    alpha: Float[Tensor, "h w"]
    features: Float[Tensor, "h w f"] | None


def rasterise(
    means: Float[Tensor, "n 3"],
    opacities: Float[Tensor, "n"],
    sh: Float[Tensor, "n k 3"],
    quats: Float[Tensor, "n 4"] | None,
    scales: Float[Tensor, "n 3"] | None,
    covariances: Float[Tensor, "n 6"] | None,
    features: Float[Tensor, "n f"] | None,
    view: View,
    settings: Settings,
    background: Float[Tensor, "3"],
) -> tuple[Images, Int[Tensor, "h w"], Projected]:
    """Project and composite; depth is the expected one. Also the surface's index, and what was drawn."""
    seen = project(means, opacities, sh, quats, scales, covariances, features, view, settings)
    extra = [] if features is None else [features[seen.rows]]
    values = torch.cat([seen.color, seen.depth[:, None], *extra], 1)
    done = composite(seen, values, view.width, view.height, settings)
    alpha = 1 - done.transmittance
    color = done.values[..., :3] + done.transmittance[..., None] * background
    depth = done.values[..., 3] / alpha.clamp(min=1e-10)
    more = None if features is None else done.values[..., 4:]
    return Images(color, depth, alpha, more), done.surface, seen


def render(splats: Splats, view: View, settings: Settings, background: np.ndarray) -> Rendering:
    """`rasterise` in float64 for arrays in, arrays out."""
    wide: dict[str, Any] = {
        name: None if array is None else torch.as_tensor(np.asarray(array, np.float64))
        for name, array in vars(splats).items()
    }
    color = torch.as_tensor(background, dtype=torch.float64)
    images, surface, seen = rasterise(**wide, view=view, settings=settings, background=color)
    depths = torch.zeros(len(splats) + 1, dtype=torch.float64)  # the last one stands for index -1
    depths[seen.rows] = seen.depth
    return Rendering(
        color=_image(images.color),
        depth_expected=_image(images.depth),
        depth_surface=_image(depths[surface]),
        surface_index=surface.numpy().astype(np.int32),
        alpha=_image(images.alpha),
        features=None if images.features is None else _image(images.features),
        nonfinite=seen.nonfinite,
    )


def _image(tensor: Tensor) -> np.ndarray:
    return tensor.numpy().astype(np.float32)
