"""Make a thing larger or smaller where it stands, or about the place where it is gripped."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float64
from pydantic import AfterValidator, Field

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Body, Effect, Scene
from rpaug.operators.fields import Interval
from rpaug.scene.lighting import shadows
from rpaug.scene.placement import grip, growing, placing, untouched
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import targets


def _names(instance_ids: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(instance_ids)))


def _foot(scene: Scene, instance_ids: frozenset[int]) -> float:
    """The height on which the instances stand: of one of them the lowest, however little of it was seen."""
    clouds = placing.points_by_instance_id(scene, instance_ids).values()
    seen = [points[:, 2] for points in clouds if len(points) >= grip.FEW]
    return min(float(np.quantile(heights, 0.005)) for heights in seen)


def _positive(value: tuple[float, float]) -> tuple[float, float]:
    if not 0.1 <= value[0] <= value[1] <= 10:
        raise ValueError(f"{list(value)} is not within 0.1..10")
    return value


SEEN = 0.02  # of its size: changes that are smaller are half a pixel or so


def _seen(low: float, high: float) -> list[tuple[float, float]]:
    """The factors from `low` to `high` at which the change is `SEEN`: below 1, above 1, both or neither."""
    sides = (low, min(high, 1 - SEEN)), (max(low, 1 + SEEN), high)
    return [(least, most) for least, most in sides if least <= most]


def _drawn(ranges: list[tuple[float, float]], rng: np.random.Generator) -> float:
    """A number from these ranges, any as likely."""
    along = float(rng.uniform(0, sum(high - low for low, high in ranges)))
    for low, high in ranges[:-1]:
        if along < high - low:
            return low + along
        along -= high - low
    return ranges[-1][0] + along


Scales = Annotated[Interval[float], AfterValidator(_positive)]


@dataclass(frozen=True, kw_only=True)
class ObjectSize(Operator):
    """Scale `target`, with all that it holds, by a factor drawn from `range`, the same along all axes.

    `about` is what stays in place: the middle of its foot, or where the gripper holds it. Only factors are drawn at
    which every contact with the robot, and with what it moves, still holds to within `contact` metres, and that are
    `SEEN` where `range` has such ones; if none is left, the edit is refused with the number.
    """

    target: targets.Target
    range: Scales = (0.75, 1.25)
    about: Literal["support", "grasp"] = "support"
    contact: Annotated[float, Field(gt=0, le=0.1)] = 0.004  # metres

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    needs: ClassVar[Needs] = Needs(targets=("target",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "scale": "scale, resize, rescale, size, sizes, enlarge, grow, shrink, magnify, downsize, "
        "upscale, scaled, double the size of, halve the size of",
        "bigger": "bigger, larger, big, large, enlarged, grown, up in size",
        "smaller": "smaller, small, tiny, down in size, shrunk",
        "size_of": "as large, as big, its size, the size, the original size, of its size, "
        "original size, as much, as bright, of the light, of the original, "
        "of its original size, their size",
    }
    phrases: ClassVar[tuple[str, ...]] = (
        "resize {target} [to between {range:number} and {range:number} times its size]",
    )
    examples: ClassVar[Examples] = (
        ("make the bowl a fifth smaller", {"target": "bowl", "range": [0.8, 0.8]}),
        ("vary the cup's size by 10 %", {"target": "cup", "range": [0.9, 1.1]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("size", "resizing")
    settles: ClassVar[str] = "size"

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        asked = targets.find(scene, self.target)
        untouched.check_seen(scene, self.target, "resizing")
        inside, leaving = growing.held(scene, asked)
        instance_ids = asked | inside
        pivot = self._pivot(scene, instance_ids)
        low, high = self.range
        worst = tightest = None
        touching = grip.contacts(scene, look(scene.episode), instance_ids, pivot)
        for touched in (*touching, *self._standing(scene, instance_ids, leaving, pivot)):
            bears = self.contact / max(abs(touched.growth), 1e-9)
            if 1 - bears > high or 1 + bears < low:
                worst = touched
            if tightest is None or abs(touched.growth) > abs(tightest.growth):
                tightest = touched
            low, high = max(low, 1 - bears), min(high, 1 + bears)
        if worst is not None or low > high:
            raise Unsupported(self._reason(worst, instance_ids))
        room = self._with_room(scene, instance_ids, pivot, low, high)
        cramped, high = room < high, room
        factors = _seen(low, high)
        if not factors and _seen(*self.range):
            holds = "is there room for it"
            if tightest is not None and not cramped:
                holds = f"does the contact with {tightest.with_} at frame {tightest.t} hold"
            raise Unsupported(
                f"resizing {_names(instance_ids)}: only at {low:.3g} to {high:.3g} times its size {holds}, "
                "which is too little to be seen"
            )
        return {
            "handles": sorted(instance_ids),
            "scale": _drawn(factors or [(low, high)], rng),
            "pivot": pivot.tolist(),
            "allowed": [low, high],
            "lamps": shadows.lamps(scene),
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        instance_ids, scale = frozenset(edit["handles"]), edit["scale"]
        # Scaling is about the frame's origin; this puts the pivot back.
        shift = geometry.rigid(np.zeros(3), (1 - scale) * np.array(edit["pivot"]))
        bodies: list[Body] = []
        for body in scene.bodies:
            held = body.instance_ids & instance_ids
            if not held or body.copy_of:
                bodies.append(body)
                continue
            grown = replace(
                body, instance_ids=held, scale=body.scale * scale, to_world=body.to_world @ shift
            )
            bodies.append(grown)
            if rest := body.instance_ids - held:
                bodies.append(replace(body, instance_ids=rest))
        after = replace(scene, bodies=tuple(bodies), recorded_bodies=scene.tracked)
        return shadows.follow(scene, after, edit["lamps"])

    def _standing(
        self,
        scene: Scene,
        instance_ids: frozenset[int],
        leaving: Mapping[frozenset[int], float],
        pivot: Float64[np.ndarray, "3"],
    ) -> Iterator[grip.Contact]:
        """Contacts at the first frame with what the instances stand on, and with what stands in or on them for now."""
        still = [b for b in scene.bodies if b.instance_ids & instance_ids and b.motion == "static"]
        if still:
            foot = _foot(scene, frozenset().union(*(body.instance_ids for body in still)))
            yield grip.Contact("what it stands on", 0, pivot[2] - foot)
        for others, height in leaving.items():
            yield grip.Contact(
                f"what it holds for a while ({_names(others)})", 0, height - pivot[2]
            )

    def _with_room(
        self,
        scene: Scene,
        instance_ids: frozenset[int],
        pivot: Float64[np.ndarray, "3"],
        low: float,
        high: float,
    ) -> float:
        """The largest factor at which it meets nothing. Raises Unsupported, with the number, if that is too small."""
        body = next(body for body in scene.bodies if body.instance_ids & instance_ids)
        where = geometry.transform(body.to_world[0], pivot)
        fits, what = growing.largest(scene, instance_ids, where, high)
        if fits < low:
            raise Unsupported(
                f"resizing {_names(instance_ids)}: at {low:g} times its size it meets {what}; "
                f"{fits:.3g} is the most it has room for"
            )
        return fits

    def _pivot(self, scene: Scene, instance_ids: frozenset[int]) -> Float64[np.ndarray, "3"]:
        """What stays in place, in the bodies' own frames."""
        points = placing.points_of(scene, instance_ids)
        if len(points) < grip.FEW:
            raise Unsupported(f"resizing {self.target}: too little of it was seen")
        body = next(body for body in scene.bodies if body.instance_ids & instance_ids)
        if self.about == "support":
            outline = placing.hull(points)
            x, y = (outline.min(0) + outline.max(0)) / 2
            return geometry.transform(
                geometry.inverse(body.to_world[0]),
                np.array([x, y, _foot(scene, instance_ids)]),
            )
        taken = grip.grasps(scene, body.to_world)
        if not taken:
            raise Unsupported(f"resizing {self.target} about its grasp: the robot does not move it")
        poses = scene.episode.robot.gripper_to_world
        assert poses is not None
        return geometry.transform(geometry.inverse(body.to_world[taken[0]]), poses[taken[0], :3, 3])

    def _reason(self, worst: grip.Contact | None, instance_ids: frozenset[int]) -> str:
        names = _names(instance_ids)
        if worst is None:
            return f"resizing {names}: no factor in {list(self.range)} suits all its contacts"
        nearest = min(self.range, key=lambda scale: abs(scale - 1))
        off = 1000 * (nearest - 1) * worst.growth
        what = "the contact is lost" if off < 0 else "it sinks in"
        return (
            f"resizing {names}: even at {nearest:g} times its size the contact with {worst.with_} at frame {worst.t} "
            f"no longer holds: {what} by {abs(off):.1f} mm, and {1000 * self.contact:g} mm are allowed"
        )
