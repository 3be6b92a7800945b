"""A demonstration in closed form: the gripper closes on a ball and carries it along."""

import numpy as np
from analytic import ball_at, scene

from rpaug import Episode, Robot

CAMERAS = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}


def demonstration(length: int = 8) -> Episode:
    """The analytic scene with a gripper that closes on the ball in frame 2 and carries it along."""
    recorded = scene(CAMERAS, length=length).episode
    gripper = np.tile(np.eye(4), (length, 1, 1))
    gripper[:, :3, 3] = np.array([ball_at(t, length) for t in range(length)])
    gripper[:, 2, 3] += 0.1
    wave = np.linspace(0, 1, length)
    robot = Robot(
        joint_positions=np.tile(wave[:, None], (1, 7)),
        joint_velocities=np.full((length, 7), 0.2),
        gripper_to_world=gripper,
        gripper_open=(np.arange(length) < 2).astype(float),
        extra={"gripper_joint_positions": np.full((length, 2), 0.02)},
    )
    return Episode("episode0", recorded.views, robot, ("roll the ball", "push it"), length)
