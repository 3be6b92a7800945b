"""Gaussians of a video: of its still world, from its points and swept depth, and of its hands in space and time.

The still ones start on the model's points and on every frame's depth where earlier frames left a gap, and descend on
color and, weakly, on depth, over images made small; some frames are kept back to judge by. What moves by itself is
left out of them, and fitted over them with a time of its own (`rpaug.scene.four`).
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int32

from rpaug.core import devices, geometry, sampling
from rpaug.core.types import Camera, CameraView, Episode, Gaussians, Scene
from rpaug.gaussians import cached, fit4, store
from rpaug.gaussians.fit4 import FourSettings
from rpaug.gaussians.frame_fit import FrameFitSettings, fit_views
from rpaug.gaussians.gaussians import SH0, LiftedImage, chosen, joined, lifted
from rpaug.gaussians.labels import UNKNOWN, Labelled
from rpaug.gaussians.shots import TargetImage
from rpaug.gaussians.vote import vote
from rpaug.render.splat import Loss, Splats, View, cores
from rpaug.scene.recorded.plates import spread
from rpaug.scene.video import sweep
from rpaug.scene.video.instances import BACKGROUND
from rpaug.scene.video.model import fingerprint
from rpaug.scene.video.video_scene import VideoScene

LOOKS = 16  # frames that tell Gaussians' instance ids
RIM = 5  # pixels: what moves is left out with its blurred outline


@dataclass(frozen=True, kw_only=True)
class SplatSettings:
    """How a video's Gaussians are fitted."""

    width: int = 320  # pixels: of the images that are fitted
    kept_back: int = 8  # every so many-th frame is never fitted, and judged by
    rounds: float = 12.0  # times that each fitted frame is looked at
    stride: int = 3  # pixels between Gaussians of one frame
    most: int = 60000  # Gaussians to begin with
    threads: int = 2
    backend: str = "auto"  # one of `render.splat.engines`
    hands: FourSettings = field(default_factory=lambda: FourSettings(rounds=8, densify_rounds=(4,)))
    frames: int = 60  # at most, of which at most every second one, that hands are fitted at


def on(settings: SplatSettings, device: str) -> SplatSettings:
    """The settings for a device; beside a GPU all cores serve."""
    if device == "cpu":
        return settings
    name = devices.backend(device)
    return replace(
        settings, backend=name, threads=cores(), hands=replace(settings.hands, backend=name)
    )


def kept(
    scene: Scene, video: VideoScene, folder: Path | None, settings: SplatSettings | None = None
) -> tuple[Scene, Mapping[str, Any]]:
    """As `fitted`; with a `folder`, the store of fitted scenes, from there if the same video was fitted before."""
    settings = settings or SplatSettings(width=video.fit_width)
    if folder is None:
        return fitted(scene, video, settings)
    name = name_of(video, settings)
    found = store.load(folder, name)
    if found is not None:
        return cached.known(scene, found), found.report
    made, facts = fitted(scene, video, settings)
    cached.keep(folder, name, made, settings, facts, None)
    return made, facts


def name_of(video: VideoScene, settings: SplatSettings) -> str:
    """The key of a film's Gaussians: of all frames as they are fitted, where they are, and the settings."""
    given = store.counting({**asdict(settings)}) | {"threads": 0}
    return fingerprint(
        f"{store.FORMAT} {store.VERSION} {LOOKS} votes".encode(), json.dumps(given, sort_keys=True).encode(),
        video.model.cam_to_world.tobytes(), video.lens.K.tobytes(), video.model.points.tobytes(),
        *(depth.tobytes() for depth in video.depths), *(mask.tobytes() for mask in video.moving),
        *(_small(video, k, settings).rgb.tobytes() for k in range(video.episode.length)),
    )  # fmt: skip


def fitted(
    scene: Scene, video: VideoScene, settings: SplatSettings | None = None
) -> tuple[Scene, Mapping[str, Any]]:
    """The scene with Gaussians, and how well they show the frames: PSNR in dB of fitted and of kept-back ones."""
    settings = settings or SplatSettings(width=video.fit_width)
    shots = [_shot(video, k, settings) for k in range(video.episode.length)]
    begun = seeds(video, shots, settings)
    trained = [shot for shot in shots if not shot.judged.any()]
    judged = [shot for shot in shots if shot.judged.any()]
    steps = max(2, round(settings.rounds * len(trained) / 2))
    # Kept-back frames come once in a while, weightless: checks look at them, steps do not.
    rule = FrameFitSettings(
        iterations=steps, stop="iterations", threads=settings.threads, backend=settings.backend,
        loss=Loss(l2=1.0, depth=0.3), check_every=max(1, steps // 3),
    )  # fmt: skip
    found = fit_views(Splats.of(begun), [*trained, *judged], rule)
    made = _gaussians(found.splats, video)
    last = found.trace[-1]
    facts = {
        "steps": steps,
        "train_db": round(last.recorded_db, 2),
        "held_out_db": None if last.held_out_db is None else round(last.held_out_db, 2),
        "held_out_frames": len(judged),
        "seconds": round(last.processor_seconds, 1),
        "gaussians": len(made),
        "per_camera_db": {video.name: last.held_out_db or last.recorded_db},
        "depth_error_mm": None,
    }
    scene = replace(scene, gaussians=made)
    scene = replace(scene, gaussians=replace(made, ids=_named(scene, video, settings)))
    if video.hand is None:
        return scene, facts
    scene, four = with_hands(scene, video, settings)
    return scene, {**facts, "four": four.describe()}


def with_hands(
    scene: Scene, video: VideoScene, settings: SplatSettings
) -> tuple[Scene, fit4.FourReport]:
    """The scene with what moves by itself as Gaussians in space and time, fitted to images made small."""
    assert video.hand is not None
    length = video.episode.length
    small = _made_small(scene, video, settings)
    rule = replace(settings.hands, train_frames=min(settings.frames, (length + 1) // 2))
    made, given = fit4.fitted(small, settings=rule, instance_ids=frozenset([video.hand]))
    return replace(scene, gaussians=made.gaussians, flowing=made.flowing, bodies=made.bodies), given


def _named(scene: Scene, video: VideoScene, settings: SplatSettings) -> Int32[np.ndarray, "n"]:
    """Handles that most of each Gaussian's weight falls on; where none does, that of the cell it lies in."""
    small = _made_small(scene, video, settings)
    ids = small.episode.views[video.name].ids
    assert ids is not None
    pictures = [
        Labelled(video.name, k, np.where(ids(k) == video.hand, UNKNOWN, ids(k)).astype(np.int32))
        for k in sampling.frames(video.episode.length, LOOKS)
    ]
    return vote(small, pictures)


def _made_small(scene: Scene, video: VideoScene, settings: SplatSettings) -> Scene:
    """The scene with its frames at the size that is fitted."""
    episode = _episode(video, settings)
    return replace(scene, episode=episode, cameras={video.name: episode.views[video.name].camera})


def _episode(video: VideoScene, settings: SplatSettings) -> Episode:
    """The film's frames at the size that is fitted."""
    view = video.episode.views[video.name]
    first = _small(video, 0, settings)
    size = (first.rgb.shape[1], first.rgb.shape[0])
    assert view.depth is not None
    assert view.ids is not None
    depth, ids = view.depth, view.ids

    @lru_cache(None)
    def deep(k: int) -> Float32[np.ndarray, "h w"]:
        return cv2.resize(depth(k), size, interpolation=cv2.INTER_NEAREST)

    @lru_cache(None)
    def named(k: int) -> Int32[np.ndarray, "h w"]:
        return cv2.resize(ids(k), size, interpolation=cv2.INTER_NEAREST)

    camera = Camera(first.K, video.model.cam_to_world, *size)
    shown = CameraView(
        camera, lru_cache(None)(lambda k: _small(video, k, settings).rgb), deep, named
    )
    return replace(video.episode, views={video.name: shown})


def _small(video: VideoScene, k: int, settings: SplatSettings) -> sweep.SweepImage:
    image = video.episode.views[video.name].rgb(k)
    return sweep.shot(image, video.lens.K, video.model.cam_to_world[k], settings.width)


def seeds(video: VideoScene, shots: list[TargetImage], settings: SplatSettings) -> Gaussians:
    """The model's points, and swept depth of fitted frames where no earlier frame showed the place."""
    model = video.model
    parts = [_points(video)]
    cell = 1.5 * settings.stride * float(np.median([_footprint(shot) for shot in shots]))
    taken = _cells(parts[0].means, cell)
    for k in spread(len(shots)):  # so that any part of the video has its share
        shot = shots[k]
        if shot.judged.any() or sum(map(len, parts)) > settings.most:
            continue
        assert shot.depth is not None
        use = np.zeros(shot.depth.shape, bool)
        use[:: settings.stride, :: settings.stride] = True
        use &= ~shot.held
        image = np.rint(shot.color * 255).astype(np.uint8)
        ids = np.full(shot.depth.shape, BACKGROUND, np.int32)
        picture = LiftedImage(image, shot.depth, ids, shot.view.K, model.cam_to_world[k], use)
        part = lifted(picture, settings.stride)
        cells = _cells(part.means, cell)
        fresh = ~np.isin(cells, taken)
        first = np.zeros(len(part), bool)
        first[np.unique(cells, return_index=True)[1]] = True
        parts.append(chosen(part, fresh & first))
        taken = np.concatenate([taken, cells[fresh]])
    return joined(parts)


def _points(video: VideoScene) -> Gaussians:
    """The points themselves: round, as wide as the distance to the cameras that saw them makes a few pixels."""
    model = video.model
    count = len(model.points)
    eyes = model.seen.T @ model.cam_to_world[:, :3, 3] / model.seen.sum(0)[:, None]
    near = np.linalg.norm(model.points - eyes, axis=1)
    size = (2.0 / model.focal * near)[:, None].repeat(3, 1)
    return Gaussians(
        means=model.points.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=size.astype(np.float32),
        opacities=np.full(count, 0.5, np.float32),
        sh=((model.colors.astype(np.float32) / 255 - 0.5) / SH0)[:, None],
        ids=np.full(count, BACKGROUND, np.int32),
    )


def _cells(points: np.ndarray, size: float) -> np.ndarray:
    near = np.clip(np.floor(points / size).astype(np.int64), -(2**20), 2**20 - 1) + 2**20
    return (near[:, 0] << 42) | (near[:, 1] << 21) | near[:, 2]


def _footprint(shot: TargetImage) -> float:
    assert shot.depth is not None
    return float(np.median(shot.depth)) / float(shot.view.K[0, 0])


def _shot(video: VideoScene, k: int, settings: SplatSettings) -> TargetImage:
    small = _small(video, k, settings)
    size = (small.rgb.shape[1], small.rgb.shape[0])
    depth = 1 / cv2.resize(1 / video.depths[k], size, interpolation=cv2.INTER_LINEAR)
    shown = cv2.resize(video.lens.shown.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    if video.hand is not None:
        mine = cv2.resize(video.moving[k].astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        shown &= cv2.dilate(mine, np.ones((RIM, RIM), np.uint8)) == 0
    judged = k % settings.kept_back == settings.kept_back - 1
    view = View(small.K, geometry.inverse(small.cam_to_world), *size)
    return TargetImage(
        view, small.rgb.astype(np.float32) / 255, depth.astype(np.float32),
        np.ones_like(shown) if judged else ~shown, shown if judged else np.zeros_like(shown),
    )  # fmt: skip


def _gaussians(splats: Splats, video: VideoScene) -> Gaussians:
    """Splats with the instance ids of the cells that they lie in."""
    assert splats.quats is not None
    assert splats.scales is not None
    length: Float64[np.ndarray, "n 1"] = np.linalg.norm(splats.quats, axis=-1, keepdims=True)
    ids = video.instances.at(splats.means)
    return Gaussians(
        splats.means.astype(np.float32), (splats.quats / np.maximum(length, 1e-12)).astype(np.float32),
        splats.scales, splats.opacities, splats.sh, ids,
    )  # fmt: skip
