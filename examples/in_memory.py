"""Edit the sample in memory, without a file in between, and save recorded and edited frames side by side.

python in_memory.py
"""

import numpy as np
from PIL import Image

import rpaug

RECIPE = {
    "version": 1,
    "edits": [
        {"op": "recolor", "target": {"role": "manipulated"}, "color": "azure"},
        {"op": "table_texture", "texture": "marble_green"},
        {"op": "distractors", "count": 1},
    ],
}

episode = rpaug.read("sample")  # or a dataset's path, and a key of rpaug.episodes(path)
copy = rpaug.augment(episode, RECIPE, copy=1, seed=7)
views = [one.views[camera] for camera in ("front", "overhead") for one in (episode, copy)]
Image.fromarray(np.concatenate([view.rgb(10) for view in views], axis=1)).save("side_by_side.png")
