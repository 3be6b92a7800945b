"""Frames of cameras that stand as recorded, many at once on a device: recorded pixels under appearance edits.

What the recording alone says of an image (its pixels, ids, where they lie, what light they have) is kept on the device
for the copies and epochs that follow, up to a limit.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from threading import Lock, RLock
from typing import Generic, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int32, UInt8
from torch import Tensor

from rpaug.core import devices
from rpaug.core.errors import SourceLacks
from rpaug.core.types import Appearance, Episode, Scene
from rpaug.render.batched import composite
from rpaug.render.batched.pixels import Pixels
from rpaug.scene.lighting import highlights, intrinsic
from rpaug.scene.recorded import batched, pooled, surface
from rpaug.scene.recorded.batched import Lifted, Moved, PlacedPixels, Places
from rpaug.scene.recorded.surface import Light, Shine

KEPT_BYTES = 2 * 2**30  # of recorded images on the CPU;
KEPT_SHARE = 1 / 8  # of a GPU's memory
AT_ONCE = 1 << 22  # pixels of one camera drawn together
Made = TypeVar("Made")


@dataclass(frozen=True)
class Shot:
    """One image to draw: what the scene shows in a camera at a time."""

    scene: Scene
    camera: str
    t: int


def drawable(scene: Scene, camera: str) -> bool:
    """Whether a camera's frames, recorded pixels under appearance edits, can be drawn many at once."""
    view = scene.episode.views[camera]
    told = view.ids is not None and view.depth is not None and view.radiance is None
    return told and view.proxy is None and editable(scene)


def editable(scene: Scene) -> bool:
    """Whether a scene's edits of appearance can be made in many images at once."""
    return all(map(composite.stacks, scene.appearance))


class Recorded:
    """One image on a device, as recorded or over a base, and what is known of it when an edit asks for it."""

    def __init__(self, shot: Shot, device: torch.device, base: "Base | None" = None) -> None:
        self._shot, self._device, self._base = shot, device, base
        self._view = shot.scene.episode.views[shot.camera]

    @cached_property
    def rgb(self) -> UInt8[Tensor, "1 h w 3"]:
        return self._held(self._view.rgb(self._shot.t) if self._base is None else self._base.rgb)

    @cached_property
    def ids(self) -> Int32[Tensor, "1 h w"]:
        if self._base is not None:
            return self._held(self._base.ids)
        assert self._view.ids is not None
        return self._held(self._view.ids(self._shot.t))

    @cached_property
    def lifted(self) -> Lifted:
        """Raises SourceLacks without depth."""
        t, name = self._shot.t, self._shot.camera
        camera = self._shot.scene.cameras[name]
        depth = surface.depth_of(self._view, t) if self._base is None else self._base.depth
        if depth is None:
            raise SourceLacks("this edit needs recorded depth, and this source has none")
        stands = camera is self._view.camera
        pool = pooled.of_camera(self._shot.scene.episode, name) if stands else None
        pose = camera.cam_to_world[t][None]
        return batched.lift(self._held(depth), self.ids, camera.K, pose, pool)

    @cached_property
    def lit(self) -> Float32[Tensor, "1 h w"]:
        if self._base is None:
            share = intrinsic.share(self._shot.scene, self._shot.camera, self._shot.t)
        else:
            share = self._base.light() if self._base.light else None
        ones = torch.ones(self.ids.shape, device=self._device)
        return ones if share is None else self._held(share)

    @cached_property
    def mirrored(self) -> Float32[Tensor, "1 h w 3"] | None:
        if self._base is None:
            shine = highlights.seen_by(self._shot.scene, self._view, self._shot.t)
        else:
            shine = self._base.shine() if self._base.shine else None
        if shine is None:
            return None
        points, facing = (
            part.cpu().numpy().reshape(-1, 3) for part in (self.lifted.points, self.lifted.facing)
        )
        found = shine(points, facing, self.ids.cpu().numpy().ravel())
        return None if found is None else self._held(found.reshape(*self.ids.shape[1:], 3))

    @property
    def bytes(self) -> int:
        """How much the device holds of it, about."""
        return self.ids.numel() * (3 + 4 + 4 * (3 + 3 + 1 + 1 + 3))

    def _held(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(np.require(array, requirements=["C", "W"]), device=self._device)[
            None
        ]


@dataclass(frozen=True)
class Base:
    """An image before edits of appearance: what was recorded or drawn anew, where it lies, and its light and
    highlights as surfaces have them (`rpaug.scene.recorded.surface.of_image`)."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    light: Light = None
    shine: Shine = None


class Drawing:
    """Draws images on one device."""

    def __init__(self, device: torch.device, kept_bytes: int | None = None) -> None:
        self.device, self._most = device, kept_bytes or _most(device)
        self._held: OrderedDict[tuple[Episode, str, int], Recorded] = OrderedDict()
        self._lock = RLock()

    def __call__(self, shots: Sequence[Shot]) -> UInt8[Tensor, "n h w 3"]:
        """The images, all of one size, of cameras whose frames are `drawable`."""
        return self._drawn(shots, [self.recorded(shot) for shot in shots])

    def over(self, shots: Sequence[Shot], bases: Sequence[Base]) -> UInt8[Tensor, "n h w 3"]:
        """The images of one camera over what stands in for the recorded ones."""
        images = [
            Recorded(shot, self.device, base) for shot, base in zip(shots, bases, strict=True)
        ]
        return self._drawn(shots, images)

    def recorded(self, shot: Shot) -> "Recorded":
        """What was recorded there, kept for those who ask again."""
        asked = shot.scene.episode, shot.camera, shot.t
        with self._lock:
            if asked not in self._held:
                self._held[asked] = Recorded(shot, self.device)
            self._held.move_to_end(asked)
            image = self._held[asked]
            while len(self._held) > 1 and len(self._held) * image.bytes > self._most:
                self._held.popitem(last=False)
        return image

    def _drawn(
        self, shots: Sequence[Shot], images: Sequence["Recorded"]
    ) -> UInt8[Tensor, "n h w 3"]:
        places = Places(
            torch.cat([one.ids for one in images]),
            cache(lambda: Lifted.joined([one.lifted for one in images])),
            cache(lambda: Moved.of([_moved(shot) for shot in shots], self.device)),
            cache(lambda: torch.cat([one.lit for one in images])),
            cache(lambda: _mirrored(images)),
        )

        def surfaces(at: Pixels) -> PlacedPixels:
            return PlacedPixels(at, places)

        edits: list[Sequence[Appearance]] = [shot.scene.appearance for shot in shots]
        mixes = [shot.scene.antialiased for shot in shots]
        rgb = torch.cat([one.rgb for one in images])
        return composite.composite(rgb, places.ids, edits, mixes, surfaces)


@cache
def drawing(device: str) -> Drawing:
    """The one that this process draws with on a device, by its name. Raises Unsupported for one that is not there."""
    return Drawing(devices.torch_device(device))


class Ahead(Generic[Made]):
    """Frames of one camera, drawn several at once as they are asked for one after the other."""

    def __init__(
        self, draw: Callable[[Sequence[int]], Iterable[Made]], length: int, pixels: int
    ) -> None:
        self._draw, self._length = draw, length
        self._count = max(1, AT_ONCE // pixels)
        self._held: dict[int, Made] = {}
        self._lock = Lock()

    def __call__(self, t: int) -> Made:
        """The frame at one time."""
        with self._lock:
            if t not in self._held:
                times = range(t, min(t + self._count, self._length))
                self._held = dict(zip(times, self._draw(times), strict=True))
            return self._held[t]


def ahead(scene: Scene, name: str, device: str) -> Ahead[UInt8[np.ndarray, "h w 3"]]:
    """A camera's recorded images under edits of appearance."""

    def draw(times: Sequence[int]) -> Iterable[UInt8[np.ndarray, "h w 3"]]:
        return drawing(device)([Shot(scene, name, t) for t in times]).cpu().numpy()

    return _ahead(scene, name, draw)


Over = tuple[UInt8[np.ndarray, "h w 3"], Base, Bool[np.ndarray, "h w"]]
"""An image, what it was drawn over, and its holes."""


def ahead_over(
    scene: Scene, name: str, device: str, bases: Callable[[int], tuple[Base, np.ndarray]]
) -> Ahead[Over]:
    """A camera's images over what stands in for the recorded ones, each with its base."""

    def draw(times: Sequence[int]) -> Iterable[Over]:
        found = [bases(t) for t in times]
        shots = [Shot(scene, name, t) for t in times]
        images = drawing(device).over(shots, [base for base, _ in found]).cpu().numpy()
        return [(image, *one) for image, one in zip(images, found, strict=True)]

    return _ahead(scene, name, draw)


def _ahead(scene: Scene, name: str, draw: Callable[[Sequence[int]], Iterable[Made]]) -> Ahead[Made]:
    camera = scene.cameras[name]
    return Ahead(draw, scene.episode.length, camera.width * camera.height)


def _most(device: torch.device) -> int:
    if device.type == "cpu":
        return KEPT_BYTES
    return int(KEPT_SHARE * torch.cuda.get_device_properties(device).total_memory)


def _moved(shot: Shot) -> list[tuple[int, np.ndarray]]:
    return surface.moved(shot.scene.bodies, shot.t)


def _mirrored(images: Sequence[Recorded]) -> Float32[Tensor, "n h w 3"] | None:
    """Highlights of all images; NaN in those that tell of none, None where no image tells of any."""
    found = [one.mirrored for one in images]
    if all(one is None for one in found):
        return None
    return torch.cat(
        [
            torch.full_like(image.lifted.points, torch.nan) if one is None else one
            for image, one in zip(images, found, strict=True)
        ]
    )
