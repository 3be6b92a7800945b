"""CPU seconds of each appearance and sensor operator on one episode, drawn and rendered, nothing written.

    python tools/bench/looks.py [--dataset FOLDER] [--json]

Seconds are process time on one thread. `draw` is the sampling of the edit (albedo, shading, frame, texture); `render`
asks for the rgb of every camera and frame, with the decoding of the recorded images it needs; `decode` is what asking
for the recorded rgb alone takes. `changed` is the share of pixels that differ. Kernels are compiled before the clock
starts. Without --dataset the embedded sample is used.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import rpaug
from rpaug import Episode, Scene
from rpaug.core import registry
from rpaug.pipeline import plan, prepare, recipe
from rpaug.pipeline.copies import PreparedEpisode, draw_copy
from rpaug.scene.build import build

RECEIVER = {"target": {"role": "receiver"}}
EDITS: dict[str, dict[str, Any]] = {
    "recolor": {"color": "azure", **RECEIVER},
    "retexture": {"texture": "checker_red", **RECEIVER},
    "light_color": {},
    "light_direction": {},
    "table_color": {},
    "table_texture": {"texture": "oak"},
    "background_texture": {"texture": "bricks_red"},
    "sensor_noise": {},
    "sensor_blur": {},
    "sensor_jpeg": {},
    "sensor_exposure": {},
}


def look(episode: Episode) -> float:
    """Seconds to ask for every rgb image."""
    start = time.process_time()
    for view in episode.views.values():
        for t in range(episode.length):
            view.rgb(t)
    return time.process_time() - start


def measure(scene: Scene, name: str) -> dict[str, float]:
    """Seconds and changed pixels of one operator."""
    made = recipe.build({"version": 1, "seed": 1, "edits": [{"op": name, **EDITS[name]}]})
    planned = plan.make(prepare.operators(made), scene.episode)
    prepared = PreparedEpisode(scene, planned, made)
    for view in draw_copy(prepared, 1).episode.views.values():
        view.rgb(0)
    start = time.process_time()
    final = draw_copy(prepared, 1)
    drawn = time.process_time() - start
    rendered = look(final.episode)
    changed = sum(final.tally.changed.values()) / sum(final.tally.total.values())
    return {"draw": drawn, "render": rendered, "changed": changed}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dataset", type=Path, default=Path(rpaug.__file__).parent / "sample")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    adapter = registry.adapter_for(arguments.dataset)
    episode = adapter.read(arguments.dataset, adapter.episodes(arguments.dataset)[0])
    scene = build(episode, with_bodies=True)
    look(episode)
    table = {"decode": {"render": look(episode)}}
    table |= {name: measure(scene, name) for name in EDITS}
    table = {row: {k: round(v, 3) for k, v in values.items()} for row, values in table.items()}
    if arguments.json:
        described = {"frames": episode.length, "cameras": len(episode.views), "seconds": table}
        sys.stdout.write(json.dumps(described) + "\n")
        return
    sys.stdout.write(f"{episode.length} frames x {len(episode.views)} cameras\n")
    sys.stdout.write(f"{'':20}{'draw s':>10}{'render s':>10}{'changed':>10}\n")
    for row, values in table.items():
        cells = [
            f"{values[k]:>10.3f}" if k in values else " " * 10
            for k in ("draw", "render", "changed")
        ]
        sys.stdout.write(f"{row:20}{''.join(cells)}\n")


if __name__ == "__main__":
    main()
