"""A small arm that waves before one camera: its file, its joints, and the frames that show its outline."""

from pathlib import Path

import numpy as np

from rpaug.core import geometry
from rpaug.render import mesh
from rpaug.scene.tracking import robot_model
from rpaug.scene.tracking.outline_pose import OutlinedFrame, OutlineLens

SIZE, FRAMES = 96, 14
ARM = """<mujoco><worldbody><body name="base"><geom type="box" size=".08 .08 .05"/>
<body name="one" pos="0 0 .1"><joint axis="0 0 1"/><geom type="box" size=".04 .06 .1" pos="0 0 .1"/>
<body name="two" pos="0 0 .2"><joint axis="0 1 0"/><geom type="capsule" size=".03 .1" pos="0 0 .1"/>
<body name="three" pos="0 0 .2"><joint axis="1 0 0"/><geom type="cylinder" size="{thick} .1" pos="0 0 .1"/>
</body></body></body></body></worldbody></mujoco>"""
LENS = OutlineLens(np.array([[140.0, 0, 47.5], [0, 140, 47.5], [0, 0, 1]]))
WAVES = np.sin(np.linspace(0, 6, FRAMES)[:, None] * [1.0, 1.4, 2.1] + [0, 1, 2]) * [1.2, 0.6, 0.9]


def arm_file(folder: Path, thick: float = 0.03) -> Path:
    path = folder / f"arm{thick}.xml"
    path.write_text(ARM.format(thick=thick))
    return path


def eye() -> np.ndarray:
    """Where the camera truly stands: it looks at the arm's middle from the front right, a little turned."""
    pose, ahead = np.eye(4), np.array([0.0, 0.05, 0.3]) - [1.1, 0.5, 0.8]
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
    pose[:3, 3] = 1.1, 0.5, 0.8
    return pose @ geometry.rigid(np.array([0.01, 0.02, -0.03]), np.zeros(3))


def frames(path: Path, joints: np.ndarray = WAVES) -> list[OutlinedFrame]:
    """The arm of a file as it moves, each frame with the mask that the camera would record."""
    shape = robot_model.read(path, 3)
    assert isinstance(shape, robot_model.Shape)
    poses = shape.forward(joints)
    found = []
    for t in range(len(joints)):
        parts = tuple(zip(shape.meshes, poses[:, t], strict=True))
        found.append(OutlinedFrame(parts, mesh.depths(parts, LENS.K, eye(), (SIZE, SIZE)) > 0))
    return found


def off(pose: np.ndarray) -> tuple[float, float]:
    """Metres and degrees from where the camera truly stands."""
    turned = np.arccos(np.clip((np.trace(pose[:3, :3].T @ eye()[:3, :3]) - 1) / 2, -1, 1))
    return float(np.linalg.norm(pose[:3, 3] - eye()[:3, 3])), float(np.degrees(turned))
