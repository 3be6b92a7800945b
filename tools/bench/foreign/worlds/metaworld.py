"""Meta-World 3.1 (Yu et al. 2019): a Sawyer at a table, with its own experts."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
from metaworld.env_dict import ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE as MAKERS

from tools.bench.foreign.simulated import Eye, state
from tools.bench.foreign.worlds.task import Rollout, Task, rigid

LINGER = 8  # steps recorded after success
DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # the hand's x axis is the approach

tasks = {
    "assembly-v3": Task(
        instruction="put the ring on the peg", moved=("asmbly_peg",), onto=("peg",)
    ),
    "basketball-v3": Task(
        instruction="put the ball through the hoop",
        moved=("basketball",),
        onto=("backboardlink", "hooplink"),
    ),
    "bin-picking-v3": Task(
        instruction="pick up the cube and put it in the other bin",
        moved=("objA",),
        onto=("binB",),
        may={"receiver": ("binA",)},
    ),
    "box-close-v3": Task(instruction="put the lid on the box", moved=("top_link",), onto=("box",)),
    "button-press-topdown-v3": Task(
        instruction="press the button", moved=("button",), onto=("buttonbox",)
    ),
    "coffee-button-v3": Task(
        instruction="press the button of the coffee machine",
        moved=("cmbutton",),
        onto=("cm_link",),
        may={"receiver": ("mug",)},
    ),
    "coffee-push-v3": Task(
        instruction="push the mug under the coffee machine",
        moved=("mug",),
        onto=("cm_link",),
        may={"receiver": ("cmbutton",)},
    ),
    "dial-turn-v3": Task(instruction="turn the dial", moved=("dial.0",)),
    "door-open-v3": Task(instruction="open the door", moved=("door_link",), onto=("doorlockB",)),
    "drawer-close-v3": Task(
        instruction="close the drawer", moved=("drawer_link",), onto=("drawercase_link",)
    ),
    "drawer-open-v3": Task(
        instruction="open the drawer", moved=("drawer_link",), onto=("drawercase_link",)
    ),
    "faucet-open-v3": Task(
        instruction="turn on the faucet", moved=("faucet_link2",), onto=("faucet_link",)
    ),
    "hammer-v3": Task(
        instruction="hit the nail with the hammer",
        moved=("hammer",),
        onto=("hammerblock",),
        may={"manipulated": ("nail_link",), "receiver": ("nail_link",)},
    ),
    "handle-press-v3": Task(
        instruction="press the handle down", moved=("handle_link",), onto=("hdlprs",)
    ),
    "lever-pull-v3": Task(
        instruction="pull the lever up", moved=("lever_link1",), onto=("lever.0",)
    ),
    "peg-insert-side-v3": Task(
        instruction="insert the peg in the hole of the block", moved=("peg",), onto=("box.0",)
    ),
    "plate-slide-v3": Task(
        instruction="slide the plate into the goal",
        moved=("puck_channel.0",),
        onto=("puck_goal.0",),
    ),
    "push-v3": Task(instruction="push the puck to the goal", moved=("obj",)),
    "shelf-place-v3": Task(
        instruction="put the block on the shelf", moved=("obj",), onto=("shelf.0",)
    ),
    "sweep-into-v3": Task(instruction="sweep the block into the hole", moved=("obj",)),
    "button-press-v3": Task(instruction="press the button", moved=("button",), onto=("buttonbox",)),
    "button-press-topdown-wall-v3": Task(
        instruction="press the button behind the wall",
        moved=("button",),
        onto=("buttonbox",),
        may={"background": ("wall.0",)},
    ),
    "button-press-wall-v3": Task(
        instruction="press the button behind the wall",
        moved=("button",),
        onto=("buttonbox",),
        may={"background": ("wall.0",)},
    ),
    "coffee-pull-v3": Task(
        instruction="pull the mug away from the coffee machine",
        moved=("mug",),
        may={"receiver": ("cm_link", "cmbutton")},
    ),
    "disassemble-v3": Task(
        instruction="take the ring off the peg", moved=("asmbly_peg",), may={"receiver": ("peg",)}
    ),
    "door-close-v3": Task(instruction="close the door", moved=("door_link",), onto=("doorlockB",)),
    "door-lock-v3": Task(
        instruction="lock the door",
        moved=("lock_link",),
        onto=("door_link",),
        may={"receiver": ("doorlockA",)},
    ),
    "door-unlock-v3": Task(
        instruction="unlock the door",
        moved=("lock_link",),
        onto=("door_link",),
        may={"receiver": ("doorlockA",)},
    ),
    "faucet-close-v3": Task(
        instruction="turn off the faucet", moved=("faucet_link2",), onto=("faucet_link",)
    ),
    "hand-insert-v3": Task(instruction="push the block into the hole", moved=("obj",)),
    "handle-press-side-v3": Task(
        instruction="press the handle down", moved=("handle_link",), onto=("hdlprs",)
    ),
    "handle-pull-v3": Task(
        instruction="pull the handle up", moved=("handle_link",), onto=("hdlprs",)
    ),
    "handle-pull-side-v3": Task(
        instruction="pull the handle up", moved=("handle_link",), onto=("hdlprs",)
    ),
    "peg-unplug-side-v3": Task(
        instruction="unplug the peg", moved=("plug",), may={"receiver": ("plug_wall",)}
    ),
    "pick-out-of-hole-v3": Task(
        instruction="pick the puck out of the hole",
        moved=("obj",),
        table=("world.5",),
        may={"table": ("tablelink",), "receiver": ("world.5",)},
    ),
    "pick-place-v3": Task(instruction="pick up the puck and bring it to the goal", moved=("obj",)),
    "pick-place-wall-v3": Task(
        instruction="bring the puck over the wall to the goal",
        moved=("obj",),
        may={"background": ("wall",)},
    ),
    "plate-slide-back-v3": Task(
        instruction="slide the plate out of the goal",
        moved=("puck_channel.0",),
        may={"receiver": ("puck_goal.0",)},
    ),
    "plate-slide-back-side-v3": Task(
        instruction="slide the plate sideways out of the goal",
        moved=("puck_channel.0",),
        may={"receiver": ("puck_goal.0",)},
    ),
    "plate-slide-side-v3": Task(
        instruction="slide the plate sideways into the goal",
        moved=("puck_channel.0",),
        onto=("puck_goal.0",),
    ),
    "push-back-v3": Task(instruction="pull the puck back to the goal", moved=("obj",)),
    "push-wall-v3": Task(
        instruction="push the puck around the wall", moved=("obj",), may={"background": ("wall",)}
    ),
    "reach-v3": Task(instruction="reach the goal", moved=()),
    "reach-wall-v3": Task(
        instruction="reach the goal behind the wall", moved=(), may={"background": ("wall",)}
    ),
    "soccer-v3": Task(
        instruction="push the ball into the goal", moved=("soccer_ball1",), onto=("soccer_goal",)
    ),
    "stick-pull-v3": Task(instruction="pull the box with the stick", moved=("stick.0", "object.0")),
    "stick-push-v3": Task(instruction="push the box with the stick", moved=("stick.0", "object.0")),
    "sweep-v3": Task(
        instruction="sweep the block off the table", moved=("obj.0",), may={"receiver": ("floor",)}
    ),
    "window-close-v3": Task(
        instruction="close the window",
        moved=("windowb_a",),
        onto=("window.0",),
        may={"receiver": ("windowb_b",)},
    ),
    "window-open-v3": Task(
        instruction="open the window",
        moved=("windowb_a",),
        onto=("window.0",),
        may={"receiver": ("windowb_b",)},
    ),
}

cameras = {
    "front": Eye(eye=(0.0, 1.7, 1.05), at=(0.0, 0.66, 0.02)),
    "left_shoulder": Eye(eye=(-0.8, 0.0, 0.85), at=(0.0, 0.65, 0.08)),
    "right_shoulder": Eye(eye=(0.8, 0.0, 0.85), at=(0.0, 0.65, 0.08)),
    "overhead": Eye(eye=(0.0, 0.45, 1.5), at=(0.0, 0.68, 0.0), up=(0.0, 1.0, 0.0)),
    "wrist": Eye(
        eye=(-0.08, 0.0, 0.12), at=(0.14, 0.0, 0.02), up=(0.0, 1.0, 0.0), body="hand", fovy=60.0
    ),
}
groups = (0, 1, 2)
hidden = ()
robot = ("base",)
table = ("tablelink",)
may = {"table": ("RetainingWall",), "background": ("RetainingWall",), "receiver": ("tablelink",)}


def rollout(task: str, seed: int) -> Rollout:
    """The task's own expert, from `seed`'s layout until shortly after success."""
    env = MAKERS[f"{task}-goal-observable"](seed=seed)
    seen, _ = env.reset()
    expert = _expert(task)
    out = Rollout(env.model, str(Path(env.fullpath)))
    names = [f"right_j{k}" for k in range(7)]
    lingered = 0
    for _ in range(env.max_path_length):
        action = np.clip(expert.get_action(seen), -1, 1)
        out.states.append(state(env.data))
        hand = env.data.body("hand")
        out.gripper.append(rigid(hand.xmat.reshape(3, 3) @ DOWN.T, env.tcp_center))
        out.open.append(float(action[3] <= 0))
        out.joints.append(np.array([env.data.joint(name).qpos[0] for name in names]))
        out.actions.append(action)
        if lingered > LINGER:
            out.success = True
            break
        seen, _, _, _, info = env.step(action)
        lingered = lingered + 1 if info["success"] or lingered else 0
    return out


def _expert(task: str) -> Any:
    stem = task.removesuffix("-v3")
    stem = {"peg-insert-side": "peg-insertion-side"}.get(stem, stem)
    module = importlib.import_module(
        f"metaworld.policies.sawyer_{stem.replace('-', '_')}_v3_policy"
    )
    (name,) = (name for name in vars(module) if name.startswith("Sawyer"))
    return getattr(module, name)()
