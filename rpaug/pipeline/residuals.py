"""How well surfels would show a moved camera its view, measured on the episode itself before anything is edited.

No truth is known for where a camera is going. So its image is carried there and back: drawn from surfels as the moved
camera would see it, then taken for a recording made there, from which, and from what the other cameras recorded, the
recorded view is drawn again. What that misses is known pixel by pixel. What the camera itself recorded at other times
from its own place is not used. How well this foretells the true error stands in docs/tiers.md.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from rpaug.core.metrics import decibels
from rpaug.core.types import Camera, CameraView, Scene
from rpaug.scene.recorded import surfels
from rpaug.scene.recorded.plates import spread

FRAMES = 2  # moments that are looked at
LEAST = 1e-10  # squared error of full scale 1: 100 dB
BACKGROUND = "background"


@dataclass(frozen=True)
class Residual:
    """How far one camera's view of one region is from what was recorded: dB of PSNR, median depth error, pixels."""

    camera: str
    region: str
    psnr: float
    depth_mm: float
    pixels: int


def regions(scene: Scene) -> dict[str, frozenset[int]]:
    """Handles by region: each body that moves, by its instance ids, and everything else as the background."""
    moving = [body.instance_ids for body in scene.tracked if body.motion != "static"]
    named = {
        f"body {', '.join(map(str, sorted(instance_ids)))}": instance_ids for instance_ids in moving
    }
    rest = frozenset().union(*(body.instance_ids for body in scene.tracked)) - frozenset().union(
        *moving
    )
    return {BACKGROUND: rest | {0}, **named}


def measure(scene: Scene, moved: Mapping[str, Camera]) -> list[Residual]:
    """Residuals of all regions in the cameras that `moved` puts elsewhere. Raises Unsupported without depth."""
    kept = surfels.build(scene)
    return [
        one
        for name, camera in moved.items()
        for one in _by_region(scene, name, partial(_there_and_back, scene, kept, name, camera))
    ]


def of_gaussians(scene: Scene, cameras: Iterable[str]) -> list[Residual]:
    """Residuals of the scene's Gaussians in the recorded views of some cameras, which they were fitted to."""
    from rpaug.gaussians import gaussian_view  # only here: it brings the rasteriser

    def drawn(name: str, t: int) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
        return gaussian_view.render_view(scene, name, t)[:2]

    return [one for name in cameras for one in _by_region(scene, name, partial(drawn, name))]


def _by_region(
    scene: Scene,
    name: str,
    draw: Callable[[int], tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]],
) -> list[Residual]:
    """What images and depths of one camera miss of its recordings."""
    errors = [_errors(scene.episode.views[name], t, *draw(t)) for t in _times(scene)]
    squared, off, ids = (np.concatenate(part) for part in zip(*errors, strict=True))
    found = []
    for region, instance_ids in regions(scene).items():
        here = np.isin(ids, list(instance_ids))
        if here.any():
            depth = off[here][np.isfinite(off[here])]
            middle = 1e3 * float(np.median(depth)) if len(depth) else 0.0
            psnr = decibels(float(squared[here].mean()), LEAST)
            found.append(Residual(name, region, psnr, middle, int(here.sum())))
    return found


def _times(scene: Scene) -> list[int]:
    return spread(scene.episode.length)[:FRAMES]


def _there_and_back(
    scene: Scene, kept: surfels.Surfels, name: str, camera: Camera, t: int
) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """The recorded view, drawn from what the camera would have recorded elsewhere."""
    there = surfels.view(kept, replace(scene, cameras={**scene.cameras, name: camera}), name, t)
    rgb, depth, ids = there.image, there.depth, there.ids
    seen = CameraView(camera, lambda _: rgb, lambda _: depth, lambda _: ids)
    episode = replace(scene.episode, views={**scene.episode.views, name: seen})
    # Nothing from its own place: neither plates nor history, nor parts, which any camera may have given.
    fewer = replace(
        kept,
        plates={other: plate for other, plate in kept.plates.items() if other != name},
        history={other: past for other, past in kept.history.items() if other != name},
        parts=(),
    )
    back = surfels.view(fewer, replace(scene, episode=episode), name, t)
    return back.image, back.depth


def _errors(
    view: CameraView, t: int, image: UInt8[np.ndarray, "h w 3"], depth: Float32[np.ndarray, "h w"]
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n"], Int32[np.ndarray, "n"]]:
    """Each recorded pixel's squared color error of full scale 1, depth error in metres, and instance id."""
    assert view.depth is not None
    true = view.depth(t)
    squared = ((image / 255.0 - view.rgb(t) / 255.0) ** 2).mean(-1)
    off = np.where(true > 0, np.abs(depth.astype(np.float64) - true), np.nan)
    instance_ids = np.zeros(true.shape, np.int32) if view.ids is None else view.ids(t)
    return squared.ravel(), off.ravel(), instance_ids.ravel()
