"""Edited images drawn on a device straight into a training batch: color images of cameras that stand as recorded.

Nothing is copied to the host: recorded frames lie on the device from the first time they are asked for, and what the
sample's own images are made of (axes, range, normalisation) is found there as `rpaug.training.matching` finds it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import torch
from jaxtyping import Float32, UInt8
from torch import Tensor

from rpaug.compose import batched, inserted
from rpaug.compose.batched import Drawing, Shot
from rpaug.core.errors import Unsupported
from rpaug.core.types import Camera, Scene
from rpaug.pipeline.copies import Made
from rpaug.training import matching
from rpaug.training.drawing import Drawn
from rpaug.training.matching import Layout

Places = Mapping[str, Any]


@dataclass(frozen=True)
class Row:
    """One sample of a batch: its copy, the frames it shows, and what stands at its places."""

    drawn: Drawn
    frames: Sequence[int]
    places: Places


class OnDevice:
    """Draws the color images of batches on one device."""

    def __init__(self, device: torch.device) -> None:
        self.drawing = Drawing(device)

    def light(self, drawn: Drawn) -> bool:
        """Whether a copy keeps no images of its own."""
        made = drawn.made
        return made is None or all(drawable(made, name) for name in made.scene.episode.views)

    def __call__(
        self, rows: Sequence[Row | None], cameras: Mapping[str, Mapping[Any, str]]
    ) -> list[dict[str, Any] | None]:
        """What stands at each row's places once it is edited; None for a row whose frames are drawn on the host."""
        due = {n: row for n, row in enumerate(rows) if row and self._serves(row, cameras)}
        out = [dict(row.places) if row and n in due else None for n, row in enumerate(rows)]
        sizes: dict[tuple[int, int], list[str]] = {}
        for name, keys in cameras.items():
            if due and "rgb" in keys:
                camera = _scene(next(iter(due.values()))).cameras[name]
                sizes.setdefault((camera.width, camera.height), []).append(name)
        for names in sizes.values():
            shots = [
                [Shot(_scene(row), name, t) for row in due.values() for t in row.frames]
                for name in names
            ]
            drawn = self.drawing(list(chain(*shots))).chunk(len(names))
            for name, own, after in zip(names, shots, drawn, strict=True):
                place = cameras[name]["rgb"]
                values = [row.places[place] for row in due.values()]
                before = torch.cat([self.drawing.recorded(shot).rgb for shot in own])
                for n, value in zip(due, _shown(before, after, values, place), strict=True):
                    out[n][place] = value  # type: ignore[index]
        return out

    def _serves(self, row: Row, cameras: Mapping[str, Mapping[Any, str]]) -> bool:
        """Whether a row's images are tensors of the recorded size, and its copy can be drawn."""
        made = row.drawn.made
        if made is None:
            return False
        for name, keys in cameras.items():
            if name not in made.scene.cameras or not drawable(made, name):
                return False
            camera, value = made.scene.cameras[name], row.places[keys.get("rgb", "")]
            if "rgb" in keys and not _sized(value, keys["rgb"], camera):
                return False
        return True


def drawable(made: Made, camera: str) -> bool:
    """Whether a copy's frames of a camera can be drawn on a device: recorded pixels under edits of appearance."""
    scene = made.scene
    return (
        made.plan.representations[camera] == 0
        and scene.back is None
        and not scene.sensor
        and not inserted.bodies(scene)
        and batched.drawable(scene, camera)
    )


def _scene(row: Row) -> Scene:
    assert row.drawn.made is not None
    return row.drawn.made.scene


def _sized(value: Any, name: str, camera: Camera) -> bool:
    if not isinstance(value, torch.Tensor) or not value.numel():
        return False
    layout = Layout.of(name, value, 3)
    rows = layout.shape[-2:] if layout.first else layout.shape[-3:-1]
    return tuple(rows) == (camera.height, camera.width)


def _shown(
    before: UInt8[Tensor, "n h w 3"],
    after: UInt8[Tensor, "n h w 3"],
    values: Sequence[Tensor],
    name: str,
) -> list[Tensor]:
    """What samples show at `name` once edited, each of them the same number of images, in order. Raises Unsupported."""
    layout = Layout.of(name, values[0], 3)
    images = _images(torch.stack([value.to(before.device) for value in values]).float(), layout)
    if images.shape != before.shape:
        found, expected = len(images), len(before)
        raise Unsupported(f"{name}: found {found} images; expected {expected}, one a frame")
    factor, offset = _scale(name, images, before, len(values))
    made = torch.where(before == after, images, after.float() * factor + offset)
    return [
        _back(one, layout, value)
        for one, value in zip(made.chunk(len(values)), values, strict=True)
    ]


def _images(stack: Float32[Tensor, "..."], layout: Layout) -> Float32[Tensor, "n h w 3"]:
    channels_last = stack.movedim(-3, -1) if layout.first else stack
    return channels_last.reshape(-1, *channels_last.shape[-3:])


def _back(images: Float32[Tensor, "n h w 3"], layout: Layout, like: Tensor) -> Tensor:
    rounded = images if like.dtype.is_floating_point else images.round()
    ordered = rounded.movedim(-1, -3) if layout.first else rounded
    return ordered.reshape(like.shape).to(like.dtype).to(like.device)


def _scale(
    name: str, images: Float32[Tensor, "n h w 3"], before: UInt8[Tensor, "n h w 3"], samples: int
) -> tuple[Float32[Tensor, "3"], Float32[Tensor, "3"]]:
    """`matching.scale` for images of several samples of one dataset, which share it; each sample is judged alone."""
    own, theirs = (_sampled(stack, samples) for stack in (before.float(), images))
    usual = torch.tensor(matching.USUAL, device=images.device)
    factors, offsets = usual[:, 0, None, None, None], usual[:, 1, None, None, None]
    errors = ((own * factors + offsets - theirs).abs() / factors).mean((1, 2))
    lines = [
        matching.line_of(column, (own[..., channel], theirs[..., channel]))
        for channel, column in enumerate(errors.T.tolist())
    ]
    line = torch.tensor(lines, device=images.device, dtype=torch.float32)
    factor, offset = line[:, 0], line[:, 1]
    off = (own * factor + offset - theirs).abs()
    reach = factor * (own.amax(1) - own.amin(1)).clamp(min=1.0)
    most = max(1, round(0.99 * off.shape[1]))
    fits = (off.mean(1) <= matching.MEAN * reach) & (
        off.kthvalue(most, 1).values <= matching.WORST * reach
    )
    if not bool(fits.all()):
        raise Unsupported(matching.strange(name))
    return factor, offset


def _sampled(images: Float32[Tensor, "n h w 3"], samples: int) -> Float32[Tensor, "s k 3"]:
    """Some values of each sample's images."""
    flat = images.reshape(samples, -1, 3)
    return flat[:, :: max(1, flat.shape[1] // matching.SAMPLED)]
