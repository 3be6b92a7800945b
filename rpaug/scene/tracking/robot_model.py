"""The robot's own shape, from its URDF or MJCF file: where each part of it is, held against what was recorded.

Gripper poses alone leave base and joints' zeros loose by a centimetre. So the model is drawn into recorded images, and
base and zeros are moved to bring it to the recorded depth: point to plane, Gauss-Newton (Chen and Medioni 1992). A
part counts only if the recording shows it where the model has it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry, simulation
from rpaug.core.files import read_bytes
from rpaug.core.types import CameraView, Episode, Mesh, RobotPart
from rpaug.render import mesh
from rpaug.scene.tracking import arms, urdf

SHOWN = 3  # MuJoCo's groups of geoms that viewers draw: 0, 1, 2
FRAMES = 4  # of each fixed camera, which the model is held against
NEAR = 0.03  # metres: recorded points so close to the model pull it
SAME = 0.01  # metres: a recorded point so close to the model shows it
ROUNDS = 5
FIRM = 0.02  # metres per radian, about: how firmly zeros of joints are kept
EVERY = 3  # pixels apart are those that pull
NUDGE = 1e-5  # metres and radians
EXPLAINED = 0.8  # share of the pixels where the model should be seen that must show it
PART = 0.6  # the same of one part
FEWEST = 30  # pixels that must show a part
Pose = Float64[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Shape:
    """Drawn bodies of a robot's file, and how its recorded joints move them."""

    model: Any
    joints: tuple[int, ...]  # in MuJoCo's order of joints
    bodies: tuple[int, ...]
    meshes: tuple[Mesh, ...]

    def forward(self, joints: Float64[np.ndarray, "t j"]) -> Float64[np.ndarray, "b t 4 4"]:
        """Each body's pose in the model's world, over time."""
        mujoco = simulation.mujoco()

        data = mujoco.MjData(self.model)
        out = np.tile(np.eye(4), (len(self.bodies), len(joints), 1, 1))
        address, bodies = self.model.jnt_qposadr[list(self.joints)], list(self.bodies)
        for t, values in enumerate(joints):
            data.qpos[address] = values
            mujoco.mj_kinematics(self.model, data)
            out[:, t, :3, :3] = data.xmat[bodies].reshape(-1, 3, 3)
            out[:, t, :3, 3] = data.xpos[bodies]
        return out


def found(path: Path, episode: Episode) -> tuple[tuple[RobotPart, ...], str]:
    """The parts of the robot that `path` describes, where the episode had them, or none and what is to be said of it.

    Nothing is said of a file without meshes. Raises BadInput for a file that is wrong.
    """
    robot = episode.robot
    views = [
        view for view in episode.views.values() if view.camera.fixed and view.depth and view.ids
    ]
    shape = read(path, robot.joint_positions.shape[1])
    if isinstance(shape, str):
        return (), shape and f"{path.name}: the robot's shape is not used: {shape}"
    if arms.misfits([path], robot):
        return (), ""  # the arm itself is refused, with its reason
    if not views:
        said = "no fixed camera recorded depth and masks to hold it against"
        return (), f"{path.name}: the robot's shape is not used: {said}"
    base, zeros, _ = arms.calibrated(arms.read(path, len(shape.joints)), robot)
    times = np.unique(np.linspace(0, episode.length - 1, FRAMES).round().astype(int)).tolist()
    sights = [(view, t) for view in views for t in times]
    for _ in range(ROUNDS):
        base, zeros = _nearer(shape, base, zeros, robot.joint_positions, sights)
    poses = base @ shape.forward(robot.joint_positions + zeros)
    ids, shown, should = _held_against(shape, poses, sights)
    share = shown.sum() / max(should.sum(), 1)
    if share < EXPLAINED:
        said = (
            f"{100 * share:.0f} % of it is where it was recorded (at least {100 * EXPLAINED:.0f})"
        )
        return (), f"{path.name}: the robot's shape is not used: {said}"
    good = (shown >= FEWEST) & (shown >= PART * should) & (ids > 0)
    return tuple(
        RobotPart(int(ids[k]), shape.meshes[k], poses[k]) for k in np.flatnonzero(good).tolist()
    ), ""


Sights = Sequence[tuple[CameraView, int]]


def _drawn(
    shape: Shape, poses: Float64[np.ndarray, "b t 4 4"], view: CameraView, t: int
) -> mesh.NearestView:
    parts = list(zip(shape.meshes, poses[:, t], strict=True))
    camera = view.camera
    return mesh.nearest(parts, camera.K, camera.cam_to_world[t], (camera.width, camera.height))


def _nearer(
    shape: Shape,
    base: Pose,
    zeros: Float64[np.ndarray, "j"],
    joints: Float64[np.ndarray, "t j"],
    sights: Sights,
) -> tuple[Pose, Float64[np.ndarray, "j"]]:
    """Base and zeros of the joints one step nearer to what was recorded."""
    times = sorted({t for _, t in sights})
    at, nudged = base @ shape.forward(joints[times] + zeros), []
    for number in range(6):
        step = NUDGE * np.eye(6)[number]
        nudged.append(geometry.rigid(step[:3], step[3:]) @ at)
    for number in range(len(zeros)):
        more = joints[times] + zeros + NUDGE * np.eye(len(zeros))[number]
        nudged.append(base @ shape.forward(more))
    rows, off = [np.eye(6 + len(zeros))[6:] * FIRM], [-FIRM * zeros]
    for view, t in sights:
        now = times.index(t)
        there = np.repeat(at[:, now : now + 1], t + 1, 1)
        seen = _drawn(shape, there, view, t)
        points, recorded = (
            geometry.world_points(depth, view.camera, t)[::EVERY, ::EVERY].reshape(-1, 3)
            for depth in (seen.depth, view.depth(t).astype(np.float64))  # type: ignore[misc]
        )
        part, normal = (
            seen.number[::EVERY, ::EVERY].ravel(),
            seen.normals[::EVERY, ::EVERY].reshape(-1, 3),
        )
        use = (part >= 0) & (np.linalg.norm(recorded - points, axis=1) < NEAR)
        points, recorded, part, normal = points[use], recorded[use], part[use], normal[use]
        local = np.linalg.inv(at[part, now])
        own = np.einsum("nij,nj->ni", local[:, :3, :3], points) + local[:, :3, 3]
        slopes = []
        for moved in nudged:
            pose = moved[part, now]
            to = np.einsum("nij,nj->ni", pose[:, :3, :3], own) + pose[:, :3, 3]
            slopes.append(((to - points) * normal).sum(1) / NUDGE)
        scale = 1 / np.sqrt(max(len(points), 1))
        rows.append(scale * np.stack(slopes, 1))
        off.append(scale * ((recorded - points) * normal).sum(1))
    step = np.linalg.lstsq(np.concatenate(rows), np.concatenate(off), rcond=1e-9)[0]
    return geometry.rigid(step[:3], step[3:6]) @ base, zeros + step[6:]


def _held_against(
    shape: Shape, poses: Float64[np.ndarray, "b t 4 4"], sights: Sights
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """By part: the instance id that shows it, and the pixels that do, of those that should: nothing hides it there."""
    votes: list[dict[int, int]] = [{} for _ in shape.bodies]
    shown, should = np.zeros(len(votes), int), np.zeros(len(votes), int)
    for view, t in sights:
        assert view.depth is not None
        assert view.ids is not None
        seen, depth, ids = _drawn(shape, poses, view, t), view.depth(t), view.ids(t)
        free = (seen.number >= 0) & (depth > seen.depth - SAME)
        same = free & (depth < seen.depth + SAME)
        should += np.bincount(seen.number[free], minlength=len(votes))
        shown += np.bincount(seen.number[same], minlength=len(votes))
        for part in np.unique(seen.number[same]).tolist():
            for one, count in zip(
                *np.unique(ids[same & (seen.number == part)], return_counts=True), strict=True
            ):
                votes[part][int(one)] = votes[part].get(int(one), 0) + int(count)
    return (
        np.array([max(vote, key=lambda one: vote[one], default=0) for vote in votes]),
        shown,
        should,
    )


def read(path: Path, joints: int) -> Shape | str:
    """The drawn bodies of a robot's file, or why there are none ("" if it has no meshes). Raises BadInput.

    Bodies that joints other than the recorded ones move are left out: nobody knows where they are.
    """
    mujoco = simulation.mujoco()

    arm = arms.read(path, joints)
    if isinstance(arm, arms.Modelled):
        model, moving = arm.model, tuple(range(joints))
    else:
        assert isinstance(arm, urdf.Tree)
        try:
            model = mujoco.MjModel.from_xml_string(*_urdf(path))
        except (ValueError, OSError) as error:
            return " ".join(str(error).split())
        names = [joint.name for joint in arm.links if joint.number is not None]
        moving = tuple(model.joint(name).id for name in names)
    top = int(model.jnt_bodyid[moving[0]])
    while model.body_parentid[top]:
        top = int(model.body_parentid[top])
    known = {0: False}
    for body in range(1, model.nbody):
        own = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        known[body] = (body == top or known[int(model.body_parentid[body])]) and set(own) <= set(
            moving
        )
    bodies = {body: _mesh(model, body) for body in known if known[body]}
    drawn = {body: one for body, one in bodies.items() if one is not None}
    return Shape(model, moving, tuple(drawn), tuple(drawn.values())) if drawn else ""


def _urdf(path: Path) -> tuple[str, dict[str, bytes]]:
    """A URDF as MuJoCo takes it, with what is drawn of it, and its meshes by their names."""
    root, files = ElementTree.fromstring(read_bytes(path)), {}
    for link in root.iter("link"):
        for hidden in link.findall("collision"):
            link.remove(hidden)
    for number, one in enumerate(root.iter("mesh")):
        told = one.get("filename", "")
        tail = Path(told.split("://")[-1])
        places = [
            above / Path(*tail.parts[k:]) for above in path.absolute().parents for k in range(2)
        ]
        file = next((place for place in places if place.is_file()), None)
        if file is None:
            raise OSError(f"its mesh {told} is not there")
        one.set("filename", f"{number}{file.suffix}")
        files[f"{number}{file.suffix}"] = file.read_bytes()
    compiler = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    compiler.attrib.update(
        discardvisual="false", fusestatic="false", boundmass="0.001", boundinertia="0.000001"
    )
    return ElementTree.tostring(root, "unicode"), files


def _mesh(model: Any, body: int) -> Mesh | None:
    """What is drawn of a body, in its frame: of geoms that viewers show those that nothing collides with, if any."""
    geoms = [
        geom
        for geom in range(
            model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]
        )
        if model.geom_group[geom] < SHOWN and model.geom_rgba[geom, 3] > 0
    ]
    only = [
        geom for geom in geoms if not model.geom_contype[geom] and not model.geom_conaffinity[geom]
    ]
    corners = [each for geom in only or geoms for each in _triangles(model, geom)]
    if not corners:
        return None
    points = np.concatenate(corners).reshape(-1, 3)
    sides = np.diff(points.reshape(-1, 3, 3), axis=1)
    normals = np.cross(sides[:, 0], sides[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Mesh(
        points=points, normals=np.repeat(normals, 3, 0), uv=np.zeros((len(points), 2)),
        faces=np.arange(len(points), dtype=np.int32).reshape(-1, 3), image=np.full((1, 1, 3), 255, np.uint8),
    )  # fmt: skip


def _triangles(model: Any, geom: int) -> Iterator[Float64[np.ndarray, "n 3 3"]]:
    """A geom's surface in its body's frame; planes and fields of height are no part of a robot."""
    mujoco = simulation.mujoco()
    from trimesh import creation  # only here: it takes half a second to load

    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = model.geom_type[geom]
    if kind == kinds.mjGEOM_MESH:
        one = model.geom_dataid[geom]
        faces = model.mesh_face[model.mesh_faceadr[one] :][: model.mesh_facenum[one]]
        points = model.mesh_vert[model.mesh_vertadr[one] :][: model.mesh_vertnum[one]][faces]
    elif kind == kinds.mjGEOM_BOX:
        points = creation.box(2 * size).triangles
    elif kind == kinds.mjGEOM_CYLINDER:
        points = creation.cylinder(size[0], 2 * size[1]).triangles
    elif kind == kinds.mjGEOM_CAPSULE:
        points = creation.capsule(2 * size[1], size[0]).triangles
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        points = creation.icosphere(3).triangles * (
            size[0] if kind == kinds.mjGEOM_SPHERE else size
        )
    else:
        return
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    yield points.astype(np.float64) @ turn.reshape(3, 3).T + model.geom_pos[geom]
