"""Redraw the picture of every operator but `stylize`, which needs weights, from the sample that ships, or from the twin
where an operator takes cast shadows.

python tools/make_pictures.py [OPERATOR ...]
"""

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import rpaug
from rpaug import Episode, Scene, twin
from rpaug.core import registry
from rpaug.core.files import write_atomic
from rpaug.pipeline import plan, prepare, recipe
from rpaug.pipeline.copies import PreparedEpisode, draw_copy
from rpaug.scene.build import build

FRAME, GAP = 15, 4

OPERATORS: dict[str, dict[str, Any]] = {
    "recolor": {"target": {"role": "manipulated"}, "color": "azure"},
    "retexture": {"target": {"role": "manipulated"}, "texture": "checker_red", "scale": 0.12},
    "table_texture": {"texture": "marble_green"},
    "background_texture": {"texture": "bricks_red"},
    "table_color": {"range": [[0.3, 0.7, 0.5], [0.3, 0.7, 0.5]]},
    "light_direction": {"to": [-0.6, 0.7, 0.4]},
    "light_color": {"range": [[0.5, 0.3, 0.25], [0.5, 0.3, 0.25]]},
    "camera_pose": {"camera": "static"},
    "remove": {"target": {"text": "the green thing"}},
    "move": {"target": {"text": "the green thing"}, "shift": 0.4},
    "duplicate": {"target": {"text": "the green thing"}, "count": 2},
    "spread": {},
    "object_size": {"target": {"handle": 221}, "range": [0.75, 0.75]},
    "insert": {"category": "mug", "near": {"role": "receiver"}, "within": 0.35},
    "distractors": {"count": 4},
    "physics": {"target": {"text": "the green thing"}, "material": "sand"},
    "sensor_noise": {"read": [0.05, 0.05]},
    "sensor_blur": {"sigma": [1, 1]},
    "sensor_jpeg": {"quality": [15, 15]},
    "sensor_exposure": {"stops": [0.8, 0.8]},
}
SHADOWED: dict[str, dict[str, Any]] = {"shadows": {"depth": [1.2, 1.2], "turn": 0.8}}
PAIR = ("front", "left_shoulder")  # of cameras: recorded and edited, side by side
SMALL = 128


def shown(scene: Scene, edits: list[dict[str, Any]]) -> Episode:
    """The sample as those edits show it."""
    made = recipe.build({"version": 1, "seed": 4, "edits": edits})
    planned = plan.make(prepare.operators(made), scene.episode)
    return draw_copy(PreparedEpisode(scene, planned, made), 1).episode


def strip(images: list[np.ndarray], side: int) -> np.ndarray:
    """Images of one height beside each other."""
    tiles = [cv2.resize(image, (side, side), interpolation=cv2.INTER_CUBIC) for image in images]
    return np.concatenate(
        [np.pad(tile, ((0, 0), (0, GAP), (0, 0)), constant_values=255) for tile in tiles], 1
    )


def small(image: np.ndarray) -> bytes:
    """A PNG packed as small as zlib can; rpaug's own are packed for speed."""
    packed = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
    return packed.tobytes()


def draw(episode: Episode, operators: dict[str, dict[str, Any]]) -> None:
    """Write the pictures of some operators."""
    scene = build(episode, with_bodies=True)
    for name, fields in operators.items():
        edited = shown(scene, [{"op": name, **fields}])
        pairs = [one.views[c].rgb(FRAME) for c in PAIR for one in (episode, edited)]
        write_atomic(Path(f"docs/images/operators/{name}.png"), small(strip(pairs, SMALL)))


def main() -> None:
    """Write the pictures."""
    asked = sys.argv[1:] or [*OPERATORS, *SHADOWED]
    plain, shadowed = (
        {name: fields for name, fields in some.items() if name in asked}
        for some in (OPERATORS, SHADOWED)
    )
    root = Path(rpaug.__file__).parent / "sample"
    adapter = registry.adapter_for(root)
    if plain:
        draw(adapter.read(root, adapter.episodes(root)[0]), plain)
    if shadowed:
        look = twin.Look(shadows=True)
        draw(twin.perform("put_in_box", 0, look=look, frames=17).episode, shadowed)


if __name__ == "__main__":
    main()
