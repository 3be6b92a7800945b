"""What an episode gains and loses by borrowing static Gaussians from another one of its place.

    python tools/bench/sharing.py --dataset RECORDINGS/rlbench_open_drawer --steps 800
    python tools/bench/sharing.py --twin open_drawer --steps 300

The dataset's first two episodes of one place, or the twin's recording of one layout and the same with the moved thing
in another color. The first lends. Prints, for the second fitted by itself, by itself in as many steps as a borrower
takes, and borrowing: Gaussians of its own, processor seconds of the fit (the lender's apart), PSNR at held-out times
over all cameras and at all looked-at times over the fixed ones, and megabytes in the store.
"""

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from rpaug import twin
from rpaug.core import registry
from rpaug.core.types import Episode, Scene
from rpaug.gaussians import cached, store
from rpaug.gaussians.descent import FitSettings, settings_for
from rpaug.pipeline import prepare
from rpaug.scene.build import build


def pair(given: argparse.Namespace) -> tuple[Episode, Episode]:
    """Who lends, and who borrows."""
    if given.twin:
        first = twin.perform(given.twin, given.seed, frames=given.frames).episode
        take = twin.perform(given.twin, given.seed, frames=given.frames, factor="object_color")
        return first, replace(take.episode, key="second")
    adapter = registry.adapter_for(given.dataset)
    donated = prepare.donors(adapter, given.dataset, adapter.episodes(given.dataset))
    borrower, donor_adapter = next(iter(donated.items()))
    return adapter.read(given.dataset, donor_adapter), adapter.read(given.dataset, borrower)


def row(name: str, scene: Scene, folder: Path, settings: FitSettings, donor: Any) -> dict:
    if donor is not None:
        cached.fitted(donor, folder, settings=settings)
    start = time.process_time()
    made, facts = cached.fitted(scene, folder, settings=settings, donor=donor)
    seconds = time.process_time() - start
    kept = store.described(folder, cached.name_of(scene, settings, 0, donor))
    return {
        "name": name,
        "steps": facts["steps"],
        "own": len(made.gaussians or ()) - facts.get("borrowed", 0),
        "borrowed": facts.get("borrowed", 0),
        "processor_seconds": seconds,
        "held_out_db": facts["held_out_db"],
        "fixed_db": facts["fixed_db"],
        "megabytes": kept["bytes"] / 1e6,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--twin", help="a task of the twin instead")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=17, help="that the twin records")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--json", type=Path, help="write the rows here too")
    given = parser.parse_args()
    first, second = (build(episode, with_bodies=True) for episode in pair(given))
    usual = replace(settings_for(steps=given.steps), threads=1)
    rows: list[dict] = []
    with tempfile.TemporaryDirectory() as work:
        for name, donor in (("by itself", None), ("borrowing", first), ("as many steps", None)):
            steps = rows[-1]["steps"] if name == "as many steps" else given.steps
            rows.append(row(name, second, Path(work), replace(usual, steps=steps), donor))
            print(json.dumps(rows[-1]), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
