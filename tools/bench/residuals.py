"""How well the residuals that the planner measures foretell the true error of moved cameras, on the twin.

    python tools/bench/residuals.py --seeds 6 [--json FILE]

The twin records an episode, and the same motion from truly moved cameras. Foretold is what
`rpaug.pipeline.residuals` measures on the recording alone; true is the error of the surfels' view against the truth
over all frames looked at. Bodies as rpaug tracks them. Prints, for backgrounds and for bodies of at least 200 pixels,
how far the foretold PSNR is above the true one: mean, and root mean square around it.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpaug import twin
from rpaug.core.metrics import decibels
from rpaug.pipeline import residuals
from rpaug.scene.build import build
from rpaug.scene.recorded import surfels

LOOKED = 4  # frames between the true views
LARGE = 200  # pixels


def rows(task: str, seed: int, frames: int) -> list[dict[str, object]]:
    """One row for each camera and region of a recording."""
    recorded = twin.perform(task, seed, frames=frames)
    true = twin.perform(task, seed, frames=frames, factor="camera_pose")
    scene = build(recorded.episode, with_bodies=True)
    moved = {name: true.episode.views[name].camera for name in true.truth.bumps}
    kept, instance_ids = surfels.build(scene), residuals.regions(scene)
    found = []
    for one in residuals.measure(scene, moved):
        there = replace(scene, cameras={**scene.cameras, one.camera: moved[one.camera]})
        squared = []
        for t in range(0, frames, LOOKED):
            seen = true.episode.views[one.camera]
            error = (surfels.view(kept, there, one.camera, t).image / 255 - seen.rgb(t) / 255) ** 2
            squared.append(error.mean(-1)[np.isin(seen.ids(t), list(instance_ids[one.region]))])
        all_of_it = np.concatenate(squared)
        if len(all_of_it):
            off = decibels(float(all_of_it.mean()))
            found.append({**vars(one), "task": task, "seed": seed, "true_psnr": off})
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--frames", type=int, default=17)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    tasks = list(twin.TASKS)
    found = [r for s in range(given.seeds) for r in rows(tasks[s % len(tasks)], s, given.frames)]
    for kind in ("background", "body"):
        some = [r for r in found if r["region"].startswith(kind) and r["pixels"] >= LARGE]
        above = np.array([r["psnr"] - r["true_psnr"] for r in some])
        print(
            f"{kind}: {len(some)} regions, true {np.mean([r['true_psnr'] for r in some]):.1f} dB, ",
            end="",
        )
        print(f"foretold {above.mean():+.1f} dB from that, rms {above.std():.1f} dB")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
