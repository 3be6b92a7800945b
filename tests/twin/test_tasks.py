"""The scripts in the furnished world: nothing runs into anything but what it takes."""

import mujoco
import numpy as np
import pytest

from rpaug.twin import mjcf, tabletop
from rpaug.twin.look import Look
from rpaug.twin.motion import play
from rpaug.twin.tasks import TASKS

ROBOT = ("link", "hand", "finger")


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("seed", range(5))
def test_nothing_interpenetrates(task, seed):
    job = TASKS[task](np.random.default_rng([seed, 0, 0]))
    motion = play(tabletop.ARM, job.script, job.placing, 24)
    world = tabletop.build(job.placing, np.random.default_rng(0), 0)
    model = mjcf.compile_model(world, Look(), 16)
    data = mujoco.MjData(model)
    names = np.array([model.geom(g).name.split("/")[0] for g in range(model.ngeom)])
    robot = np.array([name.startswith(ROBOT) for name in names])
    things = np.array([name in world.handles and name in motion.objects for name in names])
    for t in range(0, 24, 3):
        data.qpos[:] = (*motion.joint_positions[t], motion.opening[t], motion.opening[t])
        for name, track in motion.objects.items():
            slot = model.body(name).mocapid[0]
            data.mocap_pos[slot] = track[t, :3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[slot], track[t, :3, :3].ravel())
        mujoco.mj_kinematics(model, data)
        assert not list(
            _overlaps(model, data, names, (robot & (names != "link0")) | things, ~robot)
        ), t


def _overlaps(model, data, names, mine, others):
    """Pairs of different parts that share more than 1 mm."""
    segment = np.empty(6)
    for a in np.nonzero(mine)[0]:
        for b in np.nonzero(others & (names != names[a]))[0]:
            apart = np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b])
            near = apart < model.geom_rbound[a] + model.geom_rbound[b]
            if near and mujoco.mj_geomDistance(model, data, a, b, 0.01, segment) < -1e-3:
                yield names[a], names[b]
