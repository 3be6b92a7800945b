"""robosuite 1.5 (Zhu et al. 2020): a Panda at a table in a room, experts of our own."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import robosuite as suite
from robosuite.utils.log_utils import ROBOSUITE_DEFAULT_LOGGER

from tools.bench.foreign.simulated import Eye, state
from tools.bench.foreign.worlds.task import Rollout, Task, above, rigid

ROBOSUITE_DEFAULT_LOGGER.setLevel("ERROR")
LONGEST = 260  # steps of a twentieth of a second
GAIN = 12.0  # of the way to a waypoint, in the action's units of 5 cm
NEAR = 0.012  # metres from a waypoint that was reached
LINGER = 6  # steps recorded after success

tasks = {
    "Lift": Task(instruction="lift the red cube", moved=("cube_main",)),
    "Stack": Task(
        instruction="stack the red cube on the green cube", moved=("cubeA_main",), onto=("cubeB_main",)
    ),
    "PickPlaceCan": Task(
        instruction="put the can into the bin", moved=("Can_main",), onto=("bin2",),
        table=("bin1",), may={"receiver": ("bin1",), "table": ("bin2",)},
    ),
    "PickPlaceBread": Task(
        instruction="put the bread into the bin", moved=("Bread_main",), onto=("bin2",),
        table=("bin1",), may={"receiver": ("bin1",), "table": ("bin2",)},
    ),
    "PickPlaceMilk": Task(
        instruction="put the milk into the bin", moved=("Milk_main",), onto=("bin2",),
        table=("bin1",), may={"receiver": ("bin1",), "table": ("bin2",)},
    ),
}  # fmt: skip
cameras = {
    "front": Eye(eye=(1.15, 0.0, 1.75), at=(0.02, 0.0, 0.86)),
    "left_shoulder": Eye(eye=(-0.5, 0.8, 1.65), at=(0.05, 0.0, 0.86)),
    "right_shoulder": Eye(eye=(-0.5, -0.8, 1.65), at=(0.05, 0.0, 0.86)),
    "overhead": Eye(eye=(-0.15, 0.0, 2.2), at=(0.05, 0.0, 0.8), up=(1.0, 0.0, 0.0)),
    "wrist": Eye(
        eye=(0.09, 0.0, -0.1), at=(0.0, 0.0, 0.04), up=(1.0, 0.0, 0.0),
        body="gripper0_right_eef", fovy=60.0,
    ),
}  # fmt: skip
groups = (1,)
hidden = ("Visual",)  # ghosts at the goal
robot = ("robot0_base",)
table = ("table",)
may = {"receiver": ("table",)}


def rollout(task: str, seed: int) -> Rollout:
    """An expert's run from `seed`'s layout until shortly after success."""
    env = suite.make(
        task, robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False,
        horizon=LONGEST + 1, control_freq=20, seed=seed,
    )  # fmt: skip
    seen = env.reset()
    model, data = env.sim.model._model, env.sim.data._data
    out = Rollout(model, env.model.get_xml())
    expert = EXPERTS[task](seen)
    lingered = 0
    for _ in range(LONGEST):
        try:
            action = expert.send(seen if out.states else None)
        except StopIteration:
            break
        out.states.append(state(data))
        hand = data.body("gripper0_right_eef")
        out.gripper.append(rigid(hand.xmat, hand.xpos))
        out.open.append(float(action[-1] < 0))
        out.joints.append(np.array([data.joint(f"robot0_joint{k}").qpos[0] for k in range(1, 8)]))
        out.actions.append(action)
        if lingered > LINGER:
            out.success = True
            break
        seen, _, _, _ = env.step(action)
        lingered = lingered + 1 if env._check_success() or lingered else 0
    return out


Expert = Iterator[np.ndarray]


def _to(seen: dict, goal: np.ndarray, grip: float, turn: float = 0.0) -> np.ndarray:
    way = np.clip(GAIN * (goal - seen["robot0_eef_pos"]), -1, 1)
    return np.array([*way, 0.0, 0.0, np.clip(turn, -1, 1), grip])


def _reach(seen: dict, goal: np.ndarray, grip: float, turned: Callable | None = None) -> Expert:
    while True:
        turn = turned(seen) if turned else 0.0
        if np.linalg.norm(goal - seen["robot0_eef_pos"]) < NEAR and abs(turn) < 0.1:
            return seen
        seen = yield _to(seen, goal, grip, turn)


def _grasp(seen: dict, at: np.ndarray, turned: Callable | None = None) -> Expert:
    seen = yield from _reach(seen, above(at, 0.12), -1.0, turned)
    seen = yield from _reach(seen, at, -1.0)
    for _ in range(8):
        seen = yield _to(seen, at, 1.0)
    return seen


def _along(name: str) -> Callable[[dict], float]:
    """How far to turn about the vertical until the fingers close on two faces of a cube."""

    def turned(seen: dict) -> float:
        x, y, z, w = seen[f"{name}_quat"]
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        x, y, z, w = seen["robot0_eef_quat"]
        hand = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
        quarter = (yaw - hand + np.pi / 4) % (np.pi / 2) - np.pi / 4
        return 2.0 * float(quarter)

    return turned


def _lift(seen: dict) -> Expert:
    at = seen["cube_pos"].copy()
    seen = yield from _grasp(seen, at, _along("cube"))
    while True:
        seen = yield _to(seen, above(at, 0.15), 1.0)


def _stack(seen: dict) -> Expert:
    at, goal = seen["cubeA_pos"].copy(), seen["cubeB_pos"].copy()
    seen = yield from _grasp(seen, at, _along("cubeA"))
    seen = yield from _reach(seen, above(at, 0.15), 1.0)
    seen = yield from _reach(seen, above(goal, 0.15), 1.0)
    seen = yield from _reach(seen, above(goal, 0.052), 1.0)
    for _ in range(6):
        seen = yield _to(seen, above(goal, 0.052), -1.0)
    while True:
        seen = yield _to(seen, above(goal, 0.2), -1.0)


def _bin(
    name: str, place: tuple[float, float], turned: Callable | None = None
) -> Callable[[dict], Expert]:
    """Into the compartment of bin 2 that is `place`'s, metres in the world."""

    def run(seen: dict) -> Expert:
        at = seen[f"{name}_pos"].copy()
        seen = yield from _grasp(seen, at, turned)
        seen = yield from _reach(seen, above(at, 0.25), 1.0)
        goal = np.array([*place, at[2] + 0.25])
        seen = yield from _reach(seen, goal, 1.0)
        goal[2] = at[2] + 0.03
        seen = yield from _reach(seen, goal, 1.0)
        while True:
            seen = yield _to(seen, above(goal, 0.2), -1.0)

    return run


EXPERTS: dict[str, Any] = {
    "Lift": _lift,
    "Stack": _stack,
    "PickPlaceCan": _bin("Can", (0.1975, 0.4025)),
    "PickPlaceBread": _bin("Bread", (0.1975, 0.1575)),
    "PickPlaceMilk": _bin("Milk", (0.0025, 0.1575), _along("Milk")),
}
