"""How well the light on a patterned table is told from its pattern: new textures on the twin's wooden tables.

    python -m tools.bench.table_light [--seeds 4] [--by-place 0.6] [--hollow 0.1] [--json]

dB over the table against the table truly textured, the old albedo given: as recorded under distant lamps, and with both
recordings darkened as a lamp 0.7 m above the table would light them. `--by-place` and `--hollow` are the two limits of
`rpaug.scene.lighting.shading` by which light may vary over the place; `--by-place 0` never lets it.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from rpaug import CameraView, twin
from rpaug.core import geometry
from rpaug.core.metrics import psnr
from rpaug.core.types import Body, Episode, Scene
from rpaug.operators.table_texture import TableTexture
from rpaug.pipeline.contracts import shown
from rpaug.scene.lighting import shading
from tools.bench.harness.cases import CASES

LAMP, FLOOR = (
    np.array([0.1, 0.3, 0.7]),
    0.35,
)  # metres, above the world's table plane; light from elsewhere
TASKS = ("open_drawer", "pick_block", "push_button", "slide_block")


def near_lamp(episode: Episode) -> Episode:
    """The episode with every pixel darkened by what a small lamp near the table leaves of full light."""

    def darkened(view: CameraView, t: int) -> np.ndarray:
        assert view.depth is not None
        away = geometry.world_points(view.depth(t), view.camera, t)[..., :2] - LAMP[:2]
        light = FLOOR + (1 - FLOOR) * (1 + (away**2).sum(-1) / LAMP[2] ** 2) ** -1.5
        return np.rint(view.rgb(t) * light[..., None]).astype(np.uint8)

    views = {
        name: replace(view, rgb=lambda t, view=view: darkened(view, t))
        for name, view in episode.views.items()
    }
    return replace(episode, views=views)


def score(recorded: twin.Take, true: twin.Take) -> float:
    """dB over the table, all cameras, three frames."""
    (instance_id,) = true.truth.changed
    with tempfile.TemporaryDirectory() as folder:
        ask = CASES["table_texture"].ask(recorded, true, Path(folder))[0]
        fields = {**ask.steps[0], "target": {"handle": instance_id}}
        operator = TypeAdapter(TableTexture).validate_python(fields)
        episode = recorded.episode
        cameras = {name: view.camera for name, view in episode.views.items()}
        still = Body(frozenset({instance_id}), np.tile(np.eye(4), (episode.length, 1, 1)), "static")
        scene = Scene(episode, cameras, (still,), {}, False, episode.descriptions)
        after = shown(operator.apply(scene, operator.sample(scene, np.random.default_rng(0))))
        squares = []
        for name, view in true.episode.views.items():
            assert view.ids is not None
            for t in (0, episode.length // 2, episode.length - 1):
                inside = view.ids(t) == instance_id
                off = after.views[name].rgb(t)[inside].astype(float) - view.rgb(t)[inside]
                squares.append((off**2).mean(-1))
    return psnr(float(np.concatenate(squares).mean()))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--by-place", type=float, default=shading.BY_PLACE)
    parser.add_argument("--hollow", type=float, default=shading.HOLLOW)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    shading.BY_PLACE, shading.HOLLOW = arguments.by_place, arguments.hollow
    rows = []
    for seed in range(arguments.seeds):
        task = TASKS[seed % len(TASKS)]
        takes = [
            twin.perform(task, seed, factor=factor, frames=17) for factor in (None, "table_texture")
        ]
        lit = [replace(take, episode=near_lamp(take.episode)) for take in takes]
        rows.append({"distant": score(*takes), "near": score(*lit)})
    mean = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    if arguments.json:
        sys.stdout.write(json.dumps({"rows": rows, "mean": mean}) + "\n")
        return
    for number, row in enumerate([*rows, mean]):
        label = "mean" if number == len(rows) else f"seed {number}"
        sys.stdout.write(
            f"{label:8} distant {row['distant']:5.1f} dB   near {row['near']:5.1f} dB\n"
        )


if __name__ == "__main__":
    main()
