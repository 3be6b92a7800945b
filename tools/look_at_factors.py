"""Contact sheets of every factor on the first episodes of a dataset: one PNG an episode and factor, to be looked at.

    python tools/look_at_factors.py RECORDINGS/rlbench_open_drawer --out sheets [--factor recolor ...]

Columns are cameras; rows are frames, recorded above edited.
"""

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpaug.core import registry
from rpaug.core.files import encode_png, write_atomic
from rpaug.pipeline import plan, prepare, recipe
from rpaug.pipeline.copies import PreparedEpisode, draw_copy
from rpaug.scene.build import build

MOVED, RECEIVER = {"target": {"role": "manipulated"}}, {"target": {"role": "receiver"}}
FACTORS: dict[str, dict[str, Any]] = {
    "recolor": {"op": "recolor", "color": "blue", **MOVED},
    "recolor-receiver": {"op": "recolor", "color": "teal", **RECEIVER},
    "retexture": {"op": "retexture", "texture": "checker_red", "scale": 0.15, **MOVED},
    "retexture-receiver": {"op": "retexture", "texture": "plaid_green", **RECEIVER},
    "light_color": {"op": "light_color", "range": [[0.5, 0.3, 0.2], [0.5, 0.3, 0.2]]},
    "light_direction": {"op": "light_direction"},
    "table_color": {"op": "table_color", "range": [[0.3, 0.7, 0.5], [0.3, 0.7, 0.5]]},
    "table_texture": {"op": "table_texture", "texture": "marble_green"},
    "background_texture": {"op": "background_texture", "texture": "bricks_red"},
    "camera_pose": {"op": "camera_pose", "camera": "static"},
    "sensor_noise": {"op": "sensor_noise", "read": [0.02, 0.02]},
    "sensor_blur": {"op": "sensor_blur", "sigma": [1, 1]},
    "sensor_jpeg": {"op": "sensor_jpeg", "quality": [30, 30]},
    "sensor_exposure": {"op": "sensor_exposure", "stops": [0.7, 0.7]},
}
ZOOM = 2


def main() -> None:
    """Render and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--factor", action="append", choices=list(FACTORS))
    parser.add_argument("--episodes", type=int, default=2)
    parser.add_argument("--frames", type=int, default=2)
    arguments = parser.parse_args()
    adapter = registry.adapter_for(arguments.dataset)
    for number, key in enumerate(adapter.episodes(arguments.dataset)[: arguments.episodes]):
        episode = adapter.read(arguments.dataset, key)
        scene = build(episode, with_bodies=True)
        frames = np.linspace(0, episode.length - 1, arguments.frames + 1).astype(int)[1:].tolist()
        for name in arguments.factor or FACTORS:
            made = recipe.build({"version": 1, "seed": 3, "edits": [FACTORS[name]]})
            planned = plan.make(prepare.operators(made), episode)
            shown = draw_copy(PreparedEpisode(scene, planned, made), 1).episode
            rows = [
                np.concatenate([view.rgb(t) for view in one.views.values()], 1)
                for t in frames
                for one in (episode, shown)
            ]
            sheet = np.concatenate(rows)
            size = (sheet.shape[1] * ZOOM, sheet.shape[0] * ZOOM)
            sheet = cv2.resize(sheet, size, interpolation=cv2.INTER_NEAREST)
            write_atomic(arguments.out / f"{number}-{name}.png", encode_png(sheet))


if __name__ == "__main__":
    main()
