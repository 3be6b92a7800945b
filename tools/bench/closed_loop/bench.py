"""One episode that a policy acts in: what the cameras show now, and what a key pose of the gripper brings about."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from rpaug.twin import cameras, tabletop
from rpaug.twin.look import Look
from rpaug.twin.panda import HOME, OPEN
from rpaug.twin.renderer import Renderer
from rpaug.twin.staging import StagedTask
from rpaug.twin.world import World
from tools.bench.closed_loop.bodies import STEP, compile_physics
from tools.bench.closed_loop.goals import GOALS

Pose = Float[np.ndarray, "4 4"]

SEEN = ("front", "left_shoulder", "right_shoulder")
SIZE = 128
SPEED = 0.4  # metres per second of the gripper between key poses
TURNING = 1.5  # radians per second
SETTLE = 0.15  # seconds it then waits, and that fingers take
OPEN_FROM = 0.95  # of the full opening, as recordings count it
LONGEST = 2.5  # seconds for one leg


@dataclass(frozen=True)
class View:
    """One camera's picture: color, depth in metres, K and pose (OpenCV axes), and handles where they are known."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    K: Float[np.ndarray, "3 3"]
    cam_to_world: Pose
    ids: Int32[np.ndarray, "h w"] | None = None


class Bench:
    """A task that waits to be done, as `stage` drew it, seen under a look; close it to free OpenGL."""

    def __init__(self, task: str, job: StagedTask, world: World, look: Look) -> None:
        self.task, self.job, self.world, self.look = task, job, world, look
        self.model = compile_physics(self.world, look)
        self.data = mujoco.MjData(self.model)
        self.q, self.opening = HOME, OPEN
        self._put(tabletop.ARM.tip(HOME))
        self._fingers(OPEN)
        self._run(0.3)
        self._renderer = Renderer(self.world, look, SIZE)

    def observe(self) -> dict[str, View]:
        """What the cameras show now, the arm where the gripper needs it."""
        self._renderer.pose(self.q, float(np.mean(self._jaws())), self._things())
        rig = cameras.rig(self.where("gripper")[None], SIZE, self.look.bumps)
        views = {}
        for name in SEEN:
            camera = rig[name]
            rgb, depth, ids = self._renderer.render(camera, 0, cameras.NEAR, cameras.FAR[name])
            views[name] = View(rgb.copy(), depth, camera.K, camera.cam_to_world[0], ids)
        return views

    def act(self, pose: Pose, opening: float) -> bool:
        """Move to the key pose, then set the fingers; False if the arm cannot reach it.

        The way is what RLBench's planner is for: up to the higher of both ends, across, and down, so that what is
        carried comes from above; a key pose says nothing of the way to it.
        """
        try:
            self.q = tabletop.ARM.solve(pose, self.q)
        except ValueError:
            return False
        for leg in _way(self._target(), pose):
            self._follow(leg)
        self._run(SETTLE)
        if abs(opening - self.opening) > 1e-4:
            self._fingers(opening)
            self._run(2 * SETTLE)
        return True

    def _follow(self, pose: Pose) -> None:
        """Along a straight line, turning evenly."""
        start = self._target()
        turn = np.arccos(np.clip((np.trace(start[:3, :3].T @ pose[:3, :3]) - 1) / 2, -1, 1))
        way = np.linalg.norm(pose[:3, 3] - start[:3, 3])
        seconds = min(max(way / SPEED, turn / TURNING), LONGEST)
        steps = max(int(seconds / STEP), 1)
        for n in range(1, steps + 1):
            self._put(_between(start, pose, n / steps))
            mujoco.mj_step(self.model, self.data)

    def solved(self) -> bool:
        """Whether what the task asks for is so now."""
        return GOALS[self.task](self.job, self._things(), self.world)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()

    def _put(self, pose: Pose) -> None:
        """Where the gripper shall go next."""
        self.data.mocap_pos[0] = pose[:3, 3]
        mujoco.mju_mat2Quat(self.data.mocap_quat[0], np.ascontiguousarray(pose[:3, :3]).ravel())
        if self.data.time == 0:  # nothing has moved yet: the gripper begins there
            self.data.joint("gripper").qpos[:3] = self.data.mocap_pos[0]
            self.data.joint("gripper").qpos[3:] = self.data.mocap_quat[0]

    def _target(self) -> Pose:
        pose = np.eye(4)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, self.data.mocap_quat[0])
        pose[:3, :3], pose[:3, 3] = turn.reshape(3, 3), self.data.mocap_pos[0]
        return pose

    def _fingers(self, opening: float) -> None:
        self.opening = opening
        # Closing aims past the middle, so that whatever is between the fingers is pressed.
        self.data.ctrl[:] = OPEN if opening > OPEN_FROM * OPEN else -0.02

    def _jaws(self) -> Float[np.ndarray, "2"]:
        return np.clip([self.data.joint(side).qpos[0] for side in ("left", "right")], 0, OPEN)

    def _run(self, seconds: float) -> None:
        for _ in range(int(seconds / STEP)):
            mujoco.mj_step(self.model, self.data)

    def _things(self) -> dict[str, Pose]:
        """Poses of all movable bodies."""
        return {body.name: self.where(body.name) for body in self.world.bodies if body.movable}

    def where(self, name: str) -> Pose:
        """A body's pose in the world."""
        body = self.data.body(name)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = body.xmat.reshape(3, 3), body.xpos
        return pose


def _way(start: Pose, end: Pose) -> tuple[Pose, ...]:
    """Corners on the way from one pose to the next, the last one the end itself."""
    over = end.copy()
    if end[2, 3] > start[2, 3]:
        over[:2, 3] = start[:2, 3]
    else:
        over[2, 3] = start[2, 3]
    return over, end


def _between(start: Pose, end: Pose, share: float) -> Pose:
    """The pose that share of the way along a line, turning evenly about one axis."""
    a, b, c = np.empty(4), np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(a, np.ascontiguousarray(start[:3, :3]).ravel())
    mujoco.mju_mat2Quat(b, np.ascontiguousarray(end[:3, :3]).ravel())
    mujoco.mju_subQuat(c, b, a)
    mujoco.mju_quatIntegrate(a, c, share)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, a)
    pose = np.eye(4)
    pose[:3, :3] = turn.reshape(3, 3)
    pose[:3, 3] = start[:3, 3] + share * (end[:3, 3] - start[:3, 3])
    return pose
