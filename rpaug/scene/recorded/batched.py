"""Where pixels of many images lie, by torch, as `rpaug.scene.recorded.surface` tells it for those of one.

Whole images are lifted, so that an image that is shown in copy after copy is lifted once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int32
from torch import Tensor

from rpaug.core import geometry
from rpaug.render.batched.pixels import Pixels
from rpaug.scene.recorded import surface
from rpaug.scene.recorded.pooled import AROUND, Pool


@dataclass(frozen=True)
class Lifted:
    """Where each pixel of some images lies in the world, as `surface.lift` gives it."""

    points: Float32[Tensor, "n h w 3"]
    facing: Float32[Tensor, "n h w 3"]
    footprint: Float32[Tensor, "n h w"]

    @classmethod
    def joined(cls, several: Sequence["Lifted"]) -> "Lifted":
        """All their images, one after the other."""
        parts = ([getattr(one, field.name) for one in several] for field in fields(cls))
        return cls(*map(torch.cat, parts))


@dataclass(frozen=True)
class Moved:
    """What of each image is not where its body's own frame is: instance ids, and the way back into that frame."""

    ids: Int32[Tensor, "n k"]
    back: Float32[Tensor, "n k 4 4"]

    NOTHING = -(2**31)

    @classmethod
    def of(
        cls,
        images: Sequence[Sequence[tuple[int, Float64[np.ndarray, "4 4"]]]],
        device: torch.device,
    ) -> "Moved":
        """Of instance ids and poses in the world, for each image."""
        most = max(map(len, images), default=0)
        ids = np.full((len(images), most), cls.NOTHING, np.int32)
        back = np.tile(np.eye(4, dtype=np.float32), (len(images), most, 1, 1))
        for n, moved in enumerate(images):
            for k, (instance_id, pose) in enumerate(moved):
                ids[n, k], back[n, k] = instance_id, geometry.inverse(pose)
        return cls(torch.from_numpy(ids).to(device), torch.from_numpy(back).to(device))


@dataclass(frozen=True)
class Places:
    """What tells where the pixels of some images lie, each worked out when an edit asks for it. `lit` and `mirrored`
    are those of `rpaug.core.types.Surface`, of whole images."""

    ids: Int32[Tensor, "n h w"]
    lifted: Callable[[], Lifted]
    moved: Callable[[], Moved]
    lit: Callable[[], Float32[Tensor, "n h w"]]
    mirrored: Callable[[], Float32[Tensor, "n h w 3"] | None]


@dataclass(frozen=True)
class PlacedPixels:
    """Pixels of images as surfaces (`rpaug.core.types.Surface`), of tensors."""

    at: Pixels
    places: Places

    @property
    def ids(self) -> Int32[Tensor, "p"]:
        return self.at.of(self.places.ids)

    @property
    def points(self) -> Float32[Tensor, "p 3"]:
        return self._in_bodies[0]

    @property
    def normals(self) -> Float32[Tensor, "p 3"]:
        return self._in_bodies[1]

    @property
    def facing(self) -> Float32[Tensor, "p 3"]:
        return self.at.of(self.places.lifted().facing)

    @property
    def footprint(self) -> Float32[Tensor, "p"]:
        return self.at.of(self.places.lifted().footprint)

    @property
    def lit(self) -> Float32[Tensor, "p"]:
        return self.at.of(self.places.lit())

    @property
    def mirrored(self) -> Float32[Tensor, "p 3"] | None:
        mirrored = self.places.mirrored()
        return None if mirrored is None else self.at.of(mirrored)

    @cached_property
    def _in_bodies(self) -> tuple[Float32[Tensor, "p 3"], Float32[Tensor, "p 3"]]:
        points, normals = self.at.of(self.places.lifted().points), self.facing
        moved = self.places.moved()
        if not moved.ids.shape[1]:
            return points, normals
        own = self.ids[:, None] == moved.ids[self.at.image]
        back = moved.back[self.at.image, own.to(torch.uint8).argmax(1)]
        turn, held = back[:, :3, :3], own.any(1)[:, None]
        there = (turn @ points[:, :, None])[:, :, 0] + back[:, :3, 3]
        turned = (turn @ normals[:, :, None])[:, :, 0]
        return torch.where(held, there, points), torch.where(held, turned, normals)


def lift(
    depth: Float32[Tensor, "n h w"],
    ids: Int32[Tensor, "n h w"],
    K: Float64[np.ndarray, "3 3"],
    poses: Float64[np.ndarray, "n 4 4"],
    pool: Pool | None = None,
) -> Lifted:
    """`surface.lift` of all pixels of images of one camera: points, unit normals towards it, footprints in metres."""
    depth = torch.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0)
    around = _around(depth, ids)
    if pool is not None and pool.ids.shape[-1]:
        around = _pooled(around, depth, ids, pool)
    near = torch.where(around > 0, 1.0 / around.double(), 0.0)
    z = around[..., 0].clamp(min=0).double()
    rows = torch.arange(depth.shape[1], device=depth.device, dtype=torch.float64)[:, None]
    columns = torch.arange(depth.shape[2], device=depth.device, dtype=torch.float64)
    x = ((columns - K[0, 2]) / K[0, 0]).expand_as(z)
    y = ((rows - K[1, 2]) / K[1, 1]).expand_as(z)
    across, known_across = _slope(near[..., 0], near[..., 1:5], K[0, 0])
    down, known_down = _slope(near[..., 0], near[..., 5:9], K[1, 1])
    a, b = across * K[0, 0], down * K[1, 1]
    d = near[..., 0] - a * x - b * y
    told = known_across & known_down
    a, b, d = (torch.where(told, one, plain) for one, plain in ((a, x), (b, y), (d, 1.0)))
    length = torch.sqrt(a * a + b * b + d * d)
    cosine = (a * x + b * y + d) / (length * torch.sqrt(x * x + y * y + 1.0))
    flip = torch.where(cosine > 0, -1.0, 1.0) / length
    pose = torch.from_numpy(poses).to(depth.device)
    turn, place = pose[:, None, None, :3, :3], pose[:, None, None, :3, 3]
    ray = torch.stack([x, y, torch.ones_like(x)], -1)
    normal = torch.stack([a, b, d], -1) * flip[..., None]
    points = place + z[..., None] * (turn @ ray[..., None])[..., 0]
    normals = (turn @ normal[..., None])[..., 0]
    focal = float(np.sqrt(abs(K[0, 0] * K[1, 1])))
    footprint = z / focal / torch.sqrt(cosine.abs().clamp(min=surface.GRAZING))
    return Lifted(points.float(), normals.float(), footprint.float())


def _around(
    depth: Float32[Tensor, "n h w"], ids: Int32[Tensor, "n h w"]
) -> Float32[Tensor, "n h w around"]:
    """`pooled.gather` of every pixel."""
    out = depth.new_zeros(*depth.shape, AROUND)
    out[..., 0] = depth
    for axis in range(2):
        for side in range(2):
            for step in range(2):
                away = (step + 1) * (2 * side - 1)
                here = out[..., 1 + 4 * axis + 2 * side + step]
                _beside(depth, ids, 2 - axis, away, here)
    return out


def _beside(
    depth: Float32[Tensor, "n h w"],
    ids: Int32[Tensor, "n h w"],
    axis: int,
    away: int,
    out: Float32[Tensor, "n h w"],
) -> None:
    """Depths of the same thing so many pixels along an axis, 0 where there are none."""
    size = depth.shape[axis] - abs(away)
    if size <= 0:
        return
    mine, theirs = max(0, -away), max(0, away)
    same = ids.narrow(axis, mine, size) == ids.narrow(axis, theirs, size)
    beside = depth.narrow(axis, theirs, size)
    out.narrow(axis, mine, size).copy_(torch.where(same & (beside > 0), beside, 0.0))


def _pooled(
    around: Float32[Tensor, "n h w around"],
    depth: Float32[Tensor, "n h w"],
    ids: Int32[Tensor, "n h w"],
    pool: Pool,
) -> Float32[Tensor, "n h w around"]:
    """What the pool holds of a pixel's place in the stead of what its image shows around it."""
    names = torch.from_numpy(pool.ids).to(depth.device)
    depths = torch.from_numpy(pool.depths).to(depth.device)
    known = depths[..., 0]
    off = (known - depth[..., None]).abs()
    same = (known > 0) & (names == ids[..., None]) & (off <= pool.tolerance * depth[..., None])
    slot = same.to(torch.uint8).argmax(-1)
    held = depths.expand(len(depth), *depths.shape)
    chosen = held.gather(3, slot[..., None, None].expand(*slot.shape, 1, AROUND))[..., 0, :]
    return torch.where(same.any(-1)[..., None], chosen, around)


def _slope(
    here: Float[Tensor, "n h w"], beside: Float[Tensor, "n h w 4"], focal: float
) -> tuple[Float[Tensor, "n h w"], Tensor]:
    """`surface._slope` of every pixel: change of 1/z along an axis, and whether anything tells it."""
    steps, bends, told = [], [], []
    for side in range(2):
        one, two = beside[..., 2 * side], beside[..., 2 * side + 1]
        valid = (one != 0) & (here != 0)
        step = one - here
        bend = torch.where(two == 0, surface.LONE * step.abs(), (two - here - 2 * step).abs())
        steps.append(step * (2 * side - 1))
        bends.append(torch.where(valid, bend, torch.inf))
        told.append(valid)
    best = torch.where(bends[1] < bends[0], steps[1], steps[0])
    smooth = surface.SMOOTH * here / focal
    both = told[0] & told[1] & ((steps[0] - steps[1]).abs() < smooth)
    found = told[0] | told[1]
    best = torch.where(both, (steps[0] + steps[1]) / 2, best)
    return torch.where(found, best, 0.0), found
