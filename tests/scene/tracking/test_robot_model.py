"""The robot's shape by its file: found where it was recorded, refused where it was not, drawn where nobody saw it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trimesh import creation

from rpaug import Episode
from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.render import mesh
from rpaug.scene.recorded import surfels
from rpaug.scene.tracking import arms, robot_model

SIZE, FRAMES, GREY = 48, 12, 90
COLORS = np.array([[200, 40, 40], [40, 200, 40], [40, 40, 200], [200, 200, 40]])
ARM = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="base"><geom type="box" size=".08 .08 .05"/>
<body name="one" pos="0 0 .1"><joint axis="0 0 1"/><geom type="box" size=".04 .04 .1" pos="0 0 .1"/>
<body name="two" pos="0 0 .2"><joint axis="0 1 0"/><geom type="capsule" size=".03 .1" pos="0 0 .1"/>
<body name="three" pos="0 0 .2"><joint axis="1 0 0"/><geom type="cylinder" size="{thick} .1" pos="0 0 .1"/>
<body name="finger"><joint type="slide"/><geom size=".02"/></body></body></body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM.format(thick=0.03))
    return path


def looking(eye: tuple[float, float, float]) -> np.ndarray:
    """A camera at `eye` that looks at the arm's middle."""
    ahead = np.array([0.3, 0.1, 0.35]) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
    pose[:3, 3] = eye
    return pose


K = np.array([[70.0, 0, 23.5], [0, 70, 23.5], [0, 0, 1]])
EYES = {"front": looking((1.3, 0.1, 0.6)), "side": looking((0.4, -0.9, 0.5))}


@pytest.fixture(scope="module")
def truth(file: Path) -> tuple[robot_model.Shape, np.ndarray, np.ndarray]:
    """The arm's shape, its joints, and where each part truly is: the arm stands turned in the world."""
    shape = robot_model.read(file, 3)
    assert isinstance(shape, robot_model.Shape)
    waves = np.sin(np.linspace(0, 5, FRAMES)[:, None] * [1.0, 1.4, 2.1] + [0, 1, 2])
    joints = waves * [1.2, 0.5, 0.8]
    base = geometry.rigid(np.array([0.02, -0.03, 0.6]), np.array([0.3, 0.1, 0.05]))
    return shape, joints, base @ shape.forward(joints)


def shown(
    shape: robot_model.Shape, poses: np.ndarray, eye: np.ndarray, t: int
) -> tuple[np.ndarray, ...]:
    """Color, depth and ids that a camera records: colors darken away from above, and behind the arm is nothing."""
    parts = list(zip(shape.meshes, poses[:, t], strict=True))
    seen = mesh.nearest(parts, K, eye, (SIZE, SIZE))
    light = (0.6 + 0.4 * seen.normals[..., 2:]) * COLORS[seen.number]
    rgb = np.where(seen.number[..., None] >= 0, light, GREY).astype(np.uint8)
    depth = np.where(seen.number >= 0, seen.depth, 5.0).astype(np.float32)
    return rgb, depth, (seen.number + 1).astype(np.int32)


@pytest.fixture(scope="module")
def episode(truth: tuple) -> Episode:
    shape, joints, poses = truth
    films = {
        name: [
            np.stack(reel)
            for reel in zip(*(shown(shape, poses, eye, t) for t in range(FRAMES)), strict=True)
        ]
        for name, eye in EYES.items()
    }
    rgb, depth, masks = ({name: film[k] for name, film in films.items()} for k in range(3))
    tool = geometry.rigid(np.array([0.1, 0, 0.4]), np.array([0, 0, 0.25]))
    return Episode.from_arrays(
        rgb, depth=depth, masks=masks, instruction="wave", joint_positions=joints, gripper_to_world=poses[-1] @ tool,
        cameras={name: (K, np.tile(eye, (FRAMES, 1, 1))) for name, eye in EYES.items()}, gripper_open=np.ones(FRAMES),
    )  # fmt: skip


def test_what_other_joints_move_is_left_out(truth: tuple) -> None:
    assert len(truth[0].bodies) == 4  # neither the floor nor the finger


@pytest.mark.parametrize("zeros", [(0.0, 0.0, 0.0), (0.0, -0.25, 0.3)], ids=["same", "others"])
def test_parts_are_found_where_they_were(
    file: Path, episode: Episode, truth: tuple, zeros: tuple[float, ...]
) -> None:
    """Whatever an encoder's zero is beside the file's."""
    robot = replace(episode.robot, joint_positions=episode.robot.joint_positions + zeros)
    parts, said = robot_model.found(file, replace(episode, robot=robot))
    assert said == ""
    assert [part.instance_id for part in parts] == [1, 2, 3, 4]
    for part, true in zip(parts, truth[2], strict=True):
        off = np.linalg.norm(
            geometry.transform(geometry.inverse(part.to_world[5]) @ true[5], np.eye(3) / 10)
            - np.eye(3) / 10,
            axis=1,
        )
        assert off.max() < 0.002


def test_a_shape_that_the_recording_does_not_show_is_refused(
    tmp_path: Path, episode: Episode
) -> None:
    path = tmp_path / "thick.xml"
    path.write_text(ARM.format(thick=0.12))
    parts, said = robot_model.found(path, episode)
    assert parts == ()
    assert "thick.xml: the robot's shape is not used" in said
    assert "(at least 80)" in said


def test_without_a_camera_to_hold_it_against_it_is_refused(file: Path, episode: Episode) -> None:
    views = {name: replace(view, ids=None) for name, view in episode.views.items()}
    parts, said = robot_model.found(file, replace(episode, views=views))
    assert parts == ()
    assert "no fixed camera recorded depth and masks" in said


def test_a_urdf_brings_its_meshes(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    creation.box((0.2, 0.1, 0.1)).export(tmp_path / "meshes/link.stl")
    path = tmp_path / "arm.urdf"
    text = """<robot name="a"><link name="base"/><link name="link"><visual><origin xyz="0.1 0 0"/><geometry>
    <mesh filename="{}"/></geometry></visual></link><joint name="j" type="revolute"><parent link="base"/>
    <child link="link"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
    path.write_text(text.format("package://arm/meshes/link.stl"))
    shape = robot_model.read(path, 1)
    assert isinstance(shape, robot_model.Shape)
    (pose,) = shape.forward(np.array([[np.pi / 2]]))[:, 0]
    corners = geometry.transform(pose, shape.meshes[0].points)
    np.testing.assert_allclose(corners.min(0), [-0.05, 0, -0.05], atol=1e-6)
    np.testing.assert_allclose(corners.max(0), [0.05, 0.2, 0.05], atol=1e-6)
    path.write_text(text.format("package://arm/meshes/gone.stl"))
    assert robot_model.read(path, 1) == "its mesh package://arm/meshes/gone.stl is not there"


def test_a_moved_camera_shows_the_arm_where_nobody_saw_it(
    file: Path, episode: Episode, truth: tuple
) -> None:
    shape, _, poses = truth
    behind = np.tile(looking((-0.5, 0.7, 0.5)), (FRAMES, 1, 1))
    still = np.tile(np.eye(4), (FRAMES, 1, 1))
    bodies = tuple(Body(frozenset([k]), still, "unknown") for k in range(1, 5))
    cameras = {name: view.camera for name, view in episode.views.items()}
    cameras["side"] = replace(cameras["side"], cam_to_world=behind)
    plain = Scene(episode, cameras, bodies, {}, False, ())
    scene = replace(plain, robot_parts=robot_model.found(file, episode)[0])
    wrong, before = [], 0
    for one in (plain, scene):
        drawn = surfels.view(surfels.build(one), one, "side", 4)
        rgb, _, ids = shown(shape, poses, behind[4], 4)
        wrong.append((drawn.ids != ids)[ids > 0].sum())
        before = before or drawn.source.max() + 1
        if one is scene:
            arm = (drawn.source >= before) & (drawn.ids > 0) & (drawn.ids == ids)
            assert arm.sum() > 30
            assert not drawn.hole[arm & ~drawn.rough].any()  # what the file shows is not invented
            assert np.abs(drawn.image[arm].astype(int) - rgb[arm]).mean() < 12
    assert wrong[1] < 0.5 * wrong[0]


def test_an_arm_that_does_not_move_as_recorded_says_so_itself(file: Path, episode: Episode) -> None:
    robot = replace(episode.robot, joint_positions=episode.robot.joint_positions[::-1])
    assert arms.misfits([file], robot)
    assert robot_model.found(file, replace(episode, robot=robot)) == ((), "")
