"""Load two episodes with RLBench's own reader and say, as JSON, in what they differ.

Runs under the reader's Python, not ours: numpy 1.23 with peract_colab's modules on PYTHONPATH, and nothing of
rpaug. Usage: read_with_rlbench.py EPISODES INDEX OTHER_EPISODES INDEX [--clouds FILE.npz]
"""

import argparse
import copy
import json
import os
import pickle
import sys

import numpy as np
from rlbench.backend.utils import extract_obs
from rlbench.utils import get_stored_demo

CAMERAS = ["front", "left_shoulder", "right_shoulder", "wrist"]


def equal(a, b):
    """Same type, shape and bits, all the way down."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b, strict=True))
    return a == b


def compare(a, b, prefix, differs, t):
    """Add the frame to the list of every named value in which two dictionaries differ."""
    for name in sorted(set(a) | set(b)):
        if name not in a or name not in b or not equal(a[name], b[name]):
            differs.setdefault(prefix + name, []).append(t)


def key_frames(demo):
    """Frames at which the gripper switched or the arm came to rest, and the last one (James and Davison 2022)."""
    found, pause, opened = [], 0, demo[0].gripper_open
    last = len(demo) - 1
    for t in range(len(demo)):
        steady = 2 <= t < last - 1 and len({demo[i].gripper_open for i in range(t - 2, t + 2)}) == 1
        rests = pause <= 0 and steady and np.abs(demo[t].joint_velocities).max() <= 0.1
        pause = 4 if rests else pause - 1
        if t and (demo[t].gripper_open != opened or t == last or rests):
            found.append(t)
        opened = demo[t].gripper_open
    if len(found) > 1 and found[-1] - 1 == found[-2]:
        del found[-2]
    return found


def load(episodes, index):
    """(demo, instruction) as a PerAct-style trainer takes them."""
    demo = get_stored_demo(episodes, index)
    folder = os.path.join(episodes, f"episode{index}")
    with open(os.path.join(folder, "variation_descriptions.pkl"), "rb") as stream:
        return demo, pickle.load(stream)[0]  # noqa: S301  # as trainers do, on our own files


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("episodes", "index", "other_episodes", "other_index"):
        parser.add_argument(name, type=int if name.endswith("index") else str)
    parser.add_argument("--clouds", help="save the second episode's point clouds of frame 0 here")
    given = parser.parse_args()
    demo, instruction = load(given.episodes, given.index)
    other, other_instruction = load(given.other_episodes, given.other_index)
    if given.clouds:
        np.savez(given.clouds, **{c: getattr(other[0], c + "_point_cloud") for c in CAMERAS})
    differs = {}
    frames = {key: value for key, value in vars(demo).items() if key != "_observations"}
    other_frames = {key: value for key, value in vars(other).items() if key != "_observations"}
    compare(frames, other_frames, "demo.", differs, -1)
    for t in range(min(len(demo), len(other))):
        before, after = vars(demo[t]), vars(other[t])
        compare({**before, "misc": None}, {**after, "misc": None}, "", differs, t)
        compare(before["misc"], after["misc"], "misc.", differs, t)
        low, other_low = demo[t].get_low_dim_data(), other[t].get_low_dim_data()
        compare({"low_dim_data": low}, {"low_dim_data": other_low}, "", differs, t)
        taken = [extract_obs(copy.copy(o[t]), CAMERAS, t) for o in (demo, other)]
        compare(taken[0], taken[1], "extract_obs.", differs, t)
    stated = {
        "numpy": np.__version__,
        "rpaug": any(name.split(".")[0] == "rpaug" for name in sys.modules),
        "frames": [len(demo), len(other)],
        "instructions": [instruction, other_instruction],
        "key_frames": [key_frames(demo), key_frames(other)],
        "values_compared": len(before) + len(before["misc"]) + len(taken[0]) + 1,
        "differs": differs,
    }
    json.dump(stated, sys.stdout)


if __name__ == "__main__":
    main()
