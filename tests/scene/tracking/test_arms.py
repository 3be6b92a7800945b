"""Arms from files: the same links as from measures, found again from what a robot recorded."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from arm_files import panda_mjcf, panda_urdf
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core import geometry
from rpaug.core.errors import BadInput
from rpaug.core.types import Robot
from rpaug.scene.tracking import arms, urdf
from rpaug.scene.tracking.arms import PANDA

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


def test_a_urdf_needs_no_meshes_and_no_masses(tmp_path: Path) -> None:
    path = tmp_path / "panda.urdf"
    path.write_text(panda_urdf())
    joints = waving()
    np.testing.assert_allclose(arms.read(path, 7).forward(joints), PANDA.forward(joints), atol=1e-9)
    assert len(arms.read(path, 8).forward(np.zeros((1, 8)))) == 8
    with pytest.raises(BadInput, match=r"8 that move: joint1, .*left; expected 9"):
        arms.read(path, 9)


@settings(deadline=None)
@given(st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6))
def test_origins_and_axes_are_mujocos(numbers: list[float]) -> None:
    """The oracle is MuJoCo's own reading of the same URDF, given masses and limits."""
    roll, pitch, yaw, first, second, lean = numbers
    text = TWO_LINKS.replace('xyz="0.5 0 0"', f'xyz="0.5 0 0" rpy="{roll} {pitch} {yaw}"')
    text = text.replace('<axis xyz="0 0 1"/>', f'<axis xyz="1 {lean} 0.5"/>')
    model = mujoco.MjModel.from_xml_string(text)
    ours = urdf.read(Path("two.urdf"), ElementTree.fromstring(text), 2)
    joints = np.array([[first, second]])
    np.testing.assert_allclose(
        ours.forward(joints), arms.Modelled(model, 2).forward(joints), atol=1e-6
    )


@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("<robot>", "expected a URDF or MJCF file"),
        ("<sdf/>", "found <sdf>; expected a URDF or MJCF file"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "that MuJoCo opens"),
        (TWO_LINKS.replace("prismatic", "planar"), "'two': found type 'planar'"),
        (TWO_LINKS.replace('xyz="0 0 1"', 'xyz="0 0 0"'), "'one': found axis 0 0 0"),
        (TWO_LINKS.replace('xyz="0 0 0.3"', 'xyz="0 0 x"'), "'one': found 0 0 x; expected three"),
        (TWO_LINKS.replace('link="base"', 'link="lower"'), "a loop of joints"),
        (TWO_LINKS.replace('child link="lower"', 'child link="upper"'), "two parents"),
        (TWO_LINKS.replace('<child link="upper"/>', ""), "'one': found no child link"),
    ],
)
def test_what_is_no_arm_is_refused(tmp_path: Path, text: str, given: str) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(text)
    with pytest.raises(BadInput, match=given):
        arms.read(path, 2)


def test_an_arm_that_does_not_explain_the_gripper_is_told(tmp_path: Path) -> None:
    path = tmp_path / "panda.urdf"
    path.write_text(panda_urdf())
    joints = waving()
    robot = Robot(joints, joints, PANDA.forward(joints)[-1], np.ones(len(joints)))
    assert arms.misfits([path], robot) == ()
    strange = replace(robot, gripper_to_world=PANDA.forward(joints[::-1])[-1])
    assert "panda.urdf: this arm is not used: its gripper is" in arms.misfits([path], strange)[0]
    assert "fewer than 10 frames" in arms.misfits([path], replace(robot, gripper_to_world=None))[0]
    with pytest.raises(BadInput, match="no recorded joints"):
        arms.for_robot([path], replace(robot, joint_positions=np.zeros((30, 0))))
    assert arms.for_robot([], robot) == arms.KNOWN
