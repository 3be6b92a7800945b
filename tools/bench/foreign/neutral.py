"""The neutral folder of one foreign episode: plain arrays and JSON that both environments read.

    OUT/<world>.<task>/<seed>/
        episode.json    world, task, seed, instruction, cameras, instance ids by body, true roles
        robot.npz       gripper_to_world (t, 4, 4), gripper_open (t,), joint_positions (t, j), actions (t, a)
        <camera>.npz    rgb (t, h, w, 3) uint8, depth (t, h, w) metres, ids (t, h, w), K (3, 3), cam_to_world (t, 4, 4)
        states.npz      the simulator's state by frame: qpos, qvel, act, mocap_pos, mocap_quat
        model.npz       the model's fields that differ from its file
        model.xml       the model, where it has no file

Metres, radians, OpenCV's camera axes, integer pixel centers. It imports nothing but the standard library and numpy.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

CAMERAS = ("front", "left_shoulder", "right_shoulder", "overhead", "wrist")
HALVES = ("worked", "held")
OPENED = frozenset(
    (
        "FetchPickAndPlace-v4", "FetchPush-v4", "Lift", "PickPlaceBread", "PickPlaceCan", "Stack",
        "assembly-v3", "basketball-v3", "bin-picking-v3", "box-close-v3", "button-press-v3", "button-press-topdown-v3",
        "button-press-topdown-wall-v3", "button-press-wall-v3", "coffee-button-v3", "coffee-pull-v3", "coffee-push-v3",
        "dial-turn-v3", "disassemble-v3", "door-close-v3", "door-lock-v3", "door-open-v3", "door-unlock-v3",
        "drawer-close-v3", "drawer-open-v3", "faucet-close-v3", "faucet-open-v3", "hammer-v3", "hand-insert-v3",
        "handle-press-v3", "handle-press-side-v3", "handle-pull-v3", "handle-pull-side-v3", "lever-pull-v3",
        "peg-insert-side-v3", "peg-unplug-side-v3", "pick-out-of-hole-v3", "pick-place-v3", "pick-place-wall-v3",
        "plate-slide-v3", "plate-slide-back-v3", "plate-slide-back-side-v3", "plate-slide-side-v3", "push-v3",
        "push-back-v3", "push-wall-v3", "reach-v3", "reach-wall-v3", "shelf-place-v3", "soccer-v3", "stick-pull-v3",
        "stick-push-v3", "sweep-v3", "sweep-into-v3", "window-close-v3", "window-open-v3",
    )
)  # fmt: skip


def half(name: str, names: Iterable[str]) -> str:
    """The half that task `name` of a world belongs to.

    Tasks whose figures were looked at once (OPENED) are worked-with. Of the others every second one is set aside, in
    the order of the SHA-256 of their names; `names` are all tasks of that world. Nothing but the names decides.
    """
    if name in OPENED:
        return "worked"
    fresh = set(names) - OPENED
    order = sorted(fresh, key=lambda one: hashlib.sha256(one.encode()).hexdigest())
    return HALVES[order.index(name) % 2]


def save(folder: Path, facts: Mapping[str, Any], arrays: Mapping[str, Mapping[str, Any]]) -> None:
    """Write an episode, its JSON last: a folder without one was not finished."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, fields in arrays.items():
        np.savez_compressed(folder / f"{name}.npz", **fields)
    (folder / "episode.json").write_text(json.dumps(facts, indent=1))


def facts(folder: Path) -> dict[str, Any]:
    """What `episode.json` says."""
    return json.loads((folder / "episode.json").read_text())


def arrays(folder: Path, name: str) -> dict[str, np.ndarray]:
    """The arrays of one file."""
    with np.load(folder / f"{name}.npz") as kept:
        return {key: kept[key] for key in kept.files}
