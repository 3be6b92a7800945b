"""Things too stiff to deform, over time: their convex hulls in MuJoCo, among what stands still and what is moved."""

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float, Float64

from rpaug import geometry
from rpaug.physics.colliders import Boxes

STEP = 0.001  # seconds
STRIP = 0.005  # metres: what stands still becomes columns with sides as long
CORNERS = 400  # points that a hull is made from, at most
LEAST_HALF = 5e-4  # metres


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

    `columns` (x, y, half width, bottom, top) and a floor at `level` stand still; `boxes` are moved. `velocity` is the
    thing's at first.
    """

    points: Float64[np.ndarray, "n 3"]
    density: float
    level: float | None
    columns: Float64[np.ndarray, "c 5"] = field(default_factory=lambda: np.zeros((0, 5)))
    boxes: Boxes | None = None
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    friction: float = 0.5
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def run(self, frames: int, pace: float, start: float = 0.0) -> Fall:
        """So many frames, `pace` seconds apart, the first of them as the thing is; boxes are met from `start` on."""
        model = mujoco.MjModel.from_xml_string(self._described())
        data = mujoco.MjData(model)
        thing = model.body("thing").id
        data.qvel[:3] = self.velocity
        mujoco.mj_forward(model, data)
        before, steps = _pose(data, thing), max(1, round(pace / STEP))
        model.opt.timestep = pace / steps
        first = model.geom("box0").id if self.boxes is not None else model.ngeom
        given = np.zeros(0 if self.boxes is None else len(self.boxes.radius))
        motions, force = [np.eye(4)], np.zeros(6)
        for k in range((frames - 1) * steps):
            if self.boxes is not None:
                self._move(data, start + (k + 1) * pace / steps)
            mujoco.mj_step(model, data)
            for c in range(data.ncon):
                pair = sorted((int(data.contact[c].geom1), int(data.contact[c].geom2)))
                if pair[1] >= first:
                    mujoco.mj_contactForce(model, data, c, force)
                    given[pair[1] - first] += abs(force[0]) * pace / steps
            if (k + 1) % steps == 0:
                motions.append(_pose(data, thing) @ geometry.inverse(before))
        return Fall(np.stack(motions), given, (frames - 1) * steps)

    def _move(self, data: mujoco.MjData, seconds: float) -> None:
        """Boxes are put where they are now; MuJoCo reads no speed off them, but contacts push what they sink into."""
        assert self.boxes is not None
        pose = self.boxes.pose(np.arange(len(self.boxes.radius)), seconds)
        data.mocap_pos[:] = pose[:, :3, 3]
        data.mocap_quat[:] = geometry.quaternion_of(pose)[:, [3, 0, 1, 2]]

    def _described(self) -> str:
        """The scene in MuJoCo's XML. Boxes meet the thing alone: they were recorded, and give no way."""
        points = self.points[:: max(1, len(self.points) // CORNERS)]
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
            for b, (half, radius) in enumerate(zip(self.boxes.halves, self.boxes.radius, strict=True)):
                size = " ".join(f"{value:.5f}" for value in np.maximum(half + radius, LEAST_HALF))
                moved += (
                    f'<body mocap="true"><geom name="box{b}" type="box" size="{size}" '
                    'contype="2" conaffinity="2"/></body>'
                )
        friction = max(self.friction, 0.0) if self.friction >= 0 else 10.0
        return f"""
<mujoco>
  <option timestep="{STEP}" gravity="{gravity}" integrator="implicitfast" cone="elliptic"/>
  <size memory="64M"/>
  <default><geom friction="{friction:g} 0.005 0.0005" condim="4" solref="0.004 1"/></default>
  <asset><mesh name="thing" vertex="{text}"/></asset>
  <worldbody>
    {fixed}{moved}
    <body name="thing"><freejoint/>
      <geom type="mesh" mesh="thing" density="{self.density:g}" contype="3" conaffinity="3"/></body>
  </worldbody>
</mujoco>
"""


def columns(
    points: Float[np.ndarray, "n 3"], bottom: float, strip: float = STRIP
) -> Float64[np.ndarray, "c 5"]:
    """Surface points of what stands still as upright columns that reach down from them."""
    if not len(points):
        return np.zeros((0, 5))
    cells, owner = np.unique(np.round(points[:, :2] / strip).astype(int), axis=0, return_inverse=True)
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
