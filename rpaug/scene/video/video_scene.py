"""A video as a scene: where its camera was, how far what it saw is, and which things there are.

The scene holds the registered frames alone, as pinhole images; `Film` brings an edited one back into the recording:
through the lens, and with the frames that were not registered as they were.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8, UInt16

from rpaug.core import geometry
from rpaug.core.jit import kernel
from rpaug.core.pixels import bounds, grown
from rpaug.core.types import Belief, Body, Camera, CameraView, Episode, Everywhere, Scene
from rpaug.scene.instances.found import FoundInstances
from rpaug.scene.instances.jumps import Jump, jumps
from rpaug.scene.targets import roles, survey
from rpaug.scene.video import believed, world
from rpaug.scene.video.frame import LOOK_WIDTH, PosedFrame, SmallFrames, reduced_lens
from rpaug.scene.video.instances import InstanceMap, plane_depth
from rpaug.scene.video.kept import KeptInstances
from rpaug.scene.video.lens import Lens
from rpaug.scene.video.model import Reconstruction
from rpaug.scene.video.upsampled import upsampled

SURE = 0.6  # of what moves by itself: nothing checks it by contact
MOVES = "it moves by itself, or is carried by what does"
KEPT = 8  # images of one kind
UNSTEADY, FEW_JUMPS = (
    0.25,
    3,
)  # of an instance's steps: as many jumps or more and it is not painted; and at least
STEPS = -1, 1, -2, 2  # frames before and after one that are asked whether its support is theirs
FEWEST = 2  # of them that say it is not
RESTING = 8  # frames before and after that a hand may rest in
SNAP = 0.35  # of depth: what of the support is farther from its plane is something else
AROUND = 9  # pixels around what moves by itself that tell how far what it hides is
BEFORE = 0.9  # of that: nothing tells how far it is, but it hides the rest


@dataclass(frozen=True, eq=False)
class VideoScene:
    """A video with its model, in a world whose z is up. `unit` says what its lengths are, in words."""

    recorded: Episode
    model: Reconstruction
    depths: tuple[Float32[np.ndarray, "h w"], ...]
    instances: InstanceMap
    unit: str
    moving: tuple[Bool[np.ndarray, "h w"], ...] = ()  # what moves by itself, frame by frame
    contradicted: tuple[int, ...] = ()  # recorded frames whose poses were not believed
    fit_width: int = 320  # pixels: of the images that Gaussians are fitted to
    small: SmallFrames = field(default_factory=SmallFrames)
    kept: KeptInstances | None = None  # where instance ids that were told before lie
    pieces: tuple[
        int, ...
    ] = ()  # of each frame the piece of the model that it belongs to, if there are several

    @cached_property
    def name(self) -> str:
        """Of the only view."""
        return next(iter(self.recorded.views))

    @property
    def times(self) -> list[int]:
        """The recorded frame of each that the scene holds."""
        return [int(t) for t in self.model.times]

    @cached_property
    def missing(self) -> list[int]:
        """Recorded frames that the scene does not hold."""
        return sorted(set(range(self.recorded.length)) - set(self.model.times.tolist()))

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
        """The registered frames as pinhole images, with depth and instance ids that were worked out."""
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

    @cached_property
    def hand(self) -> int | None:
        """The instance id of what moves by itself: hands, and what they carry. None if nothing does."""
        return max(self.instances.every) + 1 if any(mask.any() for mask in self.moving) else None

    def scene(self) -> Scene:
        """What edits are made in."""
        return self.found().scene()

    def found(self) -> FoundInstances:
        """What there is: everything stands still but hands and what they carry."""
        still = np.tile(np.eye(4), (self.episode.length, 1, 1))
        bodies = tuple(Body(frozenset([h]), still, "static") for h in self.instances.every)
        beliefs = {"background": believed.BACKGROUND}
        if self.hand is not None:
            hand = frozenset([self.hand])
            bodies = (*bodies, Body(hand, still, "unknown", ambiguous=True))
            beliefs["robot"] = Belief(hand, SURE, (MOVES,))
        if table := believed.table(self.instances, self.spans):
            beliefs["table"] = table
        notes = believed.told(self.instances, self.spans, self.eye)
        return FoundInstances(
            self.episode, bodies, roles.held(beliefs), photographed=True, back=self,
            beliefs=beliefs, told=notes,
        )  # fmt: skip

    @cached_property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """First and last recorded frame of each piece of the model."""
        piece = np.array(self.pieces or [0] * len(self.model.times))
        times = [self.model.times[piece == number] for number in range(int(piece.max()) + 1)]
        return tuple((int(own.min()), int(own.max())) for own in times)

    @cached_property
    def _counted(self) -> Int64[np.ndarray, "t n"]:
        """Pixels of each instance id, frame by frame."""
        ids = [*self.instances.every, *([] if self.hand is None else [self.hand])]
        found = np.zeros((len(self.times), max(self.instances.every) + 2), np.int64)
        found[:, ids] = survey.counts(self.episode, tuple(ids))[..., 0]
        return found

    def jumps(self, instance_ids: Iterable[int]) -> tuple[int, list[Jump]]:
        """`jumps` of what frames show of these instances together; what was put in is none of theirs."""
        recorded = [one for one in instance_ids if one < self._counted.shape[1]]
        areas = self._counted[:, recorded].sum(1).tolist()
        return jumps(dict(zip(self.times, areas, strict=True)), int(np.prod(self.lens.size)))

    def unsteady(self, instance_ids: Iterable[int]) -> str:
        """Why these instances, painted together, would flicker; "" if they would not."""
        ids = sorted(instance_ids)
        steps, found = self.jumps(ids)
        if len(found) < FEW_JUMPS or len(found) <= UNSTEADY * steps:
            return ""
        return (
            f"{', '.join(map(str, ids))} comes and goes: what is seen of it jumps in {len(found)} of {steps} steps from"
            f" one frame to the next, first between frames {min(one.t for one in found)} and"
            f" {min(one.after for one in found)}"
        )

    @property
    def doubts(self) -> Mapping[str, tuple[str, ...]]:
        """Where edits of a role leave out frames, or may paint what has it not, in sentences; `things` are what is put
        in."""
        return {
            "table": believed.doubts(self.instances, self.spans),
            "background": (believed.BEHIND,),
            "things": believed.apart(self.spans),
        }

    @cached_property
    def eye(self) -> float:
        """The camera's height above its support, the median over the frames that have one."""
        above = self.model.cam_to_world[:, 2, 3] - (self.instances.level or 0.0)
        return float(np.median(above[above > 0])) if (above > 0).any() else 0.0

    def __call__(self, edited: Episode, everywhere: Everywhere) -> Episode:
        """The recording with the frames of an edited scene in it, and in all others what is edited everywhere."""
        before, after = self.episode.views[self.name], edited.views[self.name]
        recorded = self.recorded.views[self.name]
        view = recorded
        if after.rgb is not before.rgb:
            place = {int(t): k for k, t in enumerate(self.model.times)}

            def rgb(t: int) -> UInt8[np.ndarray, "h w 3"]:
                if t not in place:
                    return everywhere(recorded.rgb(t), self.name, t)
                k = place[t]
                return self.lens.bent(recorded.rgb(t), before.rgb(k), after.rgb(k))

            view = replace(recorded, rgb=rgb)
        return replace(self.recorded, views={self.name: view}, descriptions=edited.descriptions)

    def describe(self) -> dict[str, Any]:
        """Plain values for the report."""
        return {
            "frames": self.recorded.length,
            "registered": len(self.model.times),
            "passed_through": self.missing,
            "contradicted": list(self.contradicted),
            "moving_share": round(float(np.mean([m.mean() for m in self.moving])), 4)
            if self.moving
            else 0.0,
            "focal_px": round(self.model.focal, 2),
            "radial": round(self.model.radial, 5),
            "points": len(self.model.points),
            "ray_angle_degrees": round(self.model.angle(), 2),
            "unit": self.unit,
            "metric": self.unit != world.RELATIVE,
            "pieces": [list(span) for span in self.spans],
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
        return self._with_hands(k, self._on_support(k, depth))

    def _with_hands(self, k: int, depth: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """What moves by itself before what is around it, each part upright and at one depth."""
        if self.hand is None or not self.moving[k].any():
            return depth
        view = self.episode.views[self.name]
        assert view.ids is not None
        mine = (view.ids(k) == self.hand).astype(np.uint8)
        depth = depth.copy()
        count, parts = cv2.connectedComponents(mine)
        for number in range(1, count):
            window = bounds(parts == number, AROUND)
            part, near = parts[window] == number, depth[window]
            beside = near[grown(part, AROUND) & (mine[window] == 0)]
            near[part] = BEFORE * (np.quantile(beside, 0.1) if beside.size else near[part].min())
        return depth

    def _on_support(self, k: int, depth: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        if self.instances.level is None:
            return depth
        view = self.episode.views[self.name]
        assert view.ids is not None
        support = np.array(sorted(self.instances.support), np.int32)
        pose, level = self.model.cam_to_world[k], self.instances.level
        return laid(view.ids(k), depth, support, self.lens.K, pose, level)

    def _ids(self, k: int) -> Int32[np.ndarray, "h w"]:
        return self._find_ids(k) if self.kept is None else self.kept.frame(k, self._find_ids)

    def _find_ids(self, k: int) -> Int32[np.ndarray, "h w"]:
        return upsampled(self._tell(k), self.episode.views[self.name].rgb(k))

    @cached_property
    def _named(self) -> Callable[[int], tuple[PosedFrame, Int32[np.ndarray, "h w"]]]:
        """Each frame at the size that handles are told in, and what its segments are by themselves."""

        @lru_cache(KEPT)
        def named(k: int) -> tuple[PosedFrame, Int32[np.ndarray, "h w"]]:
            look = self.look(k)
            return look, self.instances.rough(look)

        return named

    def look(self, k: int) -> PosedFrame:
        """Frame `k` at the size that instance ids are told in."""
        t = int(self.model.times[k])
        view = self.episode.views[self.name]
        image = self.small.image(t, partial(view.rgb, k))
        seen = self.model.points[self.model.seen[k]]
        made = look_at(t, image, self.lens, self.model.cam_to_world[k], self.depths[k], self.small)
        return replace(made, sighted=seen, piece=self.pieces[k] if self.pieces else 0)

    @cached_property
    def _told(self) -> Callable[[int], UInt16[np.ndarray, "h w"]]:
        """The ids that each frame tells with those beside it, at their size."""
        return lru_cache(KEPT)(self._tell_alone)

    def _tell(self, k: int) -> UInt16[np.ndarray, "h w"]:
        """Ids of frame `k`; what it alone calls support is what the frames just before and after call it, where most of
        these say something else."""
        ids, level, support = self._told(k), self.instances.level, [*self.instances.support]
        if level is None or not support:
            return ids
        look = self._named(k)[0]
        rows, columns = np.nonzero(np.isin(ids, support))
        depth = plane_depth(look.K, look.cam_to_world, ids.shape, level)
        points = geometry.transform(look.cam_to_world, geometry.unproject(depth, look.K))
        shown, other = np.zeros(len(rows), int), np.zeros(len(rows), int)
        name = np.zeros(len(rows), np.uint16)
        for step in STEPS:
            if not 0 <= k + step < len(self.depths):
                continue
            other_look = self._named(k + step)[0]
            if other_look.piece != look.piece:  # how pieces lie beside each other is not known
                continue
            row, column, _ = other_look.sees(points[rows, columns])
            inside = row >= 0
            there = np.where(inside, self._told(k + step)[row, column], 0)
            off = inside & ~np.isin(there, support)
            shown, other = shown + inside, other + off
            name = np.where(off & (name == 0), there, name)
        out, most = ids.copy(), (other > shown / 2) & (other >= FEWEST)
        out[rows[most], columns[most]] = name[most]
        return out

    def _tell_alone(self, k: int) -> UInt16[np.ndarray, "h w"]:
        look, named = self._named(k)
        beside = [self._named(j) for j in (k - 1, k + 1) if 0 <= j < len(self.depths)]
        ids = self.instances.of(look, named, beside)
        if self.hand is not None:
            near = self.moving[max(0, k - RESTING) : k + RESTING + 1]
            hand = self.instances.covered(look, ids, self.moving[k], np.any(near, 0))
            ids = np.where(hand, self.hand, ids)
        return ids.astype(np.uint16)


@kernel
def laid(
    ids: Int32[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
    support: Int32[np.ndarray, "k"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
    level: float,
) -> Float32[np.ndarray, "h w"]:
    """Depth with the pixels of `support`, ascending ids, in the plane z = `level` where that is near: `plane_depth`."""
    out = depth.copy()
    if not len(support):
        return out
    for r in range(ids.shape[0]):
        y = (r - K[1, 2]) / K[1, 1]
        for c in range(ids.shape[1]):
            place = min(np.searchsorted(support, ids[r, c]), len(support) - 1)
            if support[place] != ids[r, c]:
                continue
            x = (c - K[0, 2]) / K[0, 0]
            met = (level - pose[2, 3]) / (pose[2, 0] * x + pose[2, 1] * y + pose[2, 2])
            if met > 0 and abs(met / depth[r, c] - 1) < SNAP:
                out[r, c] = met
    return out


def look_at(
    t: int,
    image: UInt8[np.ndarray, "h w 3"],
    lens: Lens,
    pose: Float64[np.ndarray, "4 4"],
    depth: Float32[np.ndarray, "a b"],
    small: SmallFrames,
) -> PosedFrame:
    """The recorded frame `t`, of which `small` holds this image, with its segments found once."""
    fitting = 1 / cv2.resize(1 / depth, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    K = reduced_lens(lens.K, *lens.size, LOOK_WIDTH)
    segmented = partial(small.segments, t)
    return PosedFrame(image, fitting.astype(np.float32), K, pose, segmented=segmented)
