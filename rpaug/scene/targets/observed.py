"""What sampled frames say about each instance: its surface, how it moves beside the gripper, what it is near."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core.jit import kernel
from rpaug.core.types import Body, Episode
from rpaug.scene.sampled_frames import SampledFrames

TOUCH = 0.005  # metres beyond what two pixels are apart: nearer surfaces touch
BESIDE = 0.05  # metres: what is so near may push a thing, where its own contact is hidden
FAR = 0.10  # metres: gaps beyond it are not measured
NO_LESS = 1 + 1e-9  # times a square: a greater one has no smaller root, whatever rounding does
MOST = 200  # points of each of two instances between which a gap is measured
FEW = 4  # sampled frames that show what touches before the robot did anything, or when it is done
STEP = 0.005  # metres between sampled frames: the gripper moves that goes farther
STRAY = 0.75  # of the gripper's way: what is seen of a thing that rides on it strays less
REST = 0.002  # metres between sampled frames: what goes less far rests


@dataclass(frozen=True)
class Thing:
    """One instance: its points and unit normals in the frame of its body, `low` and `high` bounds of nearly all."""

    instance_id: int
    body: Body
    points: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    low: Float64[np.ndarray, "3"]
    high: Float64[np.ndarray, "3"]

    @property
    def static(self) -> bool:
        return self.body.motion == "static"

    @property
    def size(self) -> Float64[np.ndarray, "3"]:
        return self.high - self.low


def surface(
    sampled: SampledFrames, instance_id: int, body: Body, most: int = 4000
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Points and normals of an instance in its body's frame, from fixed cameras if they saw it at all."""
    flat = np.flatnonzero(sampled.ids.reshape(-1) == instance_id)
    flat = flat[sampled.depth.reshape(-1)[flat] > 0]
    fixed = sampled.fixed[flat // np.prod(sampled.ids.shape[2:], dtype=int) % len(sampled.cameras)]
    flat = flat[fixed] if fixed.any() else flat
    s, c, r, k = np.unravel_index(flat[:: max(1, -(-len(flat) // most))], sampled.ids.shape)
    back = np.linalg.inv(body.to_world[sampled.frames[s]])
    points = np.einsum("nij,nj->ni", back[:, :3, :3], sampled.points[s, c, r, k]) + back[:, :3, 3]
    return points, np.einsum("nij,nj->ni", back[:, :3, :3], sampled.normals_at(s, c, r, k))


@dataclass(frozen=True)
class Evidence:
    """Things by instance id, and what was seen of them in the sampled frames.

    `gripper` is where the gripper was, None where nobody recorded it. `gaps[s, i, j]` are metres between the i-th and
    the j-th thing beyond two pixels' spacing, FAR at most, nan where one is unseen.
    """

    things: Mapping[int, Thing]
    sampled: SampledFrames
    gripper: Float64[np.ndarray, "s 3"] | None
    gaps: Float64[np.ndarray, "s n n"]

    @cached_property
    def place(self) -> Mapping[int, int]:
        """Where in `gaps` each thing stands."""
        return {instance_id: k for k, instance_id in enumerate(self.things)}

    def touch(self, one: int, others: Collection[int]) -> Bool[np.ndarray, "s"]:
        """In which frames a thing touches any of the others."""
        among = [self.place[other] for other in others if other != one]
        return np.any(self.gaps[:, self.place[one]][:, among] < TOUCH, 1)

    def share(self, one: int, other: int) -> float:
        """Share of the frames that show both in which they touch; 0 where no frame shows both."""
        return float((self._shown(one, other) < TOUCH).mean())

    def strongest(self, one: int, others: Collection[int]) -> float:
        """The largest share with any of the others."""
        return max((self.share(one, other) for other in others if other != one), default=0)

    def early(self, one: int, others: Collection[int]) -> float:
        """The largest share with any of the others in the first frames that show both."""
        return max((float((self._shown(one, o)[:FEW] < TOUCH).mean()) for o in others), default=0.0)

    def late(self, one: int, other: int, apart: float = TOUCH) -> float:
        """In what share of the last frames that show both the other is nearer than so many metres."""
        return float((self._shown(one, other)[-FEW:] < apart).mean())

    def _shown(self, one: int, other: int) -> Float64[np.ndarray, "k"]:
        """Gaps in the frames that show both; FAR if there are none."""
        gap = self.gaps[:, self.place[one], self.place[other]]
        both = gap[~np.isnan(gap)]
        return both if len(both) else np.array([FAR])

    def middle(self, one: int) -> Float64[np.ndarray, "s 3"]:
        """Where the middle of a thing is."""
        thing = self.things[one]
        poses = thing.body.to_world[self.sampled.frames]
        return poses[:, :3, :3] @ ((thing.low + thing.high) / 2) + poses[:, :3, 3]

    def steps(self, one: int) -> Float64[np.ndarray, "s-1"]:
        """How far the middle of a thing goes from each sampled frame to the next."""
        return np.linalg.norm(np.diff(self.middle(one), axis=0), axis=-1)

    def bounds(
        self, one: int, frame: int
    ) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        """The corners of a thing's box where it is in a sampled frame."""
        middle, half = self.middle(one)[frame], self.things[one].size / 2
        return middle - half, middle + half

    def pushed(
        self, one: int, acted: Mapping[int, Bool[np.ndarray, "s-1"]]
    ) -> Bool[np.ndarray, "s-1"]:
        """In which steps a thing moves with another beside it that the robot acts through in that step."""
        out = np.zeros(len(self.gaps) - 1, bool)
        for other, steps in acted.items():
            beside = self.gaps[:, self.place[one], self.place[other]] < BESIDE
            out |= steps & (beside[1:] | beside[:-1])
        return out & (self.steps(one) > REST)

    def rides(self, one: int, reach: float) -> bool:
        """Is all that is ever seen of a thing within reach of the gripper, in metres, and where the gripper is then?

        It strays from the gripper by less than STRAY of the gripper's way, as other sides of it are seen; what stands
        still strays by all of it.
        """
        at = np.nonzero((self.sampled.ids == one) & (self.sampled.depth > 0))
        if self.gripper is None:
            return False
        apart = self.sampled.points[at] - self.gripper[at[0]]
        frames = np.unique(at[0])
        stray = np.ptp([np.median(apart[at[0] == s], 0) for s in frames], 0)
        way = np.ptp(self.gripper[frames], 0)
        near = np.linalg.norm(apart, axis=-1) < reach
        return bool(near.all() and np.linalg.norm(stray) < STRAY * np.linalg.norm(way))

    def rest(self, one: int) -> float:
        """Share of the steps of a moving gripper in which a thing stays where it is; 0 for want of a gripper."""
        if self.gripper is None:
            return 0.0
        moving = np.linalg.norm(np.diff(self.gripper, axis=0), axis=-1) > STEP
        return float((self.steps(one)[moving] < REST).mean()) if moving.any() else 0.0


def gather(episode: Episode, bodies: Sequence[Body], sampled: SampledFrames) -> Evidence:
    """Look at everything that fills a surface. What never does (no pixel beside its own kind, or all at the far end of
    every image, as renderers mark what is void) is no thing."""
    things = {}
    for body in bodies:
        for instance_id in body.instance_ids:
            points, normals = surface(sampled, instance_id, body)
            if not len(points) or not normals.any() or _void(sampled, instance_id):
                continue
            low, high = np.percentile(points, [1, 99], axis=0)
            things[instance_id] = Thing(instance_id, body, points, normals, low, high)
    poses = episode.robot.gripper_to_world
    gripper = None if poses is None else poses[sampled.frames, :3, 3]
    return Evidence(things, sampled, gripper, _gaps(sampled, list(things)))


def _void(sampled: SampledFrames, instance_id: int) -> bool:
    """Is it as far as anything in its images, exactly, in two images that see it from different places?"""
    cameras = np.flatnonzero((sampled.ids == instance_id).any((0, 2, 3)))
    if len(cameras) == 1 and sampled.fixed[cameras[0]]:
        return False
    for c in cameras:
        depth = sampled.depth[:, c]
        if np.ptp(depth[sampled.ids[:, c] == instance_id]) > 1e-6 * depth.max():
            return False
    return True


def _gaps(sampled: SampledFrames, instance_ids: Sequence[int]) -> Float64[np.ndarray, "s n n"]:
    count = len(instance_ids)
    order = np.argsort(instance_ids)
    focal = sampled.K[:, 0, 0][:, None, None]
    out = np.full((len(sampled.frames), count, count), np.nan)
    for s in range(len(sampled.frames)):
        apart = np.full((count, count), np.nan)
        _between(
            sampled.ids[s].ravel(),
            sampled.depth[s].ravel(),
            (sampled.depth[s] / focal).ravel(),
            sampled.points[s].reshape(-1, 3),
            np.array(instance_ids, np.int32)[order],
            apart,
        )
        out[s][np.ix_(order, order)] = apart
    return out


@kernel
def _between(ids, depth, pixel, points, instance_ids, out):
    """Fill the gaps of one frame, (n, n); `pixel` is the metres that a pixel is wide at its depth."""
    count = len(instance_ids)
    label = np.full(len(ids), -1, np.int32)
    size = np.zeros(count + 1, np.int64)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    last, place = -1, -1
    for i in range(len(ids)):
        if ids[i] <= 0 or depth[i] <= 0:
            continue
        if ids[i] != last:
            last, place = ids[i], np.searchsorted(instance_ids, ids[i])
            if place == count or instance_ids[place] != last:
                place = -1
        if place >= 0:
            label[i] = place
            size[place + 1] += 1
            for axis in range(3):
                low[place, axis] = min(low[place, axis], points[i, axis])
                high[place, axis] = max(high[place, axis], points[i, axis])
    start = np.cumsum(size)
    order = np.zeros(start[-1], np.int64)
    fill = start[:-1].copy()
    for i in range(len(ids)):
        if label[i] >= 0:
            order[fill[label[i]]] = i
            fill[label[i]] += 1
    for a in range(count):
        for b in range(a):
            if size[a + 1] == 0 or size[b + 1] == 0:
                continue
            out[a, b] = out[b, a] = FAR
            beyond = 0.0
            for axis in range(3):
                apart = max(low[a, axis] - high[b, axis], low[b, axis] - high[a, axis])
                beyond = max(beyond, apart)
            if beyond > FAR:
                continue
            mine = _within(order[start[a] : start[a + 1]], points, low[b], high[b])
            other = _within(order[start[b] : start[b + 1]], points, low[a], high[a])
            best = FAR
            for i in mine:
                for j in other:
                    square = 0.0
                    for axis in range(3):
                        square += (points[i, axis] - points[j, axis]) ** 2
                    wide = 2 * max(pixel[i], pixel[j])
                    if square < NO_LESS * (best + wide) ** 2:  # else the root is greater
                        best = min(best, np.sqrt(square) - wide)
                if best <= 0.0:
                    break
            out[a, b] = out[b, a] = max(best, 0.0)


@kernel
def _within(chosen, points, low, high):
    """At most about MOST of the chosen points, of those within FAR of a box."""
    found = np.zeros(len(chosen), np.int64)
    n = 0
    for i in chosen:
        inside = True
        for axis in range(3):
            if points[i, axis] < low[axis] - FAR or points[i, axis] > high[axis] + FAR:
                inside = False
        if inside:
            found[n] = i
            n += 1
    return found[: n : max(1, -(-n // MOST))].copy()
