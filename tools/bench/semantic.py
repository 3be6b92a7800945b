"""Handles of Gaussians: weighted vote against learned encodings, with good and with bad masks; and a part told apart.

    python tools/bench/semantic.py [masks] [parts] [--task stack_cups] [--steps 1500] [--size 128] [--json FILE]

masks: one fit on the twin, then its Gaussians' handles from masks as recorded, with 10 % wrong pixels, and with two
handles swapped in a quarter of the pictures. mIoU (up) is the mean over handles of intersection over union, summed
over views: of recorded views at times that were and were not looked at, of cameras truly moved by up to 0.1 m and
0.05 rad, there over all pixels and over those that any camera recorded (co-visible).
parts: a stove whose masks know no knobs, one box in one image; IoU (up) of the knob over all cameras, of vote and
encodings fine-tuned on the stove's Gaussians alone and of encodings all fine-tuned (direct distillation), on the same
prompts; changed: Gaussians outside the stove whose encoding or handle is another afterwards.
Seconds are processor seconds.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from surfels import covisible

from rpaug.core.types import CameraView, Episode, Scene
from rpaug.gaussians import fit, semantic
from rpaug.gaussians.descent import FitSettings
from rpaug.gaussians.distil import FINE_TUNING
from rpaug.gaussians.encoding import Learning, descend, neighbours
from rpaug.scene.build import build
from rpaug.twin import Bump, Look, perform

FRAMES = 30
LEARNING = Learning()
KNOB_TIMES = (0, 6, 12, 17)


class Overlap:
    """Intersection and union of each handle's masks, summed over views."""

    def __init__(self) -> None:
        self.sums: dict[int, list[int]] = {}

    def add(self, made: np.ndarray, true: np.ndarray, where: np.ndarray | bool = True) -> None:
        for instance_id in np.unique(true):
            a, b = (made == instance_id) & where, (true == instance_id) & where
            entry = self.sums.setdefault(int(instance_id), [0, 0])
            entry[0] += int((a & b).sum())
            entry[1] += int((a | b).sum())

    @property
    def mean(self) -> float:
        return float(np.mean([i / u for i, u in self.sums.values() if u]))


def fitted(episode: Episode, steps: int) -> tuple[Scene, float]:
    settings = FitSettings(steps=steps, train_frames=16, checked_frames=4)
    scene, report = fit.fitted(build(episode, with_bodies=True), settings=settings)
    return scene, report.train_db


def spoiled(
    pictures: Sequence[semantic.Labelled], fault: str, seed: int
) -> list[semantic.Labelled]:
    """Masks as recorded, with 10 % of the pixels drawn at random, or two handles swapped in every fourth picture."""
    rng = np.random.default_rng(seed)
    found = np.unique(np.concatenate([np.unique(p.ids) for p in pictures]))
    out = []
    for k, picture in enumerate(pictures):
        ids = picture.ids
        if fault == "10 % wrong pixels":
            ids = np.where(rng.random(ids.shape) < 0.1, rng.choice(found, ids.shape), ids)
        elif fault == "handles swapped" and k % 4 == 0:
            shown = np.unique(ids)
            a, b = rng.choice(shown, 2, replace=False) if len(shown) > 1 else (0, 0)
            ids = np.where(ids == a, b, np.where(ids == b, a, ids))
        out.append(replace(picture, ids=ids.astype(np.int32)))
    return out


def judged(scene: Scene, moved: Episode, masks: Callable[[Scene], Callable]) -> dict[str, float]:
    static = frozenset(h for b in scene.bodies if b.motion == "static" for h in b.instance_ids)
    looked = {p.t for p in semantic.recorded(scene)}
    seen, unseen = sorted(looked)[::3], sorted(set(range(scene.episode.length)) - looked)[::4]
    rows = {
        "recorded": Overlap(),
        "other times": Overlap(),
        "moved": Overlap(),
        "co-visible": Overlap(),
    }
    drawn = masks(scene)
    for t in (*seen, *unseen):
        for name, view in scene.episode.views.items():
            rows["recorded" if t in looked else "other times"].add(drawn(name, t), view.ids(t))
    elsewhere = replace(scene, cameras={n: v.camera for n, v in moved.views.items()})
    drawn = masks(elsewhere)
    for t in (*seen, *unseen):
        for name, view in moved.views.items():
            if view.camera.fixed:
                made, true = drawn(name, t), view.ids(t)
                rows["moved"].add(made, true)
                rows["co-visible"].add(made, true, covisible(scene, static, view, t))
    return {name: row.mean for name, row in rows.items()}


def compare_masks(task: str, steps: int, size: int, seed: int) -> list[dict]:
    take = perform(task, seed, size=size, frames=FRAMES)
    rng = np.random.default_rng(seed)
    bumps = {
        name: Bump(turn=tuple(rng.uniform(-0.05, 0.05, 3)), shift=tuple(rng.uniform(-0.1, 0.1, 3)))
        for name in ("front", "left_shoulder", "right_shoulder")
    }
    moved = perform(task, seed, size=size, frames=FRAMES, look=Look(bumps=bumps)).episode
    moved = replace(moved, views={n: v for n, v in moved.views.items() if n in bumps})
    scene, level = fitted(take.episode, steps)
    print(f"{len(scene.gaussians)} Gaussians, {level:.1f} dB at fitted times")
    semantic.vote(
        scene, semantic.recorded(scene, 1)
    )  # kernels are compiled before anything is timed
    stage = semantic.LabelRenderer(scene)
    rows = []
    for fault in ("as recorded", "10 % wrong pixels", "handles swapped"):
        pictures = spoiled(semantic.recorded(scene), fault, seed)
        start = time.process_time()
        ids = semantic.vote(scene, pictures, stage)
        seconds = time.process_time() - start

        def by_vote(at: Scene, ids: np.ndarray = ids) -> Callable:
            there = semantic.LabelRenderer(at)
            return lambda name, t: semantic.mask(ids, there, name, t)

        rows.append(
            {"method": "vote", "masks": fault, "seconds": seconds, **judged(scene, moved, by_vote)}
        )
        start = time.process_time()
        learned = semantic.learn(scene, pictures, settings=LEARNING, stage=stage)
        seconds = time.process_time() - start

        def by_encodings(at: Scene, learned: semantic.Identities = learned) -> Callable:
            there = semantic.LabelRenderer(at)
            return lambda name, t: semantic.identity_mask(learned, there, name, t)

        rows.append(
            {
                "method": "encodings",
                "masks": fault,
                "seconds": seconds,
                **judged(scene, moved, by_encodings),
            }
        )
        for row in rows[-2:]:
            print(_line(row), flush=True)
    return rows


def compare_parts(steps: int, size: int, seed: int) -> list[dict]:
    take = perform("put_on_stove", seed, size=size, frames=18)
    names = take.truth.handles
    stove, knobs = names["stove"], [names["knob_left"], names["knob_right"]]

    def coarse(view: CameraView) -> CameraView:
        read = view.ids
        return replace(
            view, ids=lambda t: np.where(np.isin(read(t), knobs), stove, read(t)).astype(np.int32)
        )

    views = {name: coarse(view) for name, view in take.episode.views.items()}
    scene, level = fitted(replace(take.episode, views=views), steps)
    print(f"{len(scene.gaussians)} Gaussians, {level:.1f} dB at fitted times")
    stage, whole = semantic.LabelRenderer(scene), frozenset([stove])
    start = time.process_time()
    known = semantic.learn(scene, settings=LEARNING, stage=stage)
    print(f"encodings of the coarse masks: {time.process_time() - start:.1f} s")
    others = scene.gaussians.ids != stove
    rows = []
    for number, knob in enumerate(knobs):
        at = np.argwhere(take.episode.views["front"].ids(0) == knob)
        (top, left), (bottom, right) = at.min(0) - 1.0, at.max(0) + 1.0
        prompt = semantic.PartPrompt("front", 0, (left, top, right, bottom))
        for method in ("vote", "encodings"):
            start = time.process_time()
            given = semantic.tell_apart(scene, whole, prompt, by=method, identities=known)
            row = {
                "knob": number,
                "method": f"ISD, {method}",
                "seconds": time.process_time() - start,
            }
            changed = (given.scene.gaussians.ids != scene.gaussians.ids)[others].sum()
            if given.identities is not None:
                changed += (given.identities.encodings != known.encodings)[others].any(-1).sum()
            rows.append(
                row
                | {
                    "iou": _knob(
                        take.episode,
                        given.scene,
                        given.scene.gaussians.ids,
                        given.instance_id,
                        knob,
                    ),
                    "changed": int(changed),
                }
            )
        start = time.process_time()
        made = _direct(scene, stage, known, given, seed)
        seconds = time.process_time() - start
        changed = (made.encodings != known.encodings)[others].any(-1).sum()
        rows.append({"knob": number, "method": "direct, all encodings", "seconds": seconds,
                     "iou": _knob(take.episode, scene, made.ids, given.instance_id, knob), "changed": int(changed),
                     "other_ids_changed": int((made.ids != known.ids)[others].sum())})  # fmt: skip
        for row in rows[-3:]:
            print(json.dumps(row), flush=True)
    return rows


def _direct(
    scene: Scene,
    stage: semantic.LabelRenderer,
    known: semantic.Identities,
    given: semantic.Told,
    seed: int,
) -> semantic.Identities:
    """The ablation: the same prompts' masks laid over the recorded ones, everything fine-tuned for as many steps."""
    laid = []
    for picture in given.pictures:
        recorded = scene.episode.views[picture.camera].ids(picture.t)
        laid.append(
            replace(
                picture,
                ids=np.where(picture.ids == given.instance_id, given.instance_id, recorded).astype(
                    np.int32
                ),
            )
        )
    assert given.identities is not None
    row = int(np.flatnonzero(given.identities.instance_ids == given.instance_id)[0])
    like = known.weight[
        np.flatnonzero(known.instance_ids == min(given.pictures[0].ids[given.pictures[0].ids > 0]))[
            0
        ]
    ]
    rng = np.random.default_rng(seed)
    nudge = rng.normal(0, float(known.weight.std()), like.shape).astype(np.float32)
    begun = semantic.Identities(
        known.encodings,
        np.insert(known.weight, row, like + nudge, 0),
        np.insert(known.offset, row, 0).astype(np.float32),
        given.identities.instance_ids,
    )
    near = neighbours(scene.gaussians.means, LEARNING.neighbours)
    return descend(begun, laid, stage, near, settings=FINE_TUNING, rng=rng)


def _knob(episode: Episode, scene: Scene, ids: np.ndarray, instance_id: int, knob: int) -> float:
    stage, both, either = semantic.LabelRenderer(scene), 0, 0
    for name, view in episode.views.items():
        for t in KNOB_TIMES:
            made, true = semantic.mask(ids, stage, name, t) == instance_id, view.ids(t) == knob
            both, either = both + (made & true).sum(), either + (made | true).sum()
    return float(both / either)


def _line(row: dict) -> str:
    scores = "  ".join(
        f"{name} {row[name]:.3f}" for name in ("recorded", "other times", "moved", "co-visible")
    )
    return f"{row['masks']:20}{row['method']:12}{row['seconds']:7.1f} s  {scores}"


def main() -> None:
    """Run what was asked for and print tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", nargs="*", default=["masks", "parts"], choices=["masks", "parts"])
    parser.add_argument("--task", default="stack_cups")
    parser.add_argument("--steps", type=int, default=1500, help="of the fit")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--parts-size", type=int, default=192)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--json", type=Path, help="write the tables here too")
    given = parser.parse_args()
    tables = {}
    if "masks" in given.what:
        tables["masks"] = compare_masks(given.task, given.steps, given.size, given.seed)
    if "parts" in given.what:
        tables["parts"] = compare_parts(given.steps, given.parts_size, given.seed)
    if given.json:
        given.json.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()
