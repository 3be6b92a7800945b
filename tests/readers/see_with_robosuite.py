"""Records one demonstration with robosuite, and what robosuite's own sensors of depth and of geoms see in its states;
prints JSON. Runs without rpaug.

    python see_with_robosuite.py FILE OUT
"""

import json
import sys
from pathlib import Path

import h5py
import numpy as np
import robosuite as suite
from robosuite.utils.camera_utils import get_real_depth_map

from tools.bench.foreign import demos


def main():
    path, out = Path(sys.argv[1]), sys.argv[2]
    demos.record("Lift", 1, 32, path)
    given = demos.settings(32) | {"camera_depths": True, "camera_segmentations": "element"}
    env = suite.make("Lift", **given)
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        seen = {}
        for shown in demos.sensed(env, demo.attrs["model_file"], demo["states"][()]):
            for name in demos.CAMERAS:
                depth = get_real_depth_map(env.sim, shown[f"{name}_depth"][::-1])
                seen.setdefault(f"{name}_depth", []).append(depth.reshape(32, 32, 1))
                geoms = shown[f"{name}_segmentation_element"][::-1]
                seen.setdefault(f"{name}_geoms", []).append(geoms)
    np.savez(out, **{name: np.stack(rows) for name, rows in seen.items()})
    print(json.dumps({"rpaug": "rpaug" in sys.modules}))


if __name__ == "__main__":
    main()
