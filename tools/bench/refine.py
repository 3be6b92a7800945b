"""What the joint fine-tune of edited Gaussians brings, against the truly changed twin.

    python -m tools.bench.refine --task stack_cups --seed 2 --factor object_color

PSNR in dB of Gaussian renders: in the changed region, with its outline (2 pixels), and over whole images, in the
recorded cameras and in moved ones, before and after. Seconds are processor time.
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from pydantic import TypeAdapter

from rpaug import twin
from rpaug.compose import joint, views
from rpaug.core import registry
from rpaug.core.metrics import decibels
from rpaug.core.types import Scene
from rpaug.gaussians.descent import settings_for
from rpaug.gaussians.fit import fitted
from rpaug.scene.build import build
from tools.bench.harness.cases import CASES

TIMES = (2, 5, 8, 11, 15)


def main() -> None:
    """Print a table, or one JSON value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="stack_cups")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--factor", default="object_color")
    parser.add_argument("--fit-steps", type=int, default=700)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    size = {"frames": 17, "size": 128}
    recorded = twin.perform(options.task, options.seed, **size)
    true = twin.perform(
        options.task, options.seed, factor=options.factor, target="manipulated", **size
    )
    moved = twin.perform(
        options.task, options.seed, factor="camera_pose", look=true.truth.new, **size
    )
    settings = replace(settings_for(steps=options.fit_steps), threads=1)
    base, _ = fitted(build(recorded.episode, with_bodies=True), settings=settings)
    scene = edited(base, options.factor, recorded, true)
    start = time.process_time()
    tuned, facts = joint.refined(scene)
    facts["processor_seconds"] = round(time.process_time() - start, 1)
    figures = {
        f"{name}, {cameras}": scores(one, take, true.truth.changed)
        for name, one in (("before", scene), ("after", tuned))
        for cameras, take in (("recorded cameras", true), ("moved cameras", moved))
    }
    if options.json:
        sys.stdout.write(json.dumps({"facts": facts, "figures": figures}, indent=1) + "\n")
        return
    for key, value in (facts | figures).items():
        sys.stdout.write(f"{key}: {value}\n")


def edited(base: Scene, factor: str, recorded: twin.Take, true: twin.Take) -> Scene:
    """The fitted scene with the factor changed as the truth was, told all that the truth knows."""
    case = CASES[factor]
    with tempfile.TemporaryDirectory() as folder:
        ask = case.ask(recorded, true, Path(folder))[0]
        kind, scene = TypeAdapter(registry.operator(case.operator)), base
        for fields in ask.steps:
            operator = kind.validate_python(dict(fields))
            edit = ask.edit or operator.sample(base, np.random.default_rng(0))
            scene = operator.apply(scene, json.loads(json.dumps(edit)))
    return scene


def scores(scene: Scene, take: twin.Take, changed: tuple[int, ...]) -> dict[str, float]:
    """PSNR of Gaussian renders in a take's cameras against its images."""
    cameras = {name: view.camera for name, view in take.episode.views.items()}
    shown = views.edited(
        replace(scene, cameras=cameras), dict.fromkeys(cameras, 3), lambda *_: None
    )
    inside, outline, whole = [], [], []
    for t in TIMES:
        for name, view in take.episode.views.items():
            assert view.ids is not None
            difference = (shown.views[name].rgb(t).astype(float) - view.rgb(t)) / 255
            error = (difference**2).mean(-1)
            mask = np.isin(view.ids(t), list(changed))
            inside.append(error[mask])
            outline.append(error[cv2.dilate(mask.astype(np.uint8), np.ones((5, 5))) > 0])
            whole.append(error.ravel())
    named = {"inside": inside, "with outline": outline, "whole image": whole}
    return {key: round(decibels(float(np.concatenate(e).mean())), 2) for key, e in named.items()}


if __name__ == "__main__":
    main()
