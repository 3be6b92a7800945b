"""gymnasium-robotics' Fetch tasks (Plappert et al. 2018): a Fetch arm at a bare table, experts of our own."""

from collections.abc import Iterator
from pathlib import Path

import gymnasium
import gymnasium_robotics
import numpy as np

from tools.bench.foreign.simulated import Eye, state
from tools.bench.foreign.worlds.task import Rollout, Task, above, rigid

gymnasium.register_envs(gymnasium_robotics)

LONGEST = 150  # steps
GAIN = 12.0  # of the way to a waypoint, in the action's units of 5 cm
NEAR = 0.015  # metres from a waypoint that was reached
LINGER = 4  # steps recorded after success
DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # the gripper's x axis is the approach

tasks = {
    "FetchPickAndPlace-v4": Task(
        instruction="pick up the block and bring it to the goal", moved=("object0",)
    ),
    "FetchPush-v4": Task(instruction="push the block to the goal", moved=("object0",)),
    "FetchReach-v4": Task(instruction="reach the goal", moved=()),
}
cameras = {
    "front": Eye(eye=(2.3, 0.75, 1.3), at=(1.28, 0.75, 0.42)),
    "left_shoulder": Eye(eye=(0.8, 1.5, 1.25), at=(1.3, 0.75, 0.44)),
    "right_shoulder": Eye(eye=(0.8, 0.0, 1.25), at=(1.3, 0.75, 0.44)),
    "overhead": Eye(eye=(1.1, 0.75, 1.85), at=(1.3, 0.75, 0.4), up=(1.0, 0.0, 0.0)),
    "wrist": Eye(
        eye=(-0.08, 0.0, 0.12), at=(0.1, 0.0, 0.01), up=(0.0, 1.0, 0.0),
        body="robot0:gripper_link", fovy=60.0,
    ),
}  # fmt: skip
groups = (0, 1, 2)
hidden = ()
robot = ("robot0:base_link",)
table = ("table0",)
may = {"receiver": ("table0",)}
JOINTS = (
    "shoulder_pan", "shoulder_lift", "upperarm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll",
)  # fmt: skip


def rollout(task: str, seed: int) -> Rollout:
    """An expert's run from `seed`'s layout until shortly after success."""
    env = gymnasium.make(task, max_episode_steps=LONGEST + 1)
    seen, _ = env.reset(seed=seed)
    base = env.unwrapped
    out = Rollout(base.model, str(Path(base.fullpath)))
    expert = EXPERTS[task](seen)
    lingered = 0
    for _ in range(LONGEST):
        try:
            action = expert.send(None if not out.states else seen)
        except StopIteration:
            break
        out.states.append(state(base.data))
        hand = base.data.body("robot0:gripper_link")
        out.gripper.append(
            rigid(hand.xmat.reshape(3, 3) @ DOWN.T, base.data.site("robot0:grip").xpos)
        )
        out.open.append(float(action[3] >= 0))
        joints = [base.data.joint(f"robot0:{name}_joint").qpos[0] for name in JOINTS]
        out.joints.append(np.array(joints))
        out.actions.append(action)
        if lingered > LINGER:
            out.success = len(out.states) > 3 * LINGER
            break
        seen, _, _, _, info = env.step(action)
        lingered = lingered + 1 if info["is_success"] else 0
    return out


Expert = Iterator[np.ndarray]


def _to(seen: dict, goal: np.ndarray, grip: float) -> np.ndarray:
    way = goal - seen["observation"][:3]
    return np.append(np.clip(GAIN * way, -1, 1), grip).astype(np.float32)


def _reach(seen: dict, goal: np.ndarray, grip: float) -> Expert:
    while np.linalg.norm(goal - seen["observation"][:3]) > NEAR:
        seen = yield _to(seen, goal, grip)
    return seen


def _pick(seen: dict) -> Expert:
    at = seen["observation"][3:6].copy()
    seen = yield from _reach(seen, above(at, 0.1), 1.0)
    seen = yield from _reach(seen, at, 1.0)
    for _ in range(6):
        seen = yield _to(seen, at, -1.0)
    goal = seen["desired_goal"]
    seen = yield from _reach(seen, np.array([*at[:2], max(at[2], goal[2]) + 0.08]), -1.0)
    seen = yield from _reach(seen, above(goal, 0.06), -1.0)
    while True:
        seen = yield _to(seen, goal, -1.0)


def _push(seen: dict) -> Expert:
    at, goal = seen["observation"][3:6].copy(), seen["desired_goal"]
    ahead = (goal - at) / np.linalg.norm(goal - at)
    start = at - 0.09 * ahead
    seen = yield from _reach(seen, above(start, 0.1), -1.0)
    seen = yield from _reach(seen, start, -1.0)
    while True:
        block = seen["observation"][3:6]
        way = goal - block
        way /= max(np.linalg.norm(way), 1e-6)
        seen = yield _to(seen, block - 0.03 * way + 0.02 * way, -1.0) * (0.5, 0.5, 0.5, 1.0)


def _touchless(seen: dict) -> Expert:
    while True:
        seen = yield _to(seen, seen["desired_goal"], -1.0) * (0.3, 0.3, 0.3, 1.0)


EXPERTS = {"FetchPush-v4": _push, "FetchPickAndPlace-v4": _pick, "FetchReach-v4": _touchless}
