"""Redraws docs/images/first.png, and a picture of every operator, all from the embedded sample."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

import rpaug
from rpaug import Episode, Scene
from rpaug.core import registry
from rpaug.core.files import encode_png, write_atomic
from rpaug.pipeline import plan, prepare, recipe
from rpaug.pipeline.copies import PreparedEpisode, draw_copy
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
SIDE, BAND, GAP = 216, 26, 4
FRAME = 15


OPERATORS: dict[str, dict[str, Any]] = {
    "recolor": {"target": {"role": "manipulated"}, "color": "azure"},
    "retexture": {"target": {"role": "manipulated"}, "texture": "checker_red", "scale": 0.12},
    "table_texture": {"texture": "marble_green"},
    "background_texture": {"texture": "bricks_red"},
    "table_color": {"range": [[0.3, 0.7, 0.5], [0.3, 0.7, 0.5]]},
    "light_direction": {"to": [-0.6, 0.7, 0.4]},
    "light_color": {"range": [[0.5, 0.3, 0.25], [0.5, 0.3, 0.25]]},
    "camera_pose": {"camera": "static"},
    "sensor_noise": {"read": [0.05, 0.05]},
    "sensor_blur": {"sigma": [1, 1]},
    "sensor_jpeg": {"quality": [15, 15]},
    "sensor_exposure": {"stops": [0.8, 0.8]},
}
PAIR = ("front", "left_shoulder")  # of cameras: recorded and edited, side by side
SMALL = 128


def shown(scene: Scene, edits: list[dict[str, Any]]) -> Episode:
    """The sample as those edits show it."""
    made = recipe.build({"version": 1, "seed": 4, "edits": edits})
    planned = plan.make(prepare.operators(made), scene.episode)
    return draw_copy(PreparedEpisode(scene, planned, made), 1).episode


def first(scene: Scene) -> np.ndarray:
    """Four cameras, a row for each of ROWS."""
    rows = []
    for title, edits in ROWS:
        band = np.full((BAND, len(CAMERAS) * (SIDE + GAP), 3), 255, np.uint8)
        cv2.putText(
            band, title, (2, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA
        )
        rows += [band, strip([shown(scene, edits).views[c].rgb(FRAME) for c in CAMERAS], SIDE)]
    return np.concatenate(rows)


def strip(images: list[np.ndarray], side: int) -> np.ndarray:
    """Images of one height beside each other."""
    tiles = [cv2.resize(image, (side, side), interpolation=cv2.INTER_CUBIC) for image in images]
    return np.concatenate(
        [np.pad(tile, ((0, 0), (0, GAP), (0, 0)), constant_values=255) for tile in tiles], 1
    )


def main() -> None:
    """Write the pictures."""
    root, images = Path(rpaug.__file__).parent / "sample", Path("docs/images")
    adapter = registry.adapter_for(root)
    episode = adapter.read(root, adapter.episodes(root)[0])
    scene = build(episode, with_bodies=True)
    write_atomic(images / "first.png", encode_png(first(scene)))
    for name, fields in OPERATORS.items():
        edited = shown(scene, [{"op": name, **fields}])
        pairs = [one.views[c].rgb(FRAME) for c in PAIR for one in (episode, edited)]
        write_atomic(images / f"operators/{name}.png", encode_png(strip(pairs, SMALL)))


if __name__ == "__main__":
    main()
