"""What each instance does in the task, from how it moves and where it stands: never from its name or number.

The world's z axis points up. A role that cannot be known (nothing moved, one frame only) is absent.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from rpaug.core.types import Body, Episode
from rpaug.scene.sampled_frames import SampledFrames, look
from rpaug.scene.tracking.chain import OFTEN
from rpaug.scene.tracking.touch import touching

NAMES = ("manipulated", "receiver", "robot", "table", "background")

LATE = (
    0.2  # share of the episode: what rests longer and is no known arm's link was moved by the robot
)
RISE = 0.05  # metres: less lift than this over a support is standing on it
LEVEL = 0.02  # metres: surfaces of one table top differ by less
FLAT = 0.8  # share of an instance's surface that is level, if it is a support
BROAD = 0.3  # metres: a support is at least this long and wide
NEAR = 0.03  # metres: parts of one piece of furniture are within each other's outline by less


@dataclass(frozen=True)
class _Thing:
    """What one instance looks like at the reference frame of its body."""

    instance_id: int
    body: Body
    low: Float64[np.ndarray, "3"]
    high: Float64[np.ndarray, "3"]
    level: float  # share of the surface whose normal is vertical

    @property
    def static(self) -> bool:
        return self.body.motion == "static"

    @property
    def size(self) -> Float64[np.ndarray, "3"]:
        return self.high - self.low

    @property
    def support(self) -> bool:
        """Flat, level and broad: a table top or a floor."""
        return self.static and self.level > FLAT and bool(self.size[:2].min() > BROAD)


def infer(
    episode: Episode, bodies: Sequence[Body], sampled: SampledFrames | None = None
) -> Mapping[str, frozenset[int]]:
    """Handles by role; see NAMES. Every instance id has one role at most, but for a table
    that is the receiver, and some have none.

    robot: what hangs on the gripper from the first frame, what touches it most of the time and moves, and the
    base that this chain grows out of. manipulated: what else moves, or if nothing does what the gripper touches longest
    (a button that moves less than its recording shows). receiver: the static thing that the
    manipulated touches at the end, with all that stands within its outline; the table only if there is
    nothing else. table: the level surface that things stand on. background: what is left and larger than the
    table, or outside its bounds.
    """
    sampled = look(episode) if sampled is None else sampled
    things = {thing.instance_id: thing for thing in _things(bodies, sampled)}
    robot = _robot(things, sampled)
    later = _gripper_start(episode)
    manipulated = frozenset(
        h
        for h, thing in things.items()
        if not thing.static and h not in robot and (robot or _start(thing.body) > later)
    )
    table = _table(things, sampled, robot, manipulated)
    background = _background(things, table, robot | manipulated)
    manipulated = manipulated or _pressed(things, sampled, robot, robot | table | background)
    receiver = _receiver(things, sampled, manipulated, robot | background | manipulated, table)
    found = {
        "manipulated": manipulated,
        "receiver": receiver,
        "robot": robot,
        "table": table,
        "background": background,
    }
    return {name: instance_ids for name, instance_ids in found.items() if instance_ids}


def _things(bodies: Sequence[Body], sampled: SampledFrames) -> list[_Thing]:
    out = []
    for body in bodies:
        for instance_id in body.instance_ids:
            points, normals = surface(sampled, instance_id, body)
            if len(points):
                low, high = np.percentile(points, [1, 99], axis=0)
                flat = np.abs(normals[:, 2]) > 0.95
                faces = np.linalg.norm(normals, axis=-1) > 0
                level = float(flat.sum() / max(faces.sum(), 1))
                out.append(_Thing(instance_id, body, low, high, level))
    return out


def surface(
    sampled: SampledFrames, instance_id: int, body: Body, most: int = 4000
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Points and normals of an instance in its body's frame, from fixed cameras if they saw it at all."""
    shown = (sampled.ids == instance_id) & (sampled.depth > 0)
    if shown[:, sampled.fixed].any():
        shown[:, ~sampled.fixed] = False
    at = np.stack(np.nonzero(shown), -1)
    at = at[:: max(1, -(-len(at) // most))]
    s, c, r, k = at.T
    back = np.linalg.inv(body.to_world[sampled.frames[s]]) if len(at) else np.zeros((0, 4, 4))
    points = np.einsum("nij,nj->ni", back[:, :3, :3], sampled.points[s, c, r, k]) + back[:, :3, 3]
    return points, np.einsum("nij,nj->ni", back[:, :3, :3], sampled.normals[s, c, r, k])


def _robot(things: Mapping[int, _Thing], sampled: SampledFrames) -> frozenset[int]:
    """The chain that ends at the gripper."""
    hand = {
        h
        for h, thing in things.items()
        if thing.body.motion == "gripper" and _moves_first(thing.body, things)
    }
    if not hand:
        return frozenset()
    links = {h for h, thing in things.items() if thing.body.motion == "link"}
    late = LATE * len(next(iter(things.values())).body.to_world)
    movers = {
        h
        for h, thing in things.items()
        if thing.body.motion in ("aligned", "unknown") and _start(thing.body) < late
    }
    rest = {h for h, thing in things.items() if thing.static and not thing.support}
    often = _often(sampled)
    chain = _grown(hand | links, movers, often)
    return frozenset(_grown(chain, {h for h in rest if things[h].size.max() < 2 * BROAD}, often))


def _pressed(
    things: Mapping[int, _Thing],
    sampled: SampledFrames,
    robot: frozenset[int],
    not_these: frozenset[int],
) -> frozenset[int]:
    """What the gripper touches in most frames, if it touches anything."""
    gripper = {h for h in robot if things[h].body.motion == "gripper"}
    touched: dict[int, int] = {}
    for pair, count in touching(sampled).items():
        for h in (pair - not_these) & things.keys() if pair & gripper else ():
            touched[h] = touched.get(h, 0) + count
    return frozenset({max(touched, key=lambda h: touched[h])}) if touched else frozenset()


def _moves_first(body: Body, things: Mapping[int, _Thing]) -> bool:
    """Does the body move as soon as anything does?"""
    starts = [_start(thing.body) for thing in things.values() if not thing.static]
    return _start(body) <= min(starts) + 1


def _gripper_start(episode: Episode) -> int:
    """The first frame at which the gripper is not where it began; the episode's length if it never leaves."""
    poses = episode.robot.gripper_to_world
    if poses is None:
        return episode.length
    moved = np.abs(poses - poses[:1]).max((1, 2)) > 1e-4
    return int(np.argmax(moved)) if moved.any() else len(moved)


def _start(body: Body) -> int:
    """The first frame at which the body is not where it was at the beginning."""
    moved = np.abs(body.to_world - body.to_world[:1]).max((1, 2)) > 1e-6
    return int(np.argmax(moved)) if moved.any() else len(moved)


def _often(sampled: SampledFrames) -> set[frozenset[int]]:
    """Pairs that touch in most of the frames in which fixed cameras show both."""
    seen = {
        int(h): (sampled.ids[:, sampled.fixed] == h).any((1, 2, 3)) for h in sampled.instance_ids
    }
    return {
        pair
        for pair, count in touching(sampled).items()
        if count >= OFTEN * max((seen[min(pair)] & seen[max(pair)]).sum(), 1)
    }


def _grown(seed: set[int], among: set[int], pairs: set[frozenset[int]]) -> set[int]:
    """The seed and all that hangs on it through touching members of `among`."""
    chain, fresh = set(seed), set(seed)
    while fresh:
        fresh = {h for h in among - chain if any(frozenset({h, c}) in pairs for c in fresh)}
        chain |= fresh
    return chain


def _table(
    things: Mapping[int, _Thing],
    sampled: SampledFrames,
    robot: frozenset[int],
    manipulated: frozenset[int],
) -> frozenset[int]:
    """The support that most other things touch, and what lies in its plane."""
    supports = {h: thing for h, thing in things.items() if thing.support}
    if not supports:
        return frozenset()
    stands: dict[int, float] = dict.fromkeys(supports, 0.0)
    for pair in touching(sampled):
        for h in pair & supports.keys():
            other = next(iter(pair - {h}))
            if (
                other in things
                and other not in supports
                and things[other].low[2] < supports[h].high[2] + RISE
            ):
                stands[h] += 1 + (other in manipulated)
    # A table top may be hidden behind what stands on it: of equals the upper one, then the larger.
    best = max(
        supports, key=lambda h: (stands[h], supports[h].high[2], supports[h].size[:2].prod())
    )
    height = supports[best].high[2]
    return frozenset(
        h
        for h, thing in supports.items()
        if abs(thing.high[2] - height) < LEVEL and _overlap(thing, supports[best])
    )


def _overlap(a: _Thing, b: _Thing) -> bool:
    return bool((a.low[:2] < b.high[:2]).all() and (b.low[:2] < a.high[:2]).all())


def _background(
    things: Mapping[int, _Thing], table: frozenset[int], taken: frozenset[int]
) -> frozenset[int]:
    """What stands still and is broader than the table, or begins beyond it."""
    if not table:
        return frozenset()
    low = np.min([things[h].low for h in table], 0)
    high = np.max([things[h].high for h in table], 0)
    broad = (high - low)[:2].max()
    return frozenset(
        h
        for h, thing in things.items()
        if thing.static
        and h not in table | taken
        and (
            thing.size.max() > broad
            or (thing.low[:2] > high[:2]).any()
            or (thing.high[:2] < low[:2]).any()
            or thing.high[2] < low[2] - RISE
        )
    )


def _receiver(
    things: Mapping[int, _Thing],
    sampled: SampledFrames,
    manipulated: frozenset[int],
    not_these: frozenset[int],
    table: frozenset[int],
) -> frozenset[int]:
    """What the manipulated touches in the last frames, and what stands within that thing's outline."""
    tail = slice(-max(2, len(sampled.frames) // 8), None)
    touched: dict[int, int] = {}
    for pair, count in touching(sampled, tail).items():
        for h in pair - manipulated:
            if pair & manipulated and h in things and things[h].static and h not in not_these:
                touched[h] = touched.get(h, 0) + count
    candidates = {h for h in touched if h not in table} or set(touched)
    if not candidates:
        return frozenset()
    main = max(candidates, key=lambda h: (touched[h], things[h].size.prod()))
    if main in table:
        return table
    outline = things[main]
    return frozenset(
        h
        for h, thing in things.items()
        if thing.static
        and h not in not_these | table
        and (thing.low[:2] > outline.low[:2] - NEAR).all()
        and (thing.high[:2] < outline.high[:2] + NEAR).all()
    )
