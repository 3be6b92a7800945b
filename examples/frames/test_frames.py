"""The contract that every adapter keeps: `pip install . && python -m pytest`."""

import json

import numpy as np
from frames import Frames

import rpaug


class TestFrames(rpaug.AdapterContract):
    def adapter(self):
        return Frames()

    def dataset(self, folder):
        rng = np.random.default_rng(0)
        shape = (3, 8, 12)
        episode = rpaug.Episode.from_arrays(
            rng.integers(0, 256, (*shape, 3), np.uint8),
            depth=rng.integers(300, 2000, shape).astype(np.float32) / 1000,
            masks=rng.integers(0, 40_000, shape),
            cameras=([[10, 0, 5.5], [0, 10, 3.5], [0, 0, 1]], np.eye(4)),
            instruction="push the cube",
            joint_positions=rng.normal(size=(3, 7)),
        )
        Frames().write(episode, folder, "take0", dict)
        return folder


def test_what_it_does_not_know_comes_back(tmp_path):
    root = TestFrames().dataset(tmp_path / "in")
    facts = json.loads((root / "take0/episode.json").read_text()) | {"operator": "ada"}
    (root / "take0/episode.json").write_text(json.dumps(facts, indent=1))
    (root / "take0/front/exposure.txt").write_text("8 ms")
    Frames().write(Frames().read(root, "take0"), tmp_path / "out", "take1", dict)
    for name in ("episode.json", "front/exposure.txt", "front/depth_0002.png"):
        assert (tmp_path / "out/take1" / name).read_bytes() == (root / "take0" / name).read_bytes()
