"""Frames of cameras that stand as recorded, many at once on a device: recorded pixels under appearance edits.

What the recording alone says of an image (its pixels, ids, where they lie, what light they have) is kept on the device
for the copies and epochs that follow, up to a limit.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from threading import Lock, RLock
from typing import Generic, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int32, UInt8
from torch import Tensor

from rpaug.core import devices
from rpaug.core.ahead import in_order
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
KEPT_FRAMES = 16  # of those of single runs
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
    return told and view.proxy is None and scene.relit is None and editable(scene)


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
        return self.held(self.decoded("rgb") if self._base is None else self._base.rgb)

    @cached_property
    def ids(self) -> Int32[Tensor, "1 h w"]:
        return self.held(self.decoded("ids") if self._base is None else self._base.ids)

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
        return batched.lift(self.held(depth), self.ids, camera.K, pose, pool)

    @cached_property
    def lit(self) -> Float32[Tensor, "1 h w"]:
        if self._base is None:
            share = intrinsic.share(self._shot.scene, self._shot.camera, self._shot.t)
        else:
            share = self._base.light() if self._base.light else None
        ones = torch.ones(self.ids.shape, device=self._device)
        return ones if share is None else self.held(share)

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
        return None if found is None else self.held(found.reshape(*self.ids.shape[1:], 3))

    def part(self, name: str) -> list[Tensor | None]:
        """One of `PARTS`."""
        if name == "lifted":
            return [getattr(self.lifted, one) for one in PARTS[name]]
        return [getattr(self, name)]

    def decoded(self, name: str) -> np.ndarray:
        """The recorded image (rgb) or its instance ids (ids), on the host."""
        read = self._view.rgb if name == "rgb" else self._view.ids
        assert read is not None
        return read(self._shot.t)

    def held(self, array: np.ndarray) -> Tensor:
        """An array of one image on the device."""
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


PARTS = {
    "rgb": ("rgb",),
    "ids": ("ids",),
    "lifted": ("points", "facing", "footprint"),
    "lit": ("lit",),
    "mirrored": ("mirrored",),
}
BYTES = 3 + 4 + 4 * (3 + 3 + 1 + 1 + 3)  # of a pixel of which all is known


class Kept:
    """Recorded images of one size, kept on a device in slots: what is known of them, each part as one stack."""

    def __init__(self, device: torch.device, most: int) -> None:
        self._device, self._most = device, most
        self._slots: OrderedDict[tuple[Episode, str, int], int] = OrderedDict()
        self._stacks: dict[str, Tensor] = {}
        self._known: dict[str, set[int]] = {part: set() for part in PARTS}
        self._dull: set[int] = set()  # slots of images without highlights

    def __len__(self) -> int:
        return len(self._slots)

    def slots(self, shots: Sequence[Shot]) -> list[int]:
        """A slot for each image, those that were asked for longest ago giving way. Held for the next call too."""
        most = max(self._most, len(shots))
        out = []
        for shot in shots:
            key = shot.scene.episode, shot.camera, shot.t
            if key not in self._slots:
                self._slots[key] = self._free(most)
            self._slots.move_to_end(key)
            out.append(self._slots[key])
        return out

    def _free(self, most: int) -> int:
        if len(self._slots) < most:
            return len(self._slots)
        _, slot = self._slots.popitem(last=False)
        for known in (*self._known.values(), self._dull):
            known.discard(slot)
        return slot

    def part(self, name: str, shots: Sequence[Shot], slots: Sequence[int]) -> list[Tensor]:
        """The stacks of one of `PARTS`, of images that have slots. None of the highlights of images without any."""
        known = self._known[name]
        new = {slot: shot for shot, slot in zip(shots, slots, strict=True) if slot not in known}
        images = {slot: Recorded(shot, self._device) for slot, shot in new.items()}
        if name in ("rgb", "ids"):  # files are read by several threads, the device is this one's
            decoded = in_order(partial(image.decoded, name) for image in images.values())
            for image, array in zip(images.values(), decoded, strict=True):
                setattr(image, name, image.held(array))
        for slot, image in images.items():
            self._fill(name, image, slot)
            known.add(slot)
        if name == "mirrored" and self._dull.issuperset(slots):
            return []
        index = torch.tensor(slots, device=self._device)
        return [self._stacks[one][index] for one in PARTS[name]]

    def _fill(self, name: str, image: Recorded, slot: int) -> None:
        if name != "ids" and slot in self._known["ids"]:
            image.ids = self._stacks["ids"][slot : slot + 1]
        if name == "mirrored" and slot in self._known["lifted"]:
            image.lifted = Lifted(*(self._stacks[one][slot : slot + 1] for one in PARTS["lifted"]))
        for one, made in zip(PARTS[name], image.part(name), strict=True):
            if made is None:
                self._dull.add(slot)
                continue
            self._stack(one, made)[slot] = made[0]

    def _stack(self, name: str, like: Tensor) -> Tensor:
        """Room for all slots; what has no highlights tells nothing of them."""
        old = self._stacks.get(name)
        if old is None or len(old) < len(self._slots):
            size = max(16, 2 * len(self._slots)) if old is not None else max(16, len(self._slots))
            fill = torch.nan if name == "mirrored" else 0
            new = torch.full((min(size, max(self._most, len(self._slots))), *like.shape[1:]), fill,
                             dtype=like.dtype, device=self._device)  # fmt: skip
            if old is not None:
                new[: len(old)] = old
            self._stacks[name] = new
        return self._stacks[name]


class Drawing:
    """Draws images on one device."""

    def __init__(self, device: torch.device, kept_bytes: int | None = None) -> None:
        self.device, self._most = device, kept_bytes or _most(device)
        self.kept: dict[tuple[int, int], Kept] = {}
        self._lock = RLock()

    def __call__(self, shots: Sequence[Shot]) -> UInt8[Tensor, "n h w 3"]:
        """The images, all of one size, of cameras whose frames are `drawable`."""
        return self.edited(shots)[1]

    def edited(
        self, shots: Sequence[Shot]
    ) -> tuple[UInt8[Tensor, "n h w 3"], UInt8[Tensor, "n h w 3"]]:
        """Such images as they were recorded, and as they are drawn."""
        camera = shots[0].scene.cameras[shots[0].camera]
        size = camera.height, camera.width
        with self._lock:
            if size not in self.kept:
                self.kept[size] = Kept(self.device, self._most // (BYTES * size[0] * size[1]))
            kept = self.kept[size]
            slots = kept.slots(shots)

            def part(name: str) -> list[Tensor]:
                return kept.part(name, shots, slots)

            (rgb,), (ids,) = part("rgb"), part("ids")
            return rgb, self._drawn(shots, rgb, ids, part)

    def over(self, shots: Sequence[Shot], bases: Sequence[Base]) -> UInt8[Tensor, "n h w 3"]:
        """The images of one camera over what stands in for the recorded ones."""
        images = [
            Recorded(shot, self.device, base) for shot, base in zip(shots, bases, strict=True)
        ]

        def part(name: str) -> list[Tensor]:
            found = list(zip(*(one.part(name) for one in images), strict=True))
            if name != "mirrored":
                return [torch.cat(one) for one in found]
            return _highlights(found[0], images)

        (rgb,), (ids,) = part("rgb"), part("ids")
        return self._drawn(shots, rgb, ids, part)

    def _drawn(
        self,
        shots: Sequence[Shot],
        rgb: UInt8[Tensor, "n h w 3"],
        ids: Int32[Tensor, "n h w"],
        part: Callable[[str], list[Tensor]],
    ) -> UInt8[Tensor, "n h w 3"]:
        def moved() -> Moved:
            every = [surface.moved(shot.scene.bodies, shot.t) for shot in shots]
            return Moved.of(every, self.device)

        places = Places(
            ids,
            cache(lambda: Lifted(*part("lifted"))),
            cache(moved),
            cache(lambda: part("lit")[0]),
            cache(lambda: next(iter(part("mirrored")), None)),
        )

        def surfaces(at: Pixels) -> PlacedPixels:
            return PlacedPixels(at, places)

        edits: list[Sequence[Appearance]] = [shot.scene.appearance for shot in shots]
        mixes = [shot.scene.antialiased for shot in shots]
        return composite.composite(rgb, ids, edits, mixes, surfaces)


def _highlights(found: Sequence[Tensor | None], images: Sequence["Recorded"]) -> list[Tensor]:
    """Those of all images, NaN in those that tell of none; nothing where no image tells of any."""
    if all(one is None for one in found):
        return []
    blank = (torch.full_like(image.lifted.points, torch.nan) for image in images)
    return [torch.cat([b if one is None else one for one, b in zip(found, blank, strict=True)])]


@cache
def drawing(device: str) -> Drawing:
    """The one that this process draws with on a device, by its name. Raises Unsupported for one that is not there."""
    return Drawing(devices.torch_device(device))


class Ahead(Generic[Made]):
    """Frames of one camera, drawn several at once; the runs of the latest are kept, since threads ask by turns."""

    def __init__(
        self, draw: Callable[[Sequence[int]], Iterable[Made]], length: int, pixels: int
    ) -> None:
        self._draw, self._length = draw, length
        self._count = max(1, AT_ONCE // pixels)
        self._held: OrderedDict[int, list[Made]] = OrderedDict()
        self._lock = Lock()

    def __call__(self, t: int) -> Made:
        """The frame at one time."""
        run, place = divmod(t, self._count)
        with self._lock:
            if run not in self._held:
                start = run * self._count
                times = range(start, min(start + self._count, self._length))
                self._held[run] = list(self._draw(times))
            self._held.move_to_end(run)
            while len(self._held) > 1 and len(self._held) * self._count > KEPT_FRAMES:
                self._held.popitem(last=False)
            return self._held[run][place]


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
