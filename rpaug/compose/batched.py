"""Frames of cameras that stand as recorded, many at once on a device: recorded pixels under appearance edits.

What the recording alone says of an image (its pixels, ids, where they lie, what light they have) is kept on the device
for the copies and epochs that follow, up to a limit.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import torch
from jaxtyping import Float32, Int32, UInt8
from torch import Tensor

from rpaug.core.errors import SourceLacks
from rpaug.core.types import Appearance, Episode, Scene
from rpaug.render.batched import composite
from rpaug.render.batched.pixels import Pixels
from rpaug.scene.lighting import highlights, intrinsic
from rpaug.scene.recorded import batched, pooled, surface
from rpaug.scene.recorded.batched import Lifted, Moved, PlacedPixels, Places

KEPT_BYTES = 2 * 2**30  # of recorded images, on the device


@dataclass(frozen=True)
class Shot:
    """One image to draw: what the scene shows in a camera at a time."""

    scene: Scene
    camera: str
    t: int


def drawable(scene: Scene, camera: str) -> bool:
    """Whether a camera's frames, recorded pixels under appearance edits, can be drawn many at once."""
    view = scene.episode.views[camera]
    return (
        view.ids is not None
        and view.depth is not None
        and view.radiance is None
        and view.proxy is None
        and all(map(composite.stacks, scene.appearance))
    )


class Recorded:
    """One recorded image on a device, and what is known of it. Parts are worked out when an edit asks for them."""

    def __init__(self, shot: Shot, device: torch.device) -> None:
        self._shot, self._device = shot, device
        self._view = shot.scene.episode.views[shot.camera]

    @cached_property
    def rgb(self) -> UInt8[Tensor, "1 h w 3"]:
        return self._held(self._view.rgb(self._shot.t))

    @cached_property
    def ids(self) -> Int32[Tensor, "1 h w"]:
        assert self._view.ids is not None
        return self._held(self._view.ids(self._shot.t))

    @cached_property
    def lifted(self) -> Lifted:
        """Raises SourceLacks without depth."""
        t, camera = self._shot.t, self._view.camera
        depth = surface.depth_of(self._view, t)
        if depth is None:
            raise SourceLacks("this edit needs recorded depth, and this source has none")
        pool = pooled.of_camera(self._shot.scene.episode, self._shot.camera)
        pose = camera.cam_to_world[t][None]
        return batched.lift(self._held(depth), self.ids, camera.K, pose, pool)

    @cached_property
    def lit(self) -> Float32[Tensor, "1 h w"]:
        share = intrinsic.share(self._shot.scene, self._shot.camera, self._shot.t)
        ones = torch.ones(self.ids.shape, device=self._device)
        return ones if share is None else self._held(share)

    @cached_property
    def mirrored(self) -> Float32[Tensor, "1 h w 3"] | None:
        shine = highlights.seen_by(self._shot.scene, self._view, self._shot.t)
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


class Drawing:
    """Draws images on one device. One thread at a time."""

    def __init__(self, device: torch.device, kept_bytes: int = KEPT_BYTES) -> None:
        self.device, self._most = device, kept_bytes
        self._held: OrderedDict[tuple[Episode, str, int], Recorded] = OrderedDict()

    def __call__(self, shots: Sequence[Shot]) -> UInt8[Tensor, "n h w 3"]:
        """The images, all of one size, of what is `drawable`."""
        images = [self.recorded(shot) for shot in shots]
        ids = torch.cat([one.ids for one in images])
        places = Places(
            ids,
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
        return composite.composite(rgb, ids, edits, mixes, surfaces)

    def recorded(self, shot: Shot) -> Recorded:
        """What was recorded there, kept for those who ask again."""
        asked = shot.scene.episode, shot.camera, shot.t
        if asked not in self._held:
            self._held[asked] = Recorded(shot, self.device)
        self._held.move_to_end(asked)
        image = self._held[asked]
        while len(self._held) > 1 and len(self._held) * image.bytes > self._most:
            self._held.popitem(last=False)
        return image


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
