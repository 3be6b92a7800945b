"""What GR00T N1's and N1.5's dataset class makes of a dataset of v2.1 with `modality.json`; prints JSON. Runs without
rpaug.

    python read_with_gr00t_n1.py FOLDER FRAMES_OUT

Saves to FRAMES_OUT (npz) states, actions and images of each step, by `<episode>/<step>/<column>`. Of GR00T's transforms
only the one that does nothing is loaded: the others want pytorch3d.
"""

import contextlib
import importlib.util
import json
import sys
import types
from pathlib import Path

import numpy as np

spec = importlib.util.find_spec("gr00t.data")
package = types.ModuleType("gr00t.data.transform")
package.__path__ = [f"{spec.submodule_search_locations[0]}/transform"]
sys.modules[package.__name__] = package
from gr00t.data.transform.base import ComposedModalityTransform  # noqa: E402

package.ComposedModalityTransform = ComposedModalityTransform
from gr00t.data.dataset import LeRobotSingleDataset, ModalityConfig  # noqa: E402


def main():
    folder, out = sys.argv[1:]
    modality = json.loads((Path(folder) / "meta/modality.json").read_text())
    configs = {
        kind: ModalityConfig(delta_indices=[0], modality_keys=[f"{kind}.{key}" for key in keys])
        for kind, keys in modality.items()
        if kind != "annotation"
    }
    words = [f"annotation.{name}" for name in modality["annotation"]]
    configs["language"] = ModalityConfig(delta_indices=[0], modality_keys=words)
    with contextlib.redirect_stdout(sys.stderr):
        dataset = LeRobotSingleDataset(folder, configs, "new_embodiment", video_backend="opencv")
        frames, said = {}, {}
        for episode, step in dataset.all_steps:
            for name, value in dataset.get_step_data(episode, step).items():
                if name in words:
                    said.setdefault(str(episode), []).extend(value)
                else:
                    frames[f"{episode}/{step}/{name}"] = np.asarray(value)[0]
    np.savez(out, **frames)
    stated = {
        "rpaug": "rpaug" in sys.modules,
        "lengths": [int(length) for length in dataset.trajectory_lengths],
        "words": said,
        "statistics": dataset.metadata.statistics.model_dump(mode="json"),
    }
    print(json.dumps(stated))


if __name__ == "__main__":
    main()
