"""Edits of the twin whose depth is what a depth camera measures: with holes, flying pixels, noise and steps.

    python -m tools.bench.depth_sensor [--seeds 4] [--first 0] [--sensor stereo] [--factor F] [--raw]

Colors, masks and calibration are the recording's; depth is measured by one of `SENSORS`. `--raw` takes the depth as it
comes, without what `rpaug.scene.recorded.sensed` makes of it. Errors are those of `tools.bench.photographed`: dB of
the truly changed pixels, of cameras that moved and of what was removed of those that some camera saw.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from rpaug import twin
from rpaug.core.errors import RpaugError
from rpaug.core.metrics import psnr
from rpaug.core.types import CameraView, Episode, Scene
from rpaug.scene import build
from rpaug.scene.recorded import sensed
from tools.bench import photographed
from tools.bench.harness.cases import CASES, FactorCase
from tools.bench.photographed_truths import changed, made

Depth = Float32[np.ndarray, "h w"]
LEVELS = 0.5, 0.9, 0.99
EDGE = 0.02  # share of its depth by which neighbours differ that lie on two surfaces
NOTHING = float("nan")
FACTORS = (
    "removal",
    "distractor",
    "object_size",
    "camera_pose",
    "light_direction",
    "object_texture",
    "table_texture",
)


@dataclass(frozen=True)
class DepthSensor:
    """A depth camera, at the color's pixels. Stereo: `baseline` metres, `disparity` pixels of noise at `width` pixels
    across. Time of flight (no baseline): `share` of the depth as noise. `still` is the share of the noise's variance
    that is the same in all frames; `flying` of edge pixels lie between both surfaces; `lost` of the image are holes
    that come and go; depth comes in `step` metres."""

    baseline: float
    disparity: float
    width: int
    share: float
    still: float
    flying: float
    lost: float
    step: float

    def measured(self, depth: Depth, focal: float, still: Depth, rng: np.random.Generator) -> Depth:
        """One image as it is recorded; `still` is noise of deviation 1 that stays."""
        z = depth.astype(np.float64)
        known = z > 0
        z = np.where(known, z, np.inf)
        width = z.shape[1]
        noise = np.sqrt(self.still) * still + np.sqrt(1 - self.still) * smooth(rng, z.shape)
        if self.baseline:
            scale = (
                focal * self.width / width * self.baseline
            )  # disparity = scale / z, native pixels
            steps = np.rint((scale / z + self.disparity * noise) * 32) / 32  # as chips interpolate
            seen = scale / np.maximum(steps, 1e-6)
            known &= ~shadowed(z, focal * self.baseline) & (steps > 1)
        else:
            seen = z * (1 + self.share * noise)
        near, far = extremes(z)
        edge = np.isfinite(far) & (far - near > EDGE * near)
        flies = edge & (rng.random(z.shape) < self.flying)
        share = rng.random(z.shape)
        seen = np.where(
            flies, near * share + np.where(np.isfinite(far), far, near) * (1 - share), seen
        )
        known &= np.isfinite(seen) & (smooth(rng, z.shape) < quantile(self.lost))
        return np.where(known, np.rint(seen / self.step) * self.step, 0).astype(np.float32)


SENSORS: Mapping[str, DepthSensor] = {
    "stereo": DepthSensor(0.05, 0.08, 848, 0, 0.5, 0.4, 0.02, 0.001),
    "stereo, wide": DepthSensor(0.12, 0.15, 1280, 0, 0.5, 0.3, 0.01, 0.001),
    "time of flight": DepthSensor(0, 0, 640, 0.003, 0.5, 0.6, 0.03, 0.001),
}
"""As a D435 class, a ZED class and an Azure Kinect class camera measure."""


def smooth(rng: np.random.Generator, shape: tuple[int, ...]) -> Depth:
    """Noise of deviation 1 that neighbours share."""
    made = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), 0.8)
    return made / made.std()


def quantile(share: float) -> float:
    """What so large a share of `smooth` lies above."""
    return NormalDist().inv_cdf(1 - share)


def extremes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest and the farthest of each pixel's neighbourhood."""
    around = np.ones((3, 3), np.uint8)
    return cv2.erode(z, around), cv2.dilate(z, around)


def shadowed(z: np.ndarray, scale: float) -> Bool[np.ndarray, "h w"]:
    """What the second eye, to the right, does not see: something nearer stands before it."""
    columns = np.arange(z.shape[1])
    hidden = np.zeros(z.shape, bool)
    for row, line in enumerate(z):
        at = columns - scale / line
        nearest = np.minimum.accumulate(at[::-1])[::-1]  # of what lies to the right
        hidden[row] = at > nearest + 0.5
    return hidden


def recorded_by(episode: Episode, sensor: DepthSensor, seed: int) -> Episode:
    """The episode with the depth that the sensor gives of it."""

    def sensed(name: str, view: CameraView, number: int) -> CameraView:
        assert view.depth is not None
        still = smooth(np.random.default_rng([seed, number]), view.depth(0).shape)
        images = [
            sensor.measured(
                view.depth(t), view.camera.K[0, 0], still, np.random.default_rng([seed, number, t])
            )
            for t in range(episode.length)
        ]
        return replace(view, depth=images.__getitem__)

    views = {n: sensed(n, v, k) for k, (n, v) in enumerate(episode.views.items())}
    return replace(episode, views=views)


@dataclass(frozen=True)
class Row:
    """One edit of one recording; `off` is how many metres the copy's depth is off where things changed, median;
    `missing` of those pixels have none. `refused` says why there was no edit."""

    sensor: str
    factor: str
    seed: int
    task: str
    db: float
    unedited: float
    off: float
    missing: float
    outside: float
    seconds: float
    refused: str = ""


def rows(seed: int, sensors: Sequence[str], factors: Sequence[str], folder: Path) -> Iterator[Row]:
    """The edits of one seed, by all sensors; "exact" is the recording itself."""
    task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
    takes: dict[Any, twin.Take] = {}
    scenes: dict[Any, Scene] = {}
    for factor in factors:
        case = CASES[factor]
        if case.lamps not in takes:
            look = twin.Look(antialias=True, lamps=case.lamps)
            takes[case.lamps] = twin.perform(
                task, seed, look=look, frames=photographed.FRAMES, size=photographed.SIZE
            )
        recorded = takes[case.lamps]
        true = changed(case, factor, recorded)
        for name in sensors:
            if (case.lamps, name) not in scenes:
                episode = recorded.episode
                if name != "exact":
                    episode = recorded_by(episode, SENSORS[name], seed)
                scenes[case.lamps, name] = build.build(episode, with_bodies=True)
            yield row(scenes[case.lamps, name], case, factor, recorded, true, name, folder)


def row(
    scene: Scene,
    case: FactorCase,
    factor: str,
    recorded: twin.Take,
    true: twin.Take,
    sensor: str,
    folder: Path,
) -> Row:
    """One edit, held against the truth."""
    refused, start, figures = "", time.process_time(), (NOTHING,) * 5
    try:
        ask = case.ask(recorded, true, folder)[-1]
        copy = made(scene, case.operator, ask.steps[0], ask.edit)
        figures = scored(scene, copy, recorded, true, factor)
    except RpaugError as refusal:
        refused = str(refusal)
    spent = time.process_time() - start
    return Row(sensor, factor, true.truth.seed, true.truth.task, *figures, spent, refused)


def scored(
    scene: Scene, copy: Any, recorded: twin.Take, true: twin.Take, factor: str
) -> tuple[float, ...]:
    """dB where something truly changed, the recording's own, metres off, the share without depth; share of the pixels
    that no true change reaches and the edit changes."""
    squares, before, off, outside = [], [], [], [0, 0]
    for name, view in copy.episode.views.items():
        if factor == "camera_pose" and name not in true.truth.bumps:
            continue
        goal = true.episode.views[name]
        for t in range(copy.episode.length):
            old, now, wanted = recorded.episode.views[name].rgb(t), view.rgb(t), goal.rgb(t)
            inside = photographed.reached(true, factor, name, t, wanted, old)
            judged = inside.copy()
            if factor in photographed.SEEN:
                judged &= ~copy.tally.holes.get(f"{name}/{t}", np.zeros_like(inside))
            squares.append(((now[judged].astype(float) - wanted[judged]) ** 2).mean(-1))
            before.append(((old[judged].astype(float) - wanted[judged]) ** 2).mean(-1))
            assert view.depth is not None
            assert goal.depth is not None
            depth = view.depth(t)[judged]
            off.append(np.where(depth > 0, np.abs(depth - goal.depth(t)[judged]), NOTHING))
            outside[0] += int(((now != old).any(-1) & ~inside).sum())
            outside[1] += int((~inside).sum())
    apart = np.concatenate(off)
    db, unedited = (psnr(float(np.concatenate(part).mean())) for part in (squares, before))
    return (
        db,
        unedited,
        float(np.nanmedian(apart)),
        float(np.isnan(apart).mean()),
        outside[0] / max(outside[1], 1),
    )


def depths(seed: int, sensor: str) -> str:
    """How far the fixed cameras' depth is off, as it comes, repaired, and where that filled it."""
    task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
    look, frames = twin.Look(antialias=True), photographed.FRAMES
    true = twin.perform(task, seed, look=look, frames=frames, size=photographed.SIZE).episode
    seen = recorded_by(true, SENSORS[sensor], seed)
    repaired = sensed.repaired(seen)
    off: list[list[np.ndarray]] = [[], [], []]
    holes, left = [], []
    for name, view in true.views.items():
        for t in range(0, frames, 4) if view.camera.fixed else ():
            exact, raw, now = (one.views[name].depth(t) for one in (true, seen, repaired))  # type: ignore[misc]
            for part, depth, where in (
                (off[0], raw, raw > 0),
                (off[1], now, now > 0),
                (off[2], now, (raw == 0) & (now > 0)),
            ):
                part.append(np.abs(depth - exact)[where])
            holes.append((raw == 0).mean())
            left.append((now == 0).mean())
    said = [one.spread for view in repaired.views.values() if (one := view.sensed)]
    cells = [
        "; ".join(f"{1000 * mm:.1f}" for mm in np.quantile(np.concatenate(part), LEVELS))
        for part in off
    ]
    shares = f"{100 * np.mean(holes):.1f} | {100 * np.mean(left):.1f}"
    return f"{sensor} | {' | '.join(cells)} | {shares} | {1000 * np.median(said):.0f}"


def main() -> None:
    """The figures, edit by edit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sensor", choices=("exact", *SENSORS), action="append")
    parser.add_argument("--factor", choices=FACTORS, action="append", help="only these edits")
    parser.add_argument("--depth", action="store_true", help="the depth itself, of one seed")
    parser.add_argument("--raw", action="store_true", help="take depth as it comes")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.depth:
        for sensor in given.sensor or SENSORS:
            sys.stdout.write(f"{depths(given.first, sensor)}\n")
        return
    found = list[Row]()
    as_it_comes = patch.object(sensed, "repaired", lambda episode: episode)
    with tempfile.TemporaryDirectory() as folder, as_it_comes if given.raw else nullcontext():
        for seed in range(given.first, given.first + given.seeds):
            sensors = given.sensor or ["exact", *SENSORS]
            for one in rows(seed, sensors, given.factor or FACTORS, Path(folder)):
                found.append(one)
                sys.stderr.write(f"{vars(one)}\n")
    if given.json:
        sys.stdout.write(json.dumps([vars(one) for one in found], indent=1) + "\n")
        return
    for factor in given.factor or FACTORS:
        for sensor in given.sensor or ["exact", *SENSORS]:
            mine = [one for one in found if (one.factor, one.sensor) == (factor, sensor)]
            made = [one for one in mine if not one.refused]
            cells = [f"{len(made)} of {len(mine)}"]
            for field in ("db", "unedited", "off", "missing", "outside", "seconds"):
                values = [getattr(one, field) for one in made]
                cells.append(f"{np.mean(values):.4g}" if values else "-")
            sys.stdout.write(f"{factor} | {sensor} | " + " | ".join(cells) + "\n")


if __name__ == "__main__":
    main()
