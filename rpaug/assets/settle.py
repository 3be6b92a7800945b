"""How a thing comes to rest: dropped on a plane in MuJoCo, as its convex hull, then set down exactly."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry, simulation
from rpaug.core.types import Mesh

if TYPE_CHECKING:
    import mujoco

DROP = 0.002  # metres
SECONDS = 1.5
STEP = 0.002  # seconds
DENSITY = 400.0  # kilograms a cubic metre
SCENE = """
<mujoco>
  <option timestep="{step}"/>
  <default><geom friction="1 0.05 0.05" condim="6" solref="0.004 1"/></default>
  <asset><mesh name="thing" vertex="{points}"/></asset>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <body name="thing" pos="0 0 {height}"><freejoint/><geom type="mesh" mesh="thing" density="{density}"/></body>
  </worldbody>
</mujoco>
"""


@lru_cache(64)
def resting(mesh: Mesh, scale: float = 1.0) -> Float64[np.ndarray, "4 4"]:
    """The motion that takes the mesh, `scale` times as large, from its own frame to rest on z = 0.

    It is let go a little above the plane the way it stands in its frame; its middle ends above the origin. The lowest
    point lies on the plane exactly: what contacts give way is taken back.
    """
    mujoco = simulation.mujoco()

    points = scale * mesh.points
    start = DROP - points[:, 2].min()
    text = " ".join(f"{value:.6f}" for value in points.ravel())
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(step=STEP, points=text, height=start, density=DENSITY)
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = _pose(data)
    for _ in range(int(SECONDS / STEP)):
        mujoco.mj_step(model, data)
    motion = _pose(data) @ geometry.inverse(before)
    motion[:3, 3] = 0.0
    placed = geometry.transform(motion, points)
    low, high = placed.min(0), placed.max(0)
    motion[:3, 3] = -(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]
    return motion


def _pose(data: "mujoco.MjData") -> Float64[np.ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = data.geom_xmat[1].reshape(3, 3)
    pose[:3, 3] = data.geom_xpos[1]
    return pose
