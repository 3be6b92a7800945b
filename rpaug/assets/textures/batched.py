"""Textures of many images' edits, read at once by torch, as `rpaug.assets.textures.mapping` reads one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64, UInt8
from torch import Tensor

from rpaug.assets.textures import mapping
from rpaug.assets.textures.mapping import Mapping, Texture

MODES: dict[Mapping, int] = {"triplanar": 0, "box": 1, "planar": 2}


@dataclass(frozen=True)
class LaidTextures:
    """Several textures, each with its scale and mapping. Their texels stand one after the other."""

    texels: UInt8[Tensor, "t 3"]
    sizes: Int64[
        Tensor, "m levels 3"
    ]  # first texel, rows, columns; the last level stands for those that lack
    levels: Int64[Tensor, "m"]
    mirror: Tensor
    scale: Float32[Tensor, "m"]
    mode: Int64[Tensor, "m"]

    @classmethod
    def of(
        cls, several: Sequence[tuple[Texture, float, Mapping]], device: torch.device
    ) -> "LaidTextures":
        """Of textures with the metres that each is wide, and how each is laid on."""
        starts: dict[int, int] = {}
        parts, total = [], 0
        most = max(len(texture.sizes) for texture, _, _ in several)
        sizes = []
        for texture, _, _ in several:
            if id(texture) not in starts:
                starts[id(texture)] = total
                parts.append(torch.from_numpy(texture.texels).to(device))
                total += len(texture.texels)
            own = np.concatenate(
                [texture.sizes, texture.sizes[-1:].repeat(most - len(texture.sizes), 0)]
            )
            sizes.append(own + np.array([starts[id(texture)], 0, 0]))
        return cls(
            torch.cat(parts),
            torch.from_numpy(np.stack(sizes).astype(np.int64)).to(device),
            torch.tensor([len(texture.sizes) for texture, _, _ in several], device=device),
            torch.tensor([texture.mirror for texture, _, _ in several], device=device),
            torch.tensor([scale for _, scale, _ in several], dtype=torch.float32, device=device),
            torch.tensor([MODES[laid] for _, _, laid in several], device=device),
        )

    def on(
        self,
        which: Int64[Tensor, "n"],
        points: Float32[Tensor, "n 3"],
        normals: Float32[Tensor, "n 3"],
        footprint: Float32[Tensor, "n"],
    ) -> Float32[Tensor, "n 3"]:
        """`Texture.on`, each point on a texture of its own."""
        mode, scale, sizes = self.mode[which], self.scale[which], self.sizes[which, 0]
        share = _shares(normals, mode)
        per_metre = sizes[:, 2] / scale
        tall = sizes[:, 2] / sizes[:, 1]
        level = torch.log2((mapping.WIDTH * footprint * per_metre).clamp(min=1.0))
        level = torch.minimum(level, self.levels[which] - 1.0)
        out = torch.zeros_like(points)
        for axis in range(3):
            u, v = _plane(points, normals, axis, mode == MODES["planar"])
            found = self._sample(which, u / scale, -v / scale * tall, level)
            out = out + share[:, axis, None] * found
        return out

    def _sample(
        self, which: Int64[Tensor, "n"], u: Tensor, v: Tensor, level: Tensor
    ) -> Float32[Tensor, "n 3"]:
        """Trilinear, as `mapping._sample`."""
        mirror = self.mirror[which]
        low = level.long()
        u, v = _repeat(u, mirror), _repeat(v, mirror)
        out = torch.zeros(len(which), 3, device=which.device)
        for step in range(2):
            weight = (level - low) if step else 1 - (level - low)
            here = (low + step).clamp(max=self.sizes.shape[1] - 1)
            start, rows, columns = self.sizes[which, here].unbind(1)
            x, y = u * columns - 0.5, v * rows - 0.5
            left, top = torch.floor(x), torch.floor(y)
            right_part, lower_part = x - left, y - top
            for j in range(2):
                row = start + _inside(top.long() + j, rows, mirror) * columns
                down = weight * (lower_part if j else 1 - lower_part)
                for i in range(2):
                    part = down * (right_part if i else 1 - right_part)
                    texel = row + _inside(left.long() + i, columns, mirror)
                    out = out + part[:, None] * self.texels[texel]
        return out / 255.0


def _shares(normals: Float32[Tensor, "n 3"], mode: Int64[Tensor, "n"]) -> Float32[Tensor, "n 3"]:
    """How much each axis' picture counts."""
    share = normals.abs() ** mapping.SHARPNESS
    share = share / share.sum(1, keepdim=True)
    share = torch.where(share < mapping.FAINT, 0.0, share)
    share = share / share.sum(1, keepdim=True)
    upmost = torch.nn.functional.one_hot(normals.abs().argmax(1), 3).to(share.dtype)
    share = torch.where((mode == MODES["box"])[:, None], upmost, share)
    above = torch.tensor([0.0, 0.0, 1.0], device=share.device)
    return torch.where((mode == MODES["planar"])[:, None], above, share)


def _plane(
    points: Float32[Tensor, "n 3"], normals: Float32[Tensor, "n 3"], axis: int, along: Tensor
) -> tuple[Tensor, Tensor]:
    """`mapping._plane`."""
    turned = (normals[:, axis] < 0) & ~along
    x, y, z = points.unbind(1)
    right, up = ((y, z), (-x, z), (x, y))[axis]
    return torch.where(turned, -right, right), up


def _repeat(value: Tensor, mirror: Tensor) -> Tensor:
    """`mapping._repeat`."""
    once = value - torch.floor(value)
    twice = value - 2 * torch.floor(value / 2)
    return torch.where(mirror, torch.where(twice > 1, 2 - twice, twice), once)


def _inside(index: Tensor, size: Tensor, mirror: Tensor) -> Tensor:
    """`mapping._inside`."""
    before = torch.where(mirror, 0, size - 1)
    after = torch.where(mirror, size - 1, 0)
    return torch.where(index < 0, before, torch.where(index >= size, after, index))
