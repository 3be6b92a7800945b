"""A video as a scene: where its camera was, how far what it saw is, and which things there are.

The scene holds the registered frames alone, as pinhole images; `Film` brings an edited one back into the recording:
through the lens, and with the frames that were not registered as they were.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8, UInt16

from rpaug import geometry
from rpaug.errors import Unsupported
from rpaug.render.jit import cache_folder
from rpaug.sfm import colmap, sweep, things, world
from rpaug.sfm.colmap import Settings
from rpaug.sfm.lens import Lens
from rpaug.sfm.model import FEWEST_FRAMES, Model, fingerprint, load, save
from rpaug.sfm.look import Look
from rpaug.sfm.things import Things
from rpaug.types import Body, Camera, CameraView, Episode, Scene

Progress = Callable[[float, str], None]
SAMPLED, DIFFERS, RESTLESS = (
    6,
    4,
    0.35,
)  # frames, grey levels, share of pixels: what a moving camera changes
KEPT = 8  # images of one kind
LOOKED = 32  # frames that things are told by
ASIDE = 3  # registered frames before and after whose points bound a frame's depth
SPAN = (0.4, 1.5)  # around the depths of the points
SNAP = 0.35  # of depth: what of the support is farther from its plane is something else
LOOK_WIDTH = 480  # pixels, at most, in which handles are told
JOINED = 20  # frames that a video's fingerprint is taken of


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


@dataclass(frozen=True, eq=False)
class Film:
    """A video with its model, in a world whose z is up. `unit` says what its lengths are, in words."""

    recorded: Episode
    model: Model
    depths: tuple[Float32[np.ndarray, "h w"], ...]
    things: Things
    unit: str

    @cached_property
    def name(self) -> str:
        """Of the only view."""
        return next(iter(self.recorded.views))

    @cached_property
    def lens(self) -> Lens:
        """What the recording was seen through."""
        return Lens(self.model)

    @cached_property
    def camera(self) -> Camera:
        """The pinhole camera of the registered frames."""
        return Camera(self.lens.K, self.model.cam_to_world, *self.lens.size)

    @cached_property
    def episode(self) -> Episode:
        """The registered frames as pinhole images, with depth and handles that were worked out."""
        view = CameraView(
            self.camera,
            lru_cache(KEPT)(self._rgb),
            lru_cache(KEPT)(self._depth),
            lru_cache(KEPT)(self._ids),
            inferred=True,
        )
        count = len(self.model.times)
        robot = self.recorded.robot
        some = replace(
            robot,
            joint_positions=robot.joint_positions[self.model.times],
            joint_velocities=robot.joint_velocities[self.model.times],
            extra={k: v[self.model.times] for k, v in robot.extra.items()},
        )
        return replace(self.recorded, views={self.name: view}, robot=some, length=count)

    def scene(self) -> Scene:
        """What edits are made in: everything stands still."""
        still = np.tile(np.eye(4), (self.episode.length, 1, 1))
        bodies = tuple(Body(frozenset([h]), still, "static") for h in self.things.every)
        roles = {"background": frozenset([things.BACKGROUND])}
        if self.things.support:
            roles["table"] = self.things.support
        return Scene(
            episode=self.episode,
            cameras={self.name: self.camera},
            bodies=bodies,
            roles=roles,
            antialiased=True,  # lenses mix the colours on both sides of an outline
            descriptions=self.recorded.descriptions,
            back=self,
        )

    def __call__(self, edited: Episode) -> Episode:
        """The recording with the frames of an edited scene in it."""
        before, after = self.episode.views[self.name], edited.views[self.name]
        recorded = self.recorded.views[self.name]
        view = recorded
        if after.rgb is not before.rgb:
            place = {int(t): k for k, t in enumerate(self.model.times)}

            def rgb(t: int) -> UInt8[np.ndarray, "h w 3"]:
                if t not in place:
                    return recorded.rgb(t)
                k = place[t]
                return self.lens.bent(recorded.rgb(t), before.rgb(k), after.rgb(k))

            view = replace(recorded, rgb=rgb)
        return replace(self.recorded, views={self.name: view}, descriptions=edited.descriptions)

    def describe(self) -> dict[str, Any]:
        """Plain values for the report."""
        missing = sorted(set(range(self.recorded.length)) - set(self.model.times.tolist()))
        return {
            "frames": self.recorded.length,
            "registered": len(self.model.times),
            "passed_through": missing,
            "focal_px": round(self.model.focal, 2),
            "radial": round(self.model.radial, 5),
            "points": len(self.model.points),
            "ray_angle_degrees": round(self.model.angle(), 2),
            "unit": self.unit,
            **self.model.facts,
        }

    def _rgb(self, k: int) -> UInt8[np.ndarray, "h w 3"]:
        return self.lens.flat(self.recorded.views[self.name].rgb(int(self.model.times[k])))

    def _depth(self, k: int) -> Float32[np.ndarray, "h w"]:
        """At full size, along the image's own edges; the support lies in its plane."""
        image = self.episode.views[self.name].rgb(k)
        size = (image.shape[1], image.shape[0])
        inverse = cv2.resize(1 / self.depths[k], size, interpolation=cv2.INTER_LINEAR)
        inverse = cv2.ximgproc.fastGlobalSmootherFilter(image, inverse, 30.0, 8.0)
        depth = (1 / np.maximum(inverse, 1e-6)).astype(np.float32)
        return self._on_support(k, depth)

    def _on_support(self, k: int, depth: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        if self.things.level is None:
            return depth
        view = self.episode.views[self.name]
        assert view.ids is not None
        mine = np.isin(view.ids(k), list(self.things.support))
        pose = self.model.cam_to_world[k]
        met = things.plane_depth(self.lens.K, pose, depth.shape, self.things.level)
        near = mine & (met > 0) & (np.abs(met / depth - 1) < SNAP)
        return np.where(near, met, depth).astype(np.float32)

    def _ids(self, k: int) -> Int32[np.ndarray, "h w"]:
        size = self.lens.size
        small = self._told(k)
        return cv2.resize(small, size, interpolation=cv2.INTER_NEAREST).astype(np.int32)

    @cached_property
    def _told(self) -> Callable[[int], UInt16[np.ndarray, "h w"]]:
        """Handles of each frame at the size that they are told in, kept once told."""

        @lru_cache(None)
        def told(k: int) -> UInt16[np.ndarray, "h w"]:
            image = self.episode.views[self.name].rgb(k)
            look = _look(image, self.lens.K, self.model.cam_to_world[k], self.depths[k])
            return self.things.of(look).astype(np.uint16)

        return told


def develop(
    episode: Episode,
    settings: Settings | None = None,
    *,
    cache: Path | None = None,
    scale: float | None = None,
    progress: Progress | None = None,
) -> Film:
    """Work out a video's camera, depth and things. Raises Unsupported where its model is degenerate.

    What was worked out before is taken from `cache`, by default in the user's own. `scale` is how many metres a unit of
    the model has, where that is known.
    """
    settings, tell = settings or Settings(), progress or (lambda share, what: None)
    (view,) = episode.views.values()
    where = (cache or cache_folder() / "sfm") / _name(episode, settings)
    model = _modelled(episode, settings, where.with_suffix(".npz"), tell)
    lens = Lens(model)
    shots = [
        sweep.shot(lens.flat(view.rgb(int(t))), lens.K, pose)
        for t, pose in zip(model.times, model.cam_to_world, strict=True)
    ]
    depths = _swept(model, shots, where.with_suffix(".depth.npz"), tell)
    typical = world.unit(depths)
    factor = typical if scale is None else scale
    model = model.moved(np.eye(4), factor)
    depths = [np.asarray(factor * depth, np.float32) for depth in depths]
    some = [int(k) for k in np.linspace(0, len(shots) - 1, min(LOOKED, len(shots))).round()]

    up, level = world.upright(model)
    model = model.moved(up, 1.0)
    looks = [
        _look(lens.flat(view.rgb(int(model.times[k]))), lens.K, model.cam_to_world[k], depths[k])
        for k in some
    ]
    told = things.find(looks)
    if level is not None:
        told = things.with_support(told, looks, level)
    unit = (
        f"relative: the median depth is taken to be {world.TYPICAL} m, nothing tells the true one"
        if scale is None
        else "metres, by the scale that was given"
    )
    return Film(episode, model, tuple(depths), told, unit)


def _look(
    image: UInt8[np.ndarray, "h w 3"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
    depth: Float32[np.ndarray, "a b"],
) -> Look:
    """A frame at the size that things are told in."""
    small = sweep.shot(image, K, pose, LOOK_WIDTH)
    size = (small.rgb.shape[1], small.rgb.shape[0])
    fitting = 1 / cv2.resize(1 / depth, size, interpolation=cv2.INTER_LINEAR)
    return Look(small.rgb, fitting.astype(np.float32), small.K, pose)


def _name(episode: Episode, settings: Settings) -> str:
    """What a video and the settings come to: other frames, another name."""
    import pycolmap

    (view,) = episode.views.values()
    some = sorted({int(t) for t in np.linspace(0, episode.length - 1, JOINED)})
    told = asdict(settings) | {"threads": 0, "frames": episode.length, "focal": _focal(view.camera)}
    said = json.dumps([told, pycolmap.__version__], sort_keys=True).encode()
    return fingerprint(said, *(view.rgb(t).tobytes() for t in some))


def _focal(camera: Camera) -> float:
    return float(camera.K[0, 0])


def _modelled(episode: Episode, settings: Settings, kept: Path, tell: Progress) -> Model:
    found = load(kept)
    if found is not None:
        if "refused" in found.facts:
            raise Unsupported(found.facts["refused"])
        return found
    (view,) = episode.views.values()
    try:
        model = colmap.reconstruct(
            view.rgb, range(episode.length), settings=settings,
            progress=lambda share, what: tell(0.6 * share, what),
        )  # fmt: skip
    except Unsupported as error:
        save(kept, _refused(str(error)))
        raise
    save(kept, model)
    return model


def _refused(words: str) -> Model:
    """What stands in the cache for a video that has no model, so that it is not looked for again."""
    none = np.zeros((0, 3))
    return Model(
        np.zeros(0, np.int32), np.zeros((0, 4, 4)), 1.0, (0.0, 0.0), 0.0, 1, 1, none,
        none.astype(np.uint8), np.zeros((0, 0), bool), {"refused": words},
    )  # fmt: skip


def _swept(
    model: Model, shots: Sequence[sweep.Shot], kept: Path, tell: Progress
) -> list[Float32[np.ndarray, "h w"]]:
    try:
        with np.load(kept, allow_pickle=False) as held:
            stored = list(held["depths"])
            if len(stored) == len(shots) and stored[0].shape == shots[0].grey.shape:
                return stored
    except (OSError, ValueError, KeyError, EOFError):
        pass
    spans, sparse = zip(*(_bounds(model, shot, k) for k, shot in enumerate(shots)), strict=True)
    depths = sweep.depths(shots, spans, sparse, lambda share: tell(0.6 + 0.4 * share, "depth"))
    kept.parent.mkdir(parents=True, exist_ok=True)
    import io

    from rpaug.files import write_atomic

    buffer = io.BytesIO()
    np.savez_compressed(buffer, depths=np.stack(depths))
    write_atomic(kept, buffer.getvalue())
    return depths


def _bounds(
    model: Model, shot: sweep.Shot, k: int
) -> tuple[tuple[float, float], Float32[np.ndarray, "h w"]]:
    """How near and far a frame's depth may be, and the depth of the points that it saw itself, 0 elsewhere."""
    about = model.seen[max(0, k - ASIDE) : k + ASIDE + 1].any(0)
    local = geometry.transform(geometry.inverse(model.cam_to_world[k]), model.points[about])
    z = np.maximum(local[:, 2], 1e-9)
    column = np.rint(shot.K[0, 0] * local[:, 0] / z + shot.K[0, 2])
    row = np.rint(shot.K[1, 1] * local[:, 1] / z + shot.K[1, 2])
    height, width = shot.grey.shape
    inside = (local[:, 2] > 0) & (row >= 0) & (column >= 0) & (row < height) & (column < width)
    if not inside.any():
        inside = local[:, 2] > 0
    near, far = np.quantile(z[inside], [0.02, 0.98])
    sparse = np.zeros(shot.grey.shape, np.float32)
    own = (
        inside
        & model.seen[k, about]
        & (row < height)
        & (column < width)
        & (row >= 0)
        & (column >= 0)
    )
    sparse[row[own].astype(int), column[own].astype(int)] = z[own]
    return (SPAN[0] * float(near), SPAN[1] * float(far)), sparse
