"""Redraws docs/images/first.png: the embedded sample, recorded and under three shipped recipes."""

from pathlib import Path

import cv2
import numpy as np

import rpaug
from rpaug import pipeline, plan, recipe, registry
from rpaug.files import encode_png, write_atomic
from rpaug.scene.build import build

ROWS = [
    ("recorded", []),
    (
        "recolor: what the robot handles",
        [{"op": "recolor", "target": {"role": "manipulated"}, "color": "azure"}],
    ),
    ("light_color", [{"op": "light_color", "range": [[0.5, 0.3, 0.25], [0.5, 0.3, 0.25]]}]),
    ("camera_pose", [{"op": "camera_pose", "camera": "static"}]),
]
CAMERAS = ("front", "left_shoulder", "overhead", "wrist")
SIDE, BAND = 216, 26


def main() -> None:
    """Write the picture."""
    root = Path(rpaug.__file__).parent / "sample"
    adapter = registry.adapter_for(root)
    episode = adapter.read(root, adapter.episodes(root)[0])
    scene = build(episode, with_bodies=True)
    rows = []
    for title, edits in ROWS:
        made = recipe.build({"version": 1, "seed": 4, "edits": edits})
        edited, draws = pipeline.draw(scene, made, 1)
        shown = pipeline.render(edited, draws, plan.make(pipeline.operators(made), episode)).episode
        tiles = [
            cv2.resize(
                shown.views[c].rgb(episode.length - 2), (SIDE, SIDE), interpolation=cv2.INTER_CUBIC
            )
            for c in CAMERAS
        ]
        strip = np.concatenate(
            [np.pad(tile, ((0, 0), (0, 4), (0, 0)), constant_values=255) for tile in tiles], 1
        )
        band = np.full((BAND, strip.shape[1], 3), 255, np.uint8)
        cv2.putText(
            band, title, (2, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA
        )
        rows += [band, strip]
    write_atomic(Path("docs/images/first.png"), encode_png(np.concatenate(rows)))


if __name__ == "__main__":
    main()
