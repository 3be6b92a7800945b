"""How well surfels would show a moved camera its view, measured on the episode itself before anything is edited.

No truth is known for where a camera is going. So its image is carried there and back: drawn from surfels as the moved
camera would see it, then taken for a recording made there, from which, and from what the other cameras recorded, the
recorded view is drawn again. What that misses is known pixel by pixel. What the camera itself recorded at other times
from its own place is not used. How well this foretells the true error stands in docs/tiers.md.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int32

from rpaug.scene import surfels
from rpaug.scene.plates import spread
from rpaug.types import Camera, CameraView, Scene

FRAMES = 2  # moments that are looked at
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
    """Handles by region: each body that moves, by its handles, and everything else as the background."""
    moving = [body.handles for body in scene.tracked if body.motion != "static"]
    named = {f"body {', '.join(map(str, sorted(handles)))}": handles for handles in moving}
    rest = frozenset().union(*(body.handles for body in scene.tracked)) - frozenset().union(*moving)
    return {BACKGROUND: rest | {0}, **named}


def measure(scene: Scene, moved: Mapping[str, Camera]) -> list[Residual]:
    """Residuals of all regions in the cameras that `moved` puts elsewhere. Raises Unsupported without depth."""
    kept = surfels.build(scene)
    found = []
    for name, camera in moved.items():
        errors = [_there_and_back(scene, kept, name, camera, t) for t in _times(scene)]
        squared, off, ids = (np.concatenate(part) for part in zip(*errors, strict=True))
        for region, handles in regions(scene).items():
            here = np.isin(ids, list(handles))
            if here.any():
                mean = max(float(squared[here].mean()), 1e-10)
                depth = off[here][np.isfinite(off[here])]
                middle = 1e3 * float(np.median(depth)) if len(depth) else 0.0
                psnr = -10 * float(np.log10(mean))
                found.append(Residual(name, region, psnr, middle, int(here.sum())))
    return found


def _times(scene: Scene) -> Iterator[int]:
    yield from spread(scene.episode.length)[:FRAMES]


def _there_and_back(
    scene: Scene, kept: surfels.Surfels, name: str, camera: Camera, t: int
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n"], Int32[np.ndarray, "n"]]:
    """Each recorded pixel's squared colour error of full scale 1, depth error in metres, and handle."""
    recorded = scene.episode.views[name]
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
    assert recorded.depth is not None
    true = recorded.depth(t)
    squared = ((back.image / 255.0 - recorded.rgb(t) / 255.0) ** 2).mean(-1)
    off = np.where(true > 0, np.abs(back.depth.astype(np.float64) - true), np.nan)
    handles = np.zeros(true.shape, np.int32) if recorded.ids is None else recorded.ids(t)
    return squared.ravel(), off.ravel(), handles.ravel()
