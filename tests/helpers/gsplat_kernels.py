"""gsplat 1.5.3's three kernels as their CUDA source states them, in torch: what is handed to them runs without a GPU.

In float32, in their order of operations; sums and exponentials are torch's own, and gradients autograd's.
"""

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import pytest
import torch
from torch import Tensor

from rpaug.render.splat import _gsplat
from rpaug.render.splat._gsplat import Kernels

ON_GPU = pytest.param(
    "gsplat",
    marks=[
        pytest.mark.gpu,
        pytest.mark.skipif(
            not torch.cuda.is_available() or importlib.util.find_spec("gsplat") is None,
            reason="needs a CUDA GPU and gsplat",
        ),
    ],
)

EMULATED = "emulated"
"""The "gsplat" backend on the CPU, its kernels' source in the place of the kernels."""
FLOOR, MOST, STOP = 1 / 255, 0.999, 1e-4


def tiles(
    means2d: Tensor, radii: Tensor, depths: Tensor, size: int, across: int, down: int, n_images: int
) -> tuple[Tensor, Tensor, Tensor]:
    """`isect_tiles` (IntersectTile.cu): tiles of each Gaussian, sorted (tile, depth) keys, whose they are."""
    assert means2d.dtype == depths.dtype == torch.float32
    assert radii.dtype == torch.int32
    assert n_images == len(means2d) == 1
    most = torch.tensor([across, down])
    middle, reach = means2d[0].detach() / size, radii[0].float() / size
    low = torch.minimum((middle - reach).floor().clamp(min=0), most).int()
    high = torch.minimum((middle + reach).ceil().clamp(min=0), most).int()
    bits = depths[0].detach().contiguous().view(torch.int32).long()
    keys, whose = [], []
    for row in range(len(bits)):
        if (radii[0, row] <= 0).any():
            continue
        for y in range(int(low[row, 1]), int(high[row, 1])):
            for x in range(int(low[row, 0]), int(high[row, 0])):
                keys.append(((y * across + x) << 32) | int(bits[row]))
                whose.append(row)
    ids, order = torch.sort(torch.tensor(keys, dtype=torch.int64), stable=True)
    return (high - low).prod(1)[None], ids, torch.tensor(whose, dtype=torch.int32)[order]


def offsets(ids: Tensor, n_images: int, across: int, down: int) -> Tensor:
    """`isect_offset_encode`: where each tile's Gaussians begin."""
    wanted = torch.arange(n_images * across * down) << 32
    return torch.searchsorted(ids, wanted).int().reshape(n_images, down, across)


def pixels(
    means2d: Tensor,
    conics: Tensor,
    colors: Tensor,
    opacities: Tensor,
    width: int,
    height: int,
    size: int,
    begins: Tensor,
    whose: Tensor,
) -> tuple[Tensor, Tensor]:
    """`rasterize_to_pixels` (RasterizeToPixels3DGSFwd.cu) of one image."""
    given = (means2d, conics, colors, opacities)
    assert all(tensor.dtype == torch.float32 for tensor in given)
    centre, shape, values, opacity = (tensor[0] for tensor in given)
    bounds = [*begins.reshape(-1).tolist(), len(whose)]
    _, down, across = begins.shape
    lines = []
    for y in range(down):
        parts = []
        for x in range(across):
            tile = y * across + x
            rows = whose[bounds[tile] : bounds[tile + 1]].long()
            i = torch.arange(y * size, min((y + 1) * size, height)) + 0.5
            j = torch.arange(x * size, min((x + 1) * size, width)) + 0.5
            dx = centre[rows, 0] - j[None, :, None].expand(len(i), -1, 1)
            dy = centre[rows, 1] - i[:, None, None].expand(-1, len(j), 1)
            a, b, c = shape[rows].unbind(1)
            sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
            alpha = (opacity[rows] * torch.exp(-sigma)).clamp(max=MOST)
            alpha = torch.where((sigma < 0) | (alpha < FLOOR), 0.0, alpha)
            after = torch.cumprod(1 - alpha, -1)
            before = torch.cat([torch.ones_like(after[..., :1]), after], -1)[..., :-1]
            live = (after > STOP) & (alpha > 0)
            blended = torch.where(live, alpha * before, 0.0) @ values[rows]
            left = torch.where(live, 1 - alpha, 1.0).prod(-1, keepdim=True)
            parts.append(torch.cat([blended, 1 - left], -1))
        lines.append(torch.cat(parts, 1))
    whole = torch.cat(lines, 0)[None]
    return whole[..., :-1], whole[..., -1:]


def emulated() -> Kernels:
    """What `_gsplat.kernels` gives where gsplat runs."""
    return Kernels(tiles, offsets, pixels)


@contextmanager
def running(backend: str) -> Iterator[str]:
    """The backend to ask for, with stand-ins for what an emulated one lacks."""
    if backend != EMULATED:
        yield backend
        return
    with (
        mock.patch.object(_gsplat, "kernels", emulated),
        mock.patch.object(_gsplat, "DEVICE", "cpu"),
    ):
        yield "gsplat"
