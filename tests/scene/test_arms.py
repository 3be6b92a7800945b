"""Arms from files: the same links as from measures, found again from what a robot recorded."""

from pathlib import Path

import numpy as np
import pytest

from rpaug import geometry
from rpaug.errors import BadInput
from rpaug.scene import arms
from rpaug.scene.arms import PANDA
from rpaug.types import Robot

WEIGHT = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
TWO_LINKS = f"""<robot name="two">
  <link name="base"/>
  <link name="upper">{WEIGHT}</link>
  <link name="lower">{WEIGHT}</link>
  <joint name="one" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="two" type="prismatic"><parent link="upper"/><child link="lower"/><origin xyz="0.5 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def panda_mjcf() -> str:
    """The Panda's measures as nested MJCF bodies."""
    text, ends = "", ""
    for a, d, alpha in zip(PANDA.a, PANDA.d, PANDA.alpha, strict=True):
        # Modified Denavit-Hartenberg: turn by alpha about x, then shift along x by a and the new z by d.
        c, s = np.cos(alpha), np.sin(alpha)
        text += (
            f'<body pos="{a} {-d * s} {d * c}" quat="{np.cos(alpha / 2)} {np.sin(alpha / 2)} 0 0">'
            '<joint type="hinge" axis="0 0 1"/><geom size="0.01" mass="1"/>'
        )
        ends += "</body>"
    return f'<mujoco><compiler angle="radian"/><worldbody>{text}{ends}</worldbody></mujoco>'


def waving(count: int = 30) -> np.ndarray:
    t = np.linspace(0, 1, count)[:, None]
    return 0.6 * np.sin(2 * np.pi * t * np.arange(1, 8) / 3 + np.arange(7))


def test_a_file_gives_the_links_that_its_measures_give(tmp_path: Path) -> None:
    path = tmp_path / "panda.xml"
    path.write_text(panda_mjcf())
    joints = waving()
    np.testing.assert_allclose(arms.read(path, 7).forward(joints), PANDA.forward(joints), atol=1e-9)


def test_the_arm_of_a_file_is_found_in_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "panda.xml"
    path.write_text(panda_mjcf())
    joints = waving()
    base = geometry.rigid(np.array([0, 0, 0.7]), np.array([-0.3, 0.1, 0.75]))
    tool = geometry.rigid(np.array([0, 0, 0.785]), np.array([0, 0, 0.2]))
    truth = base @ PANDA.forward(joints)
    robot = Robot(joints, np.zeros_like(joints), truth[-1] @ tool, np.ones(len(joints)))
    found = arms.link_tracks(robot, (arms.read(path, 7),))
    assert found is not None
    np.testing.assert_allclose(found, truth, atol=1e-3)


def test_a_urdf_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(TWO_LINKS)
    links = arms.read(path, 2).forward(np.array([[np.pi / 2, 0.1]]))
    np.testing.assert_allclose(links[1, 0, :3, 3], [0, 0.6, 0.3], atol=1e-9)


def test_what_is_no_arm_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(TWO_LINKS)
    with pytest.raises(BadInput, match="expected 7 that turn or slide"):
        arms.read(path, 7)
    path.write_text("<robot>")
    with pytest.raises(BadInput, match="expected a URDF or MJCF file"):
        arms.read(path, 2)
