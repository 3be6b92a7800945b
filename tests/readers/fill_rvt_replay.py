"""Fill RVT's replay buffer, with RVT's own code, from two folders of episodes, and say as JSON in what they differ.

Runs under a Python of its own (docs/readers.md), nothing of rpaug in it. What belongs to the simulator and to the
policy, and is only imported on the way, is replaced by empty modules; so is CLIP, whose features of the instruction
come from a small fixed network instead of trained weights. Usage: fill_rvt_replay.py REPLAYS EPISODES COUNT OTHER COUNT
"""

import json
import sys
import types
from pathlib import Path

import numpy as np
import torch


def stub(name, **members):
    """Put an empty module in the place of one that is not needed."""
    module = types.ModuleType(name)
    vars(module).update(members)
    sys.modules[name] = module
    parent, _, last = name.rpartition(".")
    if parent in sys.modules:
        setattr(sys.modules[parent], last, module)


class Words(torch.nn.Module):
    """A stand-in for CLIP's text encoder: the same shapes, fixed weights."""

    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.token_embedding = torch.nn.Embedding(50_000, 512)
        self.positional_embedding = torch.nn.Parameter(torch.zeros(77, 512))
        self.transformer = torch.nn.Identity()
        self.ln_final = torch.nn.LayerNorm(512)
        self.text_projection = torch.nn.Parameter(torch.eye(512))
        self.dtype = torch.float32


def tokens(texts):
    """One number a character: enough to tell instructions apart."""
    rows = [[ord(letter) for letter in text[:77]] for text in texts]
    return torch.tensor([row + [0] * (77 - len(row)) for row in rows])


stub("clip", tokenize=tokens)
stub("pyrender", OffscreenRenderer=None)
stub("pyrender.trackball", Trackball=None)
import rlbench  # noqa: E402
import rlbench.backend  # noqa: E402

rlbench.CameraConfig = rlbench.ObservationConfig = None
stub(
    "rlbench.backend.const", DEPTH_SCALE=2**24 - 1
)  # as in RLBench, which peract_colab has in another file
import pyrep  # noqa: E402, F401

stub("pyrep.const", RenderMode=None)
stub("rvt.models.peract_official", create_agent_our=None)
from rvt.utils import dataset, peract_utils  # noqa: E402


def buffer(folder, episodes, count):
    """RVT's own replay buffer, filled as RVT's training fills it."""
    replay = dataset.create_replay(
        batch_size=1, timesteps=1, disk_saving=True, cameras=peract_utils.CAMERAS,
        voxel_sizes=peract_utils.VOXEL_SIZES, replay_size=2000,
    )  # fmt: skip
    dataset.fill_replay(
        replay=replay, task="task", task_replay_storage_folder=str(folder), start_idx=0, num_demos=count,
        demo_augmentation=True, demo_augmentation_every_n=peract_utils.DEMO_AUGMENTATION_EVERY_N,
        cameras=peract_utils.CAMERAS, rlbench_scene_bounds=peract_utils.SCENE_BOUNDS,
        voxel_sizes=peract_utils.VOXEL_SIZES, rotation_resolution=peract_utils.ROTATION_RESOLUTION,
        crop_augmentation=False, data_path=str(episodes), episode_folder=peract_utils.EPISODE_FOLDER,
        variation_desriptions_pkl=peract_utils.VARIATION_DESCRIPTIONS_PKL, clip_model=Words().eval(), device="cpu",
    )  # fmt: skip
    return replay


def rows(replay):
    """Its transitions, in their order."""
    valid = [i for i in range(int(replay.add_count)) if replay.is_valid_transition(i)]
    assert valid, "no transition in the buffer"
    return [one(replay, index) for index in valid]


def one(replay, index):
    """One transition by name."""
    batch = replay.sample_transition_batch(batch_size=1, indices=[index], pack_in_dict=True)
    return {name: np.asarray(value)[0] for name, value in batch.items() if name != "indices"}


def main():
    """Fill two buffers and compare."""
    replays, episodes, count, other, other_count = sys.argv[1:]
    sys.stdout, stated = sys.stderr, sys.stdout  # RVT prints
    first = rows(buffer(Path(replays) / "first", episodes, int(count)))
    second = rows(buffer(Path(replays) / "second", other, int(other_count)))
    differs = {}
    for row, (a, b) in enumerate(zip(first, second, strict=False)):  # both counts are told
        for name in sorted(set(a) | set(b)):
            if not np.array_equal(a[name], b[name]):
                differs.setdefault(name, []).append(row)
    points = [
        [
            int(each[name])
            for name in ("episode_idx", "sample_frame", "keypoint_frame", "next_keypoint_frame")
        ]
        for each in first
    ]
    report = {
        "numpy": np.__version__,
        "rpaug": any(name.split(".")[0] == "rpaug" for name in sys.modules),
        "transitions": [len(first), len(second)],
        "names": sorted(first[0]),
        "points": points,
        "differs": differs,
    }
    stated.write(json.dumps(report))
    stated.flush()


if __name__ == "__main__":
    main()
