"""Things too stiff to deform, over time: their convex hulls in MuJoCo, among what stands still and what is moved."""

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float, Float64

from rpaug import geometry
from rpaug.physics.colliders import Boxes

STEP = 0.001  # seconds
STRIP = 0.005  # metres: what stands still becomes columns with sides as long
CORNERS = 400  # directions in which a hull reaches as far as its points
LEAST_HALF = 5e-4  # metres
HEAVY = 1e4  # kilograms: what nothing on a table pushes away


@dataclass(frozen=True)
class Fall:
    """What a rigid simulation came to: world motions of the thing from its start, one a frame, and the impulse in
    newton seconds that each moving box gave it."""

    motions: Float64[np.ndarray, "t 4 4"]
    boxes: Float64[np.ndarray, "b"]
    steps: int


@dataclass(frozen=True)
class Rigid:
    """A thing by surface points in the world, in metres, with its density in kg/m3.

    `columns` (x, y, half width, bottom, top) and a floor at `level` stand still; `boxes` are moved, and give no way.
    `friction` is Coulomb's on what stands still, `grip` that on boxes; `velocity` is the thing's at first.
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

    def run(self, frames: int, pace: float, start: float = 0.0) -> Fall:
        """So many frames, `pace` seconds apart, the first of them as the thing is; boxes are met from `start` on."""
        model = mujoco.MjModel.from_xml_string(self._described())
        data = mujoco.MjData(model)
        thing, first = model.body("thing").id, model.ngeom - 1 - self._count
        data.qvel[-6:-3] = self.velocity
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
                if other >= first:
                    mujoco.mj_contactForce(model, data, c, force)
                    given[other - first] += abs(force[0]) * pace / steps
            if (k + 1) % steps == 0:
                motions.append(_pose(data, thing) @ geometry.inverse(before))
        return Fall(np.stack(motions), given, (frames - 1) * steps)

    @property
    def _count(self) -> int:
        return 0 if self.boxes is None else len(self.boxes.radius)

    def _move(self, data: mujoco.MjData, seconds: float) -> None:
        """Boxes are put where they are now, with their speeds: whatever pushed them back is undone."""
        if self.boxes is None:
            return
        rows, n = self.boxes(seconds), self._count
        turns = rows[:, 3:12].reshape(-1, 3, 3)
        poses = geometry.rigid(np.zeros(3), np.zeros(3)) * np.ones((n, 1, 1))
        poses[:, :3, :3] = turns
        places = data.qpos[: 7 * n].reshape(n, 7)
        places[:, :3] = rows[:, :3]
        places[:, 3:] = geometry.quaternion_of(poses)[:, [3, 0, 1, 2]]
        speeds = data.qvel[: 6 * n].reshape(n, 6)
        speeds[:, :3] = rows[:, 16:19]
        speeds[:, 3:] = np.einsum("nji,nj->ni", turns, rows[:, 19:22])  # in the box's own axes

    def _described(self) -> str:
        """The scene in MuJoCo's XML. Boxes meet the thing alone: they were recorded, and give no way."""
        points = corners(self.points)
        text = " ".join(f"{value:.6f}" for value in points.ravel())
        gravity = " ".join(f"{value:g}" for value in self.gravity)
        fixed, moved = "", ""
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
  <option timestep="{STEP}" gravity="{gravity}" integrator="implicitfast" cone="elliptic"/>
  <size memory="64M"/>
  <default><geom friction="{self.friction:g} 0.005 0.0005" condim="4" solref="0.004 1"/></default>
  <asset><mesh name="thing" vertex="{text}"/></asset>
  <worldbody>
    {fixed}{moved}
    <body name="thing"><freejoint/>
      <geom type="mesh" mesh="thing" density="{self.density:g}" contype="3" conaffinity="3"/></body>
  </worldbody>
</mujoco>
"""


def corners(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "k 3"]:
    """The points that reach farthest in directions all around: about the corners of their convex hull."""
    k = np.arange(CORNERS) + 0.5
    z, turn = 1 - 2 * k / CORNERS, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    directions = np.stack([r * np.cos(turn), r * np.sin(turn), z])
    return points[np.unique((points @ directions).argmax(0))]


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


def _pose(data: mujoco.MjData, body: int) -> Float64[np.ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[body].reshape(3, 3)
    pose[:3, 3] = data.xpos[body]
    return pose
