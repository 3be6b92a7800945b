"""From a video to a film: its camera found, depth swept, what moves and what there is told, lengths made metres."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from rpaug.core import geometry
from rpaug.core.cache import place, trim
from rpaug.core.errors import BadInput, Unsupported
from rpaug.core.types import Camera, CameraView, Episode
from rpaug.providers import poses
from rpaug.scene.instances.found import FoundInstances
from rpaug.scene.video import colmap, instances, kept, moving, pieces, posed, supports, sweep, world
from rpaug.scene.video.colmap import ColmapSettings
from rpaug.scene.video.frame import PosedFrame, SmallFrames, reduced_lens, reduced_size
from rpaug.scene.video.instances import InstanceMap
from rpaug.scene.video.kept import KeptInstances
from rpaug.scene.video.lens import Lens
from rpaug.scene.video.model import (
    DAMAGED,
    FEWEST_FRAMES,
    LEAST_SHARE,
    Reconstruction,
    fingerprint,
    load,
    save,
)
from rpaug.scene.video.settings import KnownLength, VideoSettings
from rpaug.scene.video.video_scene import VideoScene, look_at

Progress = Callable[[float, str], None]
Bound = tuple[tuple[float, float], Float32[np.ndarray, "h w"]]
SAMPLED, DIFFERS, RESTLESS = (
    6,
    4,
    0.35,
)  # frames, grey levels, share of pixels: what a moving camera changes
LOOKED = 32  # frames that things are told by
ASIDE = 3  # registered frames before and after whose points bound a frame's depth
SPAN = (0.4, 1.5)  # around the depths of the points
JOINED = 20  # frames that a video's fingerprint is taken of
LOOKS_KEPT = 12  # frames: those that are compared with one another
NO_INSTANCES = InstanceMap(1.0, np.zeros(0, np.int64), np.zeros(0, np.int32), 0)
BOXES_APART = 45  # frames between two annotated ones, at most, for boxes to be drawn between them


def unplaced(episode: Episode) -> bool:
    """Whether this is a video of one moving camera of which nothing but images is known."""
    views = list(episode.views.values())
    if len(views) != 1 or not views[0].camera.assumed or views[0].depth or views[0].ids:
        return False
    return episode.length >= FEWEST_FRAMES and _moves(views[0], episode.length)


def _moves(view: CameraView, length: int) -> bool:
    """Whether most of the image changes between frames that are far apart: a robot before a still camera does not."""
    times = np.linspace(0, length - 1, SAMPLED).round().astype(int)
    grey = [cv2.blur(cv2.cvtColor(view.rgb(int(t)), cv2.COLOR_RGB2GRAY), (5, 5)) for t in times]
    pairs = pairwise(grey)
    return float(np.median([(cv2.absdiff(a, b) > DIFFERS).mean() for a, b in pairs])) > RESTLESS


def develop(
    episode: Episode,
    asked: VideoSettings | None = None,
    *,
    threads: int = 2,
    cache: Path | None = None,
    model_of: Callable[[], poses.Poses] | None = None,
    progress: Progress | None = None,
) -> VideoScene:
    """Work out a video's camera, depth and things. Raises Unsupported where its model is degenerate.

    What was worked out before is taken from the folder `cache`, by default that of `rpaug.core.cache`. `model_of`
    brings the model of poses that is asked where structure from motion fails. Raises BadInput for a known length that
    the video does not have.
    """
    asked, tell = asked or VideoSettings(), progress or (lambda share, what: None)
    settings = ColmapSettings(
        width=asked.width, features=asked.features, overlap=asked.overlap, threads=threads
    )
    (view,) = episode.views.values()
    name = _name(episode, settings)
    where = cache / name if cache else place("videos", name)
    model = _modelled(episode, settings, where / "model.npz", tell, model_of)
    lens, small = Lens(model), SmallFrames()
    mapped = f"{fingerprint(model.cam_to_world.tobytes())[:12]}"
    bounds = [_bounds(model, lens, k) for k in range(len(model.times))]
    shot = partial(_shot, view, model, lens, small)
    depths = _swept(shot, bounds, where / f"depth-{mapped}.npz", tell)
    look = _looks(view, model, lens, small, depths)
    given = fingerprint(mapped.encode(), moving.RULE.encode())[:12]
    moved = _moved(look, [span for span, _ in bounds], where / f"moving-{given}.npz", tell)
    if cache is None:
        trim(keep=[where])
    held = _held(model, moved.contradicted, episode.length)
    contradicted = tuple(int(t) for k, t in enumerate(model.times) if k not in held)
    masks = list(moved.masks)
    if contradicted:
        model = model.some(held)
        depths, masks = [depths[k] for k in held], [masks[k] for k in held]
        look = _looks(view, model, lens, small, depths)
    for k, mask in enumerate(masks) if view.hands else ():
        masks[k] = _with_boxes(view, int(model.times[k]), look(k), mask)

    video = VideoScene(
        episode, model, tuple(depths), NO_INSTANCES, world.RELATIVE, tuple(masks), contradicted,
        asked.fit_width, small,
    )  # fmt: skip
    return scaled(_standing(_with_kept(video, where, asked)), asked)


def _shot(
    view: CameraView, model: Reconstruction, lens: Lens, small: SmallFrames, k: int
) -> sweep.SweepImage:
    """Frame `k` as it is swept; of the full image `small` keeps what others will ask for."""
    t = int(model.times[k])
    full = lens.flat(view.rgb(t))
    small.image(t, lambda: full)
    return sweep.shot(full, lens.K, model.cam_to_world[k])


def _looks(
    view: CameraView,
    model: Reconstruction,
    lens: Lens,
    small: SmallFrames,
    depths: Sequence[Float32[np.ndarray, "h w"]],
) -> Callable[[int], PosedFrame]:
    """Each frame of the model at the size that things are told in."""

    @lru_cache(LOOKS_KEPT)
    def look(k: int) -> PosedFrame:
        t = int(model.times[k])
        shown = small.image(t, lambda: lens.flat(view.rgb(t)))
        return look_at(t, shown, lens, model.cam_to_world[k], depths[k], small)

    return look


def _held(model: Reconstruction, wrong: Sequence[int], length: int) -> list[int]:
    """The rows of the model's frames that are believed: not those that move otherwise, and those of pieces that are a
    model by themselves. Raises Unsupported if those are too few."""
    kept = [k for k in range(len(model.times)) if k not in wrong]
    some = model.some(kept)
    if faults := some.faults(length):
        raise Unsupported(
            f"structure from motion is degenerate ({len(wrong)} frames do not move as it says; {', '.join(faults)})"
        )
    parts = [rows for rows in pieces.pieces(some.seen) if not some.some(rows).faults(len(rows))]
    held = sorted(kept[k] for rows in parts for k in rows)
    if len(held) < LEAST_SHARE * length:
        raise Unsupported(
            f"structure from motion is degenerate (pieces that hang together have {len(held)} of {length} frames)"
        )
    return held


def _with_kept(video: VideoScene, where: Path, asked: VideoSettings) -> VideoScene:
    """The video with the place of its instances in its folder `where`: another one for all that they hang on."""
    scale = asked.model_dump_json(include={"camera_height", "known_length"})
    state = fingerprint(
        kept.rule().encode(), scale.encode(),
        video.model.cam_to_world.tobytes(), video.model.times.tobytes(),
        *(depth.tobytes() for depth in video.depths),
        *(np.packbits(mask).tobytes() for mask in video.moving),
    )  # fmt: skip
    return replace(video, kept=KeptInstances(where / f"instances-{state[:12]}"))


def _standing(video: VideoScene) -> VideoScene:
    """The video in a world whose z is up, with the instances of its still world, in its depth's own unit."""
    parts = pieces.pieces(video.model.seen)
    model, depths, of, level = pieces.placed(video.model, parts, video.depths)
    placed = replace(video, model=model, depths=tuple(depths), pieces=tuple(of))

    def find() -> InstanceMap:
        some = np.linspace(0, len(depths) - 1, min(LOOKED, len(depths))).round().astype(int)
        looks = [replace(placed.look(k), hidden=video.moving[k]) for k in some.tolist()]
        found = instances.find(looks)
        return found if level is None else supports.with_supports(found, looks, level, len(parts))

    assert video.kept is not None
    return replace(placed, instances=video.kept.map(find))


@dataclass(frozen=True)
class ByVideo:
    """An episode's instances from its video scene, if nothing but one moving camera's images is known of it."""

    settings: VideoSettings | None = None
    progress: Progress | None = None
    poses: str | None = None
    gives_way: bool = True

    def suits(self, episode: Episode) -> bool:
        return unplaced(episode)

    def find(self, episode: Episode) -> FoundInstances:
        named = self.poses
        model_of = partial(poses.poses, named) if named else None
        return develop(episode, self.settings, model_of=model_of, progress=self.progress).found()


def scaled(video: VideoScene, asked: VideoSettings) -> VideoScene:
    """The film in metres, where something tells them. Raises BadInput for what the video does not have."""
    if asked.camera_height is not None:
        if video.instances.level is None:
            found = "no level plane of points"
            raise BadInput(
                video.recorded.key, "video.camera_height", found=found, expected="a support"
            )
        return _grown(video, asked.camera_height / video.eye, "metres, by the camera's height")
    if asked.known_length is not None:
        length = _measured(video, asked.known_length)
        return _grown(video, asked.known_length.metres / length, "metres, by a known length")
    return video


def _grown(video: VideoScene, factor: float, unit: str) -> VideoScene:
    return replace(
        video,
        model=video.model.moved(np.eye(4), factor),
        depths=tuple(np.asarray(factor * depth, np.float32) for depth in video.depths),
        instances=video.instances.scaled(factor),
        unit=unit,
    )


def _measured(video: VideoScene, known: KnownLength) -> float:
    """How long a known length is in the film's unit."""
    key, times = video.recorded.key, video.model.times.tolist()
    if known.frame not in times:
        found = f"{known.frame}, which is not registered"
        raise BadInput(key, "video.known_length.frame", found=found, expected=f"one of {times}")
    k = times.index(known.frame)
    depth, ends = video.episode.views[video.name].depth, []
    assert depth is not None
    for x, y in known.places:
        if not (0 <= x <= video.model.width - 1 and 0 <= y <= video.model.height - 1):
            size = f"a pixel of {video.model.width}x{video.model.height}"
            raise BadInput(key, "video.known_length.places", found=[x, y], expected=size)
        column, row = video.lens.straight(x, y)
        z = float(depth(k)[round(row), round(column)])
        ray = np.linalg.inv(video.lens.K) @ [column, row, 1.0]
        ends.append(geometry.transform(video.model.cam_to_world[k], z * ray))
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if length < 1e-6:
        raise BadInput(
            key, "video.known_length.places", found="one place twice", expected="two places"
        )
    return length


def _with_boxes(
    view: CameraView, t: int, look: PosedFrame, mask: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """What moves, with what is in an annotator's boxes of hands."""
    factor = mask.shape[1] / view.camera.width
    boxes = moving.between(view.hands, t, BOXES_APART)
    return mask | moving.boxed(look, [tuple(factor * v for v in box) for box in boxes])


def _moved(
    look: Callable[[int], PosedFrame],
    spans: Sequence[tuple[float, float]],
    path: Path,
    tell: Progress,
) -> moving.Moving:
    shape = look(0).depth.shape
    try:
        with np.load(path, allow_pickle=False) as held:
            if held["shape"].tolist() == [len(spans), *shape]:
                bits = np.unpackbits(held["masks"], count=len(spans) * shape[0] * shape[1])
                masks = bits.astype(bool).reshape(len(spans), *shape)
                tell(1.0, "camera, depth and hands from the cache")
                return moving.Moving(tuple(masks), tuple(held["contradicted"].tolist()))
    except DAMAGED:
        pass
    found = moving.find(look, len(spans), spans, lambda share: tell(0.85 + 0.15 * share, "hands"))
    kept.keep(
        path, masks=np.packbits(np.stack(found.masks)), shape=np.array([len(spans), *shape]),
        contradicted=np.array(found.contradicted, np.int32),
    )  # fmt: skip
    return found


def _name(episode: Episode, settings: ColmapSettings) -> str:
    """What a video and the settings come to: other frames, another name."""
    import pycolmap

    (view,) = episode.views.values()
    some = sorted({int(t) for t in np.linspace(0, episode.length - 1, JOINED)})
    given = asdict(settings) | {
        "threads": 0,
        "frames": episode.length,
        "focal": _focal(view.camera),
    }
    stated = json.dumps([given, pycolmap.__version__], sort_keys=True).encode()
    return fingerprint(stated, *(view.rgb(t).tobytes() for t in some))


def _focal(camera: Camera) -> float:
    return float(camera.K[0, 0])


def _modelled(
    episode: Episode,
    settings: ColmapSettings,
    path: Path,
    tell: Progress,
    model_of: Callable[[], poses.Poses] | None,
) -> Reconstruction:
    """By structure from motion, else by a learned model if there is one."""
    (view,) = episode.views.values()
    try:
        return _reconstructed(episode, settings, path, tell)
    except Unsupported as error:
        if model_of is None:
            raise
        try:
            tell(0.6, "poses by a model")
            return posed.reconstruct(view.rgb, range(episode.length), model_of())
        except Unsupported as other:
            raise Unsupported(f"{error}; by the model of poses: {other}") from None


def _reconstructed(
    episode: Episode, settings: ColmapSettings, path: Path, tell: Progress
) -> Reconstruction:
    found = load(path)
    if found is not None:
        if "refused" in found.facts:
            raise Unsupported(found.facts["refused"])
        return found
    (view,) = episode.views.values()
    try:
        model = colmap.reconstruct(
            view.rgb, range(episode.length), settings=settings,
            progress=lambda share, what: tell(0.5 * share, what),
        )  # fmt: skip
    except Unsupported as error:
        save(path, _refused(str(error)))
        raise
    save(path, model)
    return model


def _refused(words: str) -> Reconstruction:
    """What stands in the cache for a video that has no model, so that it is not looked for again."""
    none = np.zeros((0, 3))
    return Reconstruction(
        np.zeros(0, np.int32), np.zeros((0, 4, 4)), 1.0, (0.0, 0.0), 0.0, 1, 1, none,
        none.astype(np.uint8), np.zeros((0, 0), bool), {"refused": words},
    )  # fmt: skip


def _swept(
    shot: Callable[[int], sweep.SweepImage], bounds: Sequence[Bound], path: Path, tell: Progress
) -> list[Float32[np.ndarray, "h w"]]:
    try:
        with np.load(path, allow_pickle=False) as held:
            stored = list(held["depths"])
            if len(stored) == len(bounds) and stored[0].shape == bounds[0][1].shape:
                return stored
    except DAMAGED:
        pass
    spans, sparse = zip(*bounds, strict=True)
    shots = [shot(k) for k in range(len(bounds))]
    depths = sweep.depths(shots, spans, sparse, lambda share: tell(0.6 + 0.25 * share, "depth"))
    kept.keep(path, depths=np.stack(depths))
    return depths


def _bounds(
    model: Reconstruction, lens: Lens, k: int
) -> tuple[tuple[float, float], Float32[np.ndarray, "h w"]]:
    """How near and far a frame's depth may be, and the depth of the points that it saw itself, 0 elsewhere."""
    K, shape = (
        reduced_lens(lens.K, *lens.size, sweep.WIDTH),
        reduced_size(*lens.size, sweep.WIDTH)[::-1],
    )
    about = model.seen[max(0, k - ASIDE) : k + ASIDE + 1].any(0)
    local = geometry.transform(geometry.inverse(model.cam_to_world[k]), model.points[about])
    z = np.maximum(local[:, 2], 1e-9)
    row, column, inside = geometry.in_image(local, K, shape)
    near, far = np.quantile(z[inside if inside.any() else local[:, 2] > 0], [0.02, 0.98])
    sparse = np.zeros(shape, np.float32)
    own = inside & model.seen[k, about]
    sparse[row[own], column[own]] = z[own]
    return (SPAN[0] * float(near), SPAN[1] * float(far)), sparse
