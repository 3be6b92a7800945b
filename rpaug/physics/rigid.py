"""Things too stiff to deform: solids or convex hulls in MuJoCo, among what stands still and what is moved."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, Float64

from rpaug.core import geometry, simulation
from rpaug.physics.colliders import Boxes
from rpaug.physics.solids import Solid, around

if TYPE_CHECKING:
    import mujoco

STEP = 0.00025  # seconds: with longer ones a cylinder that topples is turned aside, by where MuJoCo puts its contacts
STRIP = 0.005  # metres: what stands still becomes columns with sides as long
LEAST_HALF = 5e-4  # metres
PIECE, PIECES = (
    0.006,
    800,
)  # metres, and the most: balls that the surface of what is on a rail is made of
PIN = 0.005  # metres: radius of what a hinge turns on
HOLDS = 1.1  # times the torque that a stiff hinge was seen to hold: what it takes to turn it
HEAVY = 1e4  # kilograms: what nothing on a table pushes away
# MuJoCo's solver stops at a share of the mean inertia; the boxes' would let it stop before the light thing is right.
EXACT = 1e-14
IMPRATIO = 10  # friction's stiffness beside that of contact: what rests or rolls creeps less


@dataclass(frozen=True)
class Fall:
    """What a rigid simulation came to: world motions of the thing from its start, one a frame, and the impulse in
    newton seconds that each moving box gave it."""

    motions: Float64[np.ndarray, "t 4 4"]
    boxes: Float64[np.ndarray, "b"]
    steps: int


@dataclass(frozen=True)
class Rail:
    """A unit vector in the world that a thing may go along, from `low` to `high` metres from where it is, without
    turning; one of no length holds it fast."""

    axis: tuple[float, float, float]
    low: float
    high: float

    @property
    def fixed(self) -> bool:
        """Whether it leaves the thing where it is."""
        return self.low >= self.high

    def describe(self) -> dict[str, Any]:
        """Plain values; lengths in metres."""
        if self.fixed:
            return {"joint": "fixed"}
        numbers = {"axis": [round(float(v), 4) for v in self.axis]}
        return {"joint": "slide", **numbers, "range": [round(self.low, 4), round(self.high, 4)]}


@dataclass(frozen=True)
class Hinge:
    """A point and a unit vector in the world that a thing may turn about, from `low` to `high` radians from how it is.

    A `stiff` one was seen to hold the thing where its weight would turn it.
    """

    at: tuple[float, float, float]
    axis: tuple[float, float, float]
    low: float
    high: float
    stiff: bool = False

    fixed: ClassVar[bool] = False

    def lever(self, point: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3"]:
        """Metres that a point goes for each radian."""
        return np.cross(self.axis, point - np.array(self.at))

    def describe(self) -> dict[str, Any]:
        """Plain values; lengths in metres, angles in degrees."""
        numbers = {
            "axis": [round(float(v), 4) for v in self.axis],
            "at": [round(float(v), 4) for v in self.at],
        }
        span = [round(float(np.rad2deg(v)), 2) for v in (self.low, self.high)]
        return {"joint": "hinge", **numbers, "range_degrees": span}


@dataclass(frozen=True)
class Rigid:
    """A thing by surface points in the world, in metres, with its density in kg/m3: their convex hull, or a `solid`.

    `columns` (x, y, half width, bottom, top) and a floor at `level` stand still; `boxes` are moved, and give no way.
    `friction` is Coulomb's on what stands still, `grip` that on boxes; `velocity` is the thing's at first. On a `rail`
    or a hinge it is not hindered by what stands still, `friction` times its weight is what that takes, and boxes meet
    its surface as it was seen instead of its convex hull: a drawer's grip is hollow.
    """

    points: Float64[np.ndarray, "n 3"]
    density: float
    level: float | None
    columns: Float64[np.ndarray, "c 5"] = field(default_factory=lambda: np.zeros((0, 5)))
    boxes: Boxes | None = None
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    friction: float = 0.5
    grip: float = 1.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rail: Rail | Hinge | None = None
    solid: Solid | None = None

    def run(self, frames: int, pace: float, start: float = 0.0) -> Fall:
        """So many frames, `pace` seconds apart, the first of them as the thing is; boxes are met from `start` on."""
        mujoco = simulation.mujoco()

        model = mujoco.MjModel.from_xml_string(self._described())
        data = mujoco.MjData(model)
        thing = model.body("thing").id
        first = model.body_geomadr[thing] - self._count
        if self.rail is None:
            data.qvel[-6:-3] = self.velocity
        elif not self.rail.fixed:
            mujoco.mj_forward(model, data)
            start_speed, model.dof_frictionloss[-1] = self._held(
                float(model.body_mass[thing]), data.xipos[thing]
            )
            data.qvel[-1] = start_speed
        self._move(data, start)
        mujoco.mj_forward(model, data)
        before, steps = _pose(data, thing), max(1, round(pace / STEP))
        model.opt.timestep = pace / steps
        given, motions, force = np.zeros(self._count), [np.eye(4)], np.zeros(6)
        for k in range((frames - 1) * steps):
            self._move(data, start + k * pace / steps)
            mujoco.mj_step(model, data)
            for c in range(data.ncon):
                other = min(data.contact[c].geom1, data.contact[c].geom2)  # the thing comes last
                if first <= other < first + self._count:
                    mujoco.mj_contactForce(model, data, c, force)
                    given[other - first] += abs(force[0]) * pace / steps
            if (k + 1) % steps == 0:
                motions.append(_pose(data, thing) @ geometry.inverse(before))
        return Fall(np.stack(motions), given, (frames - 1) * steps)

    def _held(self, mass: float, middle: Float64[np.ndarray, "3"]) -> tuple[float, float]:
        """How fast the thing goes on its joint at first, and what friction takes: a force, or a torque."""
        weight = mass * float(np.linalg.norm(self.gravity))
        if isinstance(self.rail, Hinge):
            lever = self.rail.lever(middle)
            pull = abs(float(lever @ np.array(self.gravity))) * mass if self.rail.stiff else 0.0
            speed = float(lever @ np.array(self.velocity)) / max(float(lever @ lever), 1e-9)
            return speed, max(self.friction * weight * PIN, HOLDS * pull)
        assert self.rail is not None
        return float(np.dot(self.velocity, self.rail.axis)), self.friction * weight

    @property
    def _count(self) -> int:
        return 0 if self.boxes is None else len(self.boxes.radius)

    def _move(self, data: "mujoco.MjData", seconds: float) -> None:
        """Boxes are put where they are now, with their speeds: whatever pushed them back is undone."""
        if self.boxes is None:
            return
        rows, n = self.boxes(seconds), self._count
        turns = rows[:, 3:12].reshape(-1, 3, 3)
        poses = np.tile(np.eye(4), (n, 1, 1))
        poses[:, :3, :3] = turns
        places = data.qpos[: 7 * n].reshape(n, 7)
        places[:, :3] = rows[:, :3]
        places[:, 3:] = geometry.quaternion_of(poses)[:, [3, 0, 1, 2]]
        speeds = data.qvel[: 6 * n].reshape(n, 6)
        speeds[:, :3] = rows[:, 16:19]
        speeds[:, 3:] = np.einsum("nji,nj->ni", turns, rows[:, 19:22])  # in the box's own axes

    def _described(self) -> str:
        """The scene in MuJoCo's XML. Boxes meet the thing alone: they were recorded, and give no way."""
        gravity = " ".join(f"{value:g}" for value in self.gravity)
        fixed, moved = "", ""
        joint, meets, pieces = self._jointed()
        asset, shape = self._shaped(
            f'density="{self.density:g}" contype="{meets}" conaffinity="{meets}"'
        )
        if self.level is not None:
            fixed = f'<geom type="plane" size="0 0 0.1" pos="0 0 {self.level:.6f}"/>'
        for x, y, half, bottom, top in self.columns:
            tall = max((top - bottom) / 2, LEAST_HALF)
            fixed += (
                f'<geom type="box" pos="{x:.5f} {y:.5f} {top - tall:.5f}" '
                f'size="{half:.5f} {half:.5f} {tall:.5f}"/>'
            )
        if self.boxes is not None:
            for half, radius in zip(self.boxes.halves, self.boxes.radius, strict=True):
                size = " ".join(f"{value:.5f}" for value in np.maximum(half + radius, LEAST_HALF))
                moved += (
                    f'<body gravcomp="1"><freejoint/><geom type="box" size="{size}" mass="{HEAVY:g}" '
                    f'friction="{self.grip:g} 0.005 0.0005" priority="1" contype="2" conaffinity="0"/></body>'
                )
        return f"""
<mujoco>
  <option timestep="{STEP}" gravity="{gravity}" integrator="implicitfast" cone="elliptic" impratio="{IMPRATIO}"
    tolerance="{EXACT:g}"/>
  <size memory="64M"/>
  <default><geom friction="{self.friction:g} 0.005 0.0005" condim="4" solref="0.004 1"/></default>
  <asset>{asset}</asset>
  <worldbody>
    {fixed}{moved}
    <body name="thing">{joint}
      {shape}{pieces}</body>
  </worldbody>
</mujoco>
"""

    def _shaped(self, how: str) -> tuple[str, str]:
        """What the thing's shape needs, and the shape with attributes of `how`."""
        if self.solid is not None:
            return "", self.solid.written(how)
        text = " ".join(f"{value:.6f}" for value in corners(self.points).ravel())
        return (
            f'<mesh name="thing" vertex="{text}"/>',
            f'<geom type="mesh" mesh="thing" {how}/>',
        )

    def _jointed(self) -> tuple[str, int, str]:
        """How the thing may move, what its hull meets (bits: 1 what stands still, 2 boxes), and its other shapes."""
        if self.rail is None:
            return "<freejoint/>", 3, ""
        joint = ""
        if not self.rail.fixed:
            axis = " ".join(f"{value:.6f}" for value in self.rail.axis)
            low, high, how = self.rail.low, self.rail.high, 'type="slide"'
            if isinstance(self.rail, Hinge):
                low, high = np.rad2deg([low, high]).tolist()
                x, y, z = self.rail.at
                how = (
                    f'type="hinge" pos="{x:.6f} {y:.6f} {z:.6f}" solreffriction="0.003 1" '
                    'solimpfriction="0.9999 0.9999 0.001 0.5 2"'  # else what it holds creeps
                )
            reach = f"{low:.5f} {high:.5f}"
            # Its ends are harder than contacts are: a robot that goes on slips.
            hard = 'solreflimit="0.003 1" solimplimit="0.9999 0.9999 0.001 0.5 2"'
            joint = f'<joint {how} axis="{axis}" limited="true" range="{reach}" {hard}/>'
        return (
            joint,
            0,
            "".join(
                f'<geom type="sphere" size="{side / 2:.5f}" pos="{x:.5f} {y:.5f} {z:.5f}" mass="0" '
                'contype="0" conaffinity="2"/>'
                for side, balls in [self._balls()]
                for x, y, z in balls
            ),
        )

    def _balls(self) -> tuple[float, Float64[np.ndarray, "k 3"]]:
        """Places on the surface where a box ever comes, a side apart, as few as are allowed."""
        points = self.points
        if self.boxes is None:
            return PIECE, np.zeros((0, 3))
        centres = self.boxes.tracks[:, :, :3, 3]
        room = np.linalg.norm(self.boxes.halves, axis=1) + self.boxes.radius
        reach = 0.0 if self.rail is None else self.rail.high - self.rail.low
        if isinstance(self.rail, Hinge):
            reach *= float(np.linalg.norm(points - np.array(self.rail.at), axis=1).max())
        near = np.zeros(len(points), bool)
        for track, wide in zip(centres, room + reach, strict=True):
            low, high = track.min(0) - wide, track.max(0) + wide
            near |= ((points >= low) & (points <= high)).all(1)
        side = PIECE
        while len(cells := np.unique(np.round(points[near] / side).astype(int), axis=0)) > PIECES:
            side *= 1.2
        return side, side * cells


def corners(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "k 3"]:
    """The points that reach farthest in directions all around: about the corners of their convex hull."""
    return points[np.unique((points @ around().T).argmax(0))]


def columns(
    points: Float[np.ndarray, "n 3"], bottom: float, strip: float = STRIP
) -> Float64[np.ndarray, "c 5"]:
    """Surface points of what stands still as upright columns that reach down from them."""
    if not len(points):
        return np.zeros((0, 5))
    cells, owner = np.unique(
        np.round(points[:, :2] / strip).astype(int), axis=0, return_inverse=True
    )
    top = np.full(len(cells), -np.inf)
    np.maximum.at(top, owner.ravel(), points[:, 2])
    keep = top > bottom
    x, y = (strip * cells[keep]).T
    half = np.full(len(x), strip / 2)
    return np.stack([x, y, half, np.full(len(x), bottom), top[keep]], -1)


def _pose(data: "mujoco.MjData", body: int) -> Float64[np.ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[body].reshape(3, 3)
    pose[:3, 3] = data.xpos[body]
    return pose
