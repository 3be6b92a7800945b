"""Edited images drawn on a device straight into a training batch: color images of cameras that stand as recorded.

Nothing is copied to the host: recorded frames lie on the device from the first time they are asked for, and what the
sample's own images are made of (axes, range, normalisation) is found there as `rpaug.training.matching` finds it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float32, UInt8
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
Cameras = Mapping[str, Mapping[Any, str]]
MOST_UNSEEN = 64  # batches' images that were not yet seen to show what was recorded


@dataclass(frozen=True)
class Row:
    """One sample of a batch: its copy, and the frames it shows."""

    drawn: Drawn
    frames: Sequence[int]


class OnDevice:
    """Draws the color images of batches on one device.

    On a GPU the drawing runs beside what the device is still busy with, the step before, and waits for nothing of it:
    that a later batch shows what was recorded is looked at by the one after it.
    """

    def __init__(self, device: torch.device) -> None:
        self.drawing = Drawing(device)
        self._beside = torch.cuda.Stream(device) if device.type == "cuda" else None
        self._lines: dict[str, _Line] = {}
        self._unseen: list[tuple[Any, Tensor, str]] = []

    def cameras(self, made: Made) -> frozenset[str]:
        """Those of a copy whose frames can be drawn: recorded pixels under edits of appearance."""
        return frozenset(name for name in made.scene.episode.views if drawable(made, name))

    def rows(self, rows: Sequence[Row | None], cameras: Cameras, places: Places) -> list[int]:
        """The rows of a batch whose images are drawn here: those of copies all of whose cameras can be, and recorded
        what the batch shows pixel by pixel."""
        names = frozenset(cameras)
        return [
            n
            for n, row in enumerate(rows)
            if row is not None and names <= row.drawn.plain and _sized(row, cameras, places)
        ]

    def __call__(
        self, rows: Sequence[Row], at: Sequence[int], cameras: Cameras, places: Places
    ) -> dict[str, Tensor]:
        """What stands at the places of color images once these rows, `at` those of the batch, are edited: the images
        of the rows alone. Raises Unsupported for a batch that does not show what was recorded."""
        self._look(MOST_UNSEEN)
        sizes: dict[tuple[int, int], list[str]] = {}
        for name, keys in cameras.items():
            if "rgb" in keys:
                camera = _scene(rows[0]).cameras[name]
                sizes.setdefault((camera.width, camera.height), []).append(name)
        out = {}
        for names in sizes.values():
            shots = [
                Shot(_scene(row), name, t) for name in names for row in rows for t in row.frames
            ]
            before, after = self._drawn(shots)
            parts = zip(names, before.chunk(len(names)), after.chunk(len(names)), strict=True)
            for name, old, new in parts:
                place = cameras[name]["rgb"]
                out[place] = self._shown(old, new, _of_rows(places[place], at), place, len(rows))
        return out

    def _drawn(self, shots: Sequence[Shot]) -> tuple[Tensor, Tensor]:
        if self._beside is None:
            return self.drawing.edited(shots)
        with torch.cuda.stream(self._beside):
            found = self.drawing.edited(shots)
        now = torch.cuda.current_stream(self.drawing.device)
        now.wait_stream(self._beside)
        for images in found:
            images.record_stream(now)
        return found

    def _shown(
        self,
        before: UInt8[Tensor, "n h w 3"],
        after: UInt8[Tensor, "n h w 3"],
        value: Tensor,
        name: str,
        samples: int,
    ) -> Tensor:
        """What samples show at `name` once edited, each of them the same number of images, in order."""
        layout = Layout.of(name, value, 3)
        images = _images(value.to(before.device).float(), layout)
        if images.shape != before.shape:
            found, expected = len(images), len(before)
            raise Unsupported(f"{name}: found {found} images; expected {expected}, one a frame")
        line = self._lines.get(name)
        if line is None:
            line = self._lines[name] = _Line.told(images, before, samples)
        self._see(line.fits(images, before, samples), name)
        made = torch.where(before == after, images, after.float() * line.factor + line.offset)
        return _back(made, layout, value)

    def _see(self, fits: Bool[Tensor, ""], name: str) -> None:
        """See to it that what a batch shows was recorded, once that is known."""
        if self._beside is None:
            _refuse(fits, name)
            return
        told = torch.empty((), dtype=torch.bool, pin_memory=True)
        told.copy_(fits, non_blocking=True)
        done = torch.cuda.Event()
        done.record()
        self._unseen.append((done, told, name))

    def settle(self) -> None:
        """Raises Unsupported if any batch so far did not show what was recorded."""
        self._look(0)

    def _look(self, most: int) -> None:
        """See to what is known by now of earlier batches, and wait for those beyond `most`."""
        while self._unseen and (len(self._unseen) > most or self._unseen[0][0].query()):
            done, told, name = self._unseen.pop(0)
            done.synchronize()
            _refuse(told, name)


def _refuse(fits: Tensor, name: str) -> None:
    if not bool(fits):
        raise Unsupported(matching.strange(name))


@dataclass(frozen=True)
class _Line:
    """Factor and offset per channel that turn recorded values into those of a dataset's samples."""

    factor: Float32[Tensor, "3"]
    offset: Float32[Tensor, "3"]

    @classmethod
    def told(
        cls, images: Float32[Tensor, "n h w 3"], before: UInt8[Tensor, "n h w 3"], samples: int
    ) -> "_Line":
        """Those of `matching.scale`, for images of several samples, which share them."""
        own, theirs = (_sampled(stack, samples) for stack in (before.float(), images))
        usual = torch.tensor(matching.USUAL, device=images.device)
        factors, offsets = usual[:, 0, None, None, None], usual[:, 1, None, None, None]
        errors = ((own * factors + offsets - theirs).abs() / factors).mean((1, 2))
        lines = [
            matching.line_of(column, (own[..., channel], theirs[..., channel]))
            for channel, column in enumerate(errors.T.tolist())
        ]
        line = torch.tensor(lines, device=images.device, dtype=torch.float32)
        return cls(line[:, 0], line[:, 1])

    def fits(
        self, images: Float32[Tensor, "n h w 3"], before: UInt8[Tensor, "n h w 3"], samples: int
    ) -> Bool[Tensor, ""]:
        """Whether each sample shows what was recorded, up to coding."""
        own, theirs = (_sampled(stack, samples) for stack in (before.float(), images))
        off = (own * self.factor + self.offset - theirs).abs()
        reach = self.factor * (own.amax(1) - own.amin(1)).clamp(min=1.0)
        most = max(1, round(0.99 * off.shape[1]))
        worst = off.kthvalue(most, 1).values
        fits = (off.mean(1) <= matching.MEAN * reach) & (worst <= matching.WORST * reach)
        return fits.all()


def _of_rows(value: Tensor, at: Sequence[int]) -> Tensor:
    if len(at) == len(value):
        return value
    return value[torch.tensor(at, device=value.device)]


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


def _sized(row: Row, cameras: Cameras, places: Places) -> bool:
    """Whether a batch's images are tensors of the size that a row's cameras recorded."""
    known = _scene(row).cameras
    for name, keys in cameras.items():
        if "rgb" in keys and not _of_size(places[keys["rgb"]], keys["rgb"], known[name]):
            return False
    return True


def _of_size(value: Any, name: str, camera: Camera) -> bool:
    if not isinstance(value, torch.Tensor) or not value.numel() or value.ndim < 4:
        return False
    layout = Layout.of(name, value, 3)
    rows = layout.shape[-2:] if layout.first else layout.shape[-3:-1]
    return tuple(rows) == (camera.height, camera.width)


def _images(stack: Float32[Tensor, "..."], layout: Layout) -> Float32[Tensor, "n h w 3"]:
    channels_last = stack.movedim(-3, -1) if layout.first else stack
    return channels_last.reshape(-1, *channels_last.shape[-3:])


def _back(images: Float32[Tensor, "n h w 3"], layout: Layout, like: Tensor) -> Tensor:
    rounded = images if like.dtype.is_floating_point else images.round()
    ordered = rounded.movedim(-1, -3) if layout.first else rounded
    return ordered.reshape(like.shape).to(like.dtype).to(like.device)


def _sampled(images: Float32[Tensor, "n h w 3"], samples: int) -> Float32[Tensor, "s k 3"]:
    """Some values of each sample's images."""
    flat = images.reshape(samples, -1, 3)
    return flat[:, :: max(1, flat.shape[1] // matching.SAMPLED)]
