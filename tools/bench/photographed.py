"""Every edit by the quality of its models, on the twin photographed, with depth, masks and calibration hidden.

    python -m tools.bench.photographed [--seeds 6] [--first 0] [--quality middle] [--factor F] [--crf 23] [--posed]

Of each seed's recording only the fixed cameras' colors are kept, as a cheap camera takes them
(`tools.bench.photographing`), their intrinsics, and poses as far off as `rpaug calibrate` leaves them. Models of a
quality (`tools.bench.scripted`, `tools.bench.scripted_depth`) outline everything on the table by its part's name, and
give depth. The edit's truth is taken by the same camera without noise and files, which nobody can foresee. dB are of
the truly changed pixels; of cameras that moved and of what was removed or put elsewhere, of those that some camera saw.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from rpaug import twin
from rpaug.compose import inserted
from rpaug.core import geometry, instance_ids, registry
from rpaug.core.errors import RpaugError
from rpaug.core.metrics import psnr
from rpaug.core.types import CameraView, Effect, Episode, Scene
from rpaug.operators import insert
from rpaug.providers.models_settings import Models
from rpaug.scene.build import find, sources
from rpaug.scene.instances.by_models import AskedModels
from rpaug.twin.tabletop import TABLE
from tools.bench import photographed_truths, photographing, rgb_only, scripted
from tools.bench.harness.cases import FactorCase
from tools.bench.photographed_truths import MEASURED, changed, made
from tools.bench.scripted_depth import ScriptedDepth

WORDS = ("object_color", "object_texture", "removal", "object_size", *photographed_truths.TRUTHS)
PLACE, TURN = (
    0.0042 / 1.6,
    np.radians(0.31) / 1.6,
)  # deviations a side of what calibration's medians come to
SEEN = (
    "camera_pose",
    "removal",
    *photographed_truths.TRUTHS,
)  # factors whose error is that of what somebody saw
DIFFERS = 2  # grey levels by which truth and recording differ where something changed
NOTHING = float("nan")
SIZE, FRAMES = 128, 17


@dataclass(frozen=True)
class Row:
    """One edit of one seed; `refused` says why there was none."""

    quality: str
    factor: str
    seed: int
    task: str
    db: float
    unedited: float  # dB, of the recording itself
    outside: float  # share of the pixels that no true change reaches and the edit changes
    iou: float  # of what was put in
    depth: float  # metres that it is off, median
    grain: float  # its noise over time by the truth's, as taken; nan where nothing was put in
    fine: float  # the same of what differs from pixel to pixel
    taken: float  # dB, of the truth as the camera takes it, with noise and files
    masked: float  # dB, of the true colors within the masks of an edit of colors and the recording elsewhere
    error: float  # of the scene's depth, share, median
    told: float  # how far that was said to be off
    seconds: float
    refused: str = ""


@dataclass(frozen=True)
class Asked(AskedModels):
    """Models of a run, the one of depth scripted."""

    scripted: ScriptedDepth | None = None

    def depth(self) -> ScriptedDepth | None:
        return self.scripted


def calibrated(episode: Episode, seed: int, *, posed: bool) -> Episode:
    """The fixed cameras' colors, with intrinsics, and poses that are off, unless `posed`; the table at z = 0."""
    rng = np.random.default_rng([seed, 29])
    bare = rgb_only.bare(episode)

    def placed(name: str, view: CameraView) -> CameraView:
        true = episode.views[name].camera
        off = geometry.rigid(rng.normal(0, TURN, 3), rng.normal(0, PLACE, 3))
        pose = lowered(true.cam_to_world[0]) @ (np.eye(4) if posed else off)
        track = np.tile(pose, (episode.length, 1, 1))
        return replace(view, camera=replace(true, cam_to_world=track))

    return replace(bare, views={name: placed(name, view) for name, view in bare.views.items()})


def lowered(pose: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "4 4"]:
    """A pose in the world whose z = 0 is the table."""
    return geometry.rigid(np.zeros(3), np.array([0, 0, -TABLE])) @ pose


@dataclass(frozen=True)
class Shot:
    """A recording, the photographs of it, and what its parts are called."""

    recorded: twin.Take
    seen: Episode
    named: Mapping[str, tuple[int, ...]]
    seed: int

    @classmethod
    def of(
        cls, recorded: twin.Take, changed: frozenset[int], faults: photographing.CameraFaults
    ) -> "Shot":
        """Everything on the table has a name of its own, and what is changed is one thing."""
        handles = recorded.truth.handles.items()
        parts = sorted(h for n, h in handles if not n.startswith(rgb_only.ROOM))
        named = {f"thing{chr(97 + k)}": (h,) for k, h in enumerate(parts) if h not in changed}
        if changed:
            named[rgb_only.NAMED] = tuple(sorted(changed))
        seed = recorded.truth.seed
        seen = photographing.photographed(
            calibrated(recorded.episode, seed, posed=faults.posed), faults, seed
        )
        return cls(recorded, seen, named, seed)

    def scene(self, quality: str, folder: Path) -> Scene:
        """What models of a quality make of the photographs."""
        views = {name: self.recorded.episode.views[name] for name in self.seen.views}
        truth = replace(self.recorded.episode, views=views)
        spoilt = scripted.outlines(truth, self.named, scripted.QUALITIES[quality], self.seed)
        path = folder / f"{len(list(folder.iterdir()))}.json"
        path.write_text(json.dumps(spoilt))
        depth = ScriptedDepth(self.seen, truth, quality, self.seed)
        models = Asked(Models(text=f"outlines:{path}"), tuple(self.named), scripted=depth)
        return find(self.seen, sources(tuple, models)).scene()


def asked(
    case: FactorCase, factor: str, scene: Scene, recorded: twin.Take, true: twin.Take, folder: Path
) -> tuple[dict[str, Any], Any]:
    """The fields that ask for the true change without anything that only the truth knows; and the edit where no draw of
    theirs is the true one."""
    ask = case.ask(recorded, true, folder)[-1]
    fields = {k: v for k, v in ask.steps[0].items() if k not in ("target", "albedo")}
    if "origin" in fields:
        x, y, z = fields["origin"]
        fields["origin"] = [x, y, z - TABLE]
    image_shownas(factor, fields, photographing.drawn(recorded.truth.seed))
    if factor in WORDS:
        named = {"text": rgb_only.NAMED}
        fields |= {"targets": [named]} if factor == "spread" else {"target": named}
    if factor in photographed_truths.MOVED:
        return fields, photographed_truths.placed(factor, photographed_truths.motion(recorded))
    if factor != "distractor":
        return fields, ask.edit
    assert ask.edit is not None
    things = ask.edit["things"]
    fresh = instance_ids.free(scene, len(things))
    moved = [
        thing | {"handle": new, "pose": lowered(np.array(thing["pose"])).tolist()}
        for thing, new in zip(things, fresh, strict=True)
    ]
    return fields, {"things": moved, **insert.light(scene)}


def image_shownas(factor: str, fields: dict[str, Any], faults: photographing.CameraFaults) -> None:
    """Colors as this camera shows them: what is asked for exactly is meant as it will look. Images are not, since what
    is laid under the recorded light takes its hue and exposure."""
    gain = np.array(faults.gain)
    if "color" in fields:
        fields["color"] = {"rgb": (gain * fields["color"]["rgb"]).tolist()}
    if factor == "table_color":
        fields["range"] = (gain * np.array(fields["range"])).tolist()


def rows(
    seed: int,
    qualities: Sequence[str],
    look: twin.Look,
    factors: Sequence[str],
    folder: Path,
    crf: int | None = None,
    posed: bool = False,
) -> Iterator[Row]:
    """The edits of one seed, by all qualities; with `crf` the cameras film, with `posed` their places are known."""
    faults = photographing.drawn(seed, crf, posed)
    task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
    takes: dict[Any, twin.Take] = {}
    scenes: dict[Any, tuple[Scene, float]] = {}
    for factor in factors:
        case = MEASURED[factor]
        if case.lamps not in takes:
            lit = replace(look, lamps=case.lamps)
            takes[case.lamps] = twin.perform(task, seed, look=lit, frames=FRAMES, size=SIZE)
        recorded = takes[case.lamps]
        true = changed(case, factor, recorded)
        words = frozenset(true.truth.changed if factor in WORDS else ())
        for quality in qualities:
            key = case.lamps, words, quality
            if key not in scenes:
                start = time.process_time()
                made = Shot.of(recorded, words, faults).scene(quality, folder)
                scenes[key] = made, time.process_time() - start
            yield row(*scenes[key], case, factor, recorded, true, quality, folder, faults)


def row(
    scene: Scene,
    spent: float,
    case: FactorCase,
    factor: str,
    recorded: twin.Take,
    true: twin.Take,
    quality: str,
    folder: Path,
    faults: photographing.CameraFaults,
) -> Row:
    """One edit, held against the truth."""
    refused, start, figures = "", time.process_time(), (NOTHING,) * 9
    try:
        fields, edit = asked(case, factor, scene, recorded, true, folder)
        copy = made(scene, case.operator, fields, edit)
        for view in copy.episode.views.values():
            for t in range(copy.episode.length):
                view.rgb(t)
        spent += time.process_time() - start
        figures = scored(scene, copy, recorded, true, factor, faults)
    except RpaugError as refusal:
        refused = str(refusal)
    error, told = depth_error(scene, recorded)
    truth = recorded.truth
    return Row(quality, factor, truth.seed, truth.task, *figures, error, told, spent, refused)


def depth_error(scene: Scene, recorded: twin.Take) -> tuple[float, float]:
    """How far the depth of things on the table is off, metres, median over things; and what was said of it, at most."""
    handles = recorded.truth.handles.items()
    things = [h for n, h in handles if not n.startswith(rgb_only.ROOM)]
    off, told = [], []
    for name, view in scene.episode.views.items():
        true = recorded.episode.views[name]
        told.append(view.proxy.spread if view.proxy else 0.0)
        for t in range(0, scene.episode.length, 4) if view.depth else ():
            ids = true.ids(t)  # type: ignore[misc]
            masks = [mask for one in things if (mask := ids == one).sum() >= rgb_only.SEEN]
            apart = view.depth(t) - true.depth(t)  # type: ignore[misc]
            off += [np.median(apart[mask]) for mask in masks]
    return (float(np.median(np.abs(off))) if off else NOTHING), float(np.max(told))


def scored(
    scene: Scene,
    copy: Any,
    recorded: twin.Take,
    true: twin.Take,
    factor: str,
    faults: photographing.CameraFaults,
) -> tuple[float, ...]:
    """dB inside, the recording's own, the share of pixels changed outside; IoU, depth and grain of what was put in; dB
    of the truth as taken, and of true colors within the masks."""
    seed = recorded.truth.seed
    goal = photographing.photographed(true.episode, faults, seed, noisy=False)
    was = photographing.photographed(recorded.episode, faults, seed, noisy=False)
    taken = photographing.photographed(true.episode, faults, seed)
    colors = registry.operator(MEASURED[factor].operator).effect == Effect.RGB
    painted = [one.instance_ids for one in copy.scene.appearance if one.instance_ids and colors]
    edited = sorted(frozenset().union(*painted))
    squares: list[list[np.ndarray]] = [[], [], [], []]
    outside, count = 0, 0
    masks, off = [0, 0], []
    shown: dict[tuple[str, int], Bool[np.ndarray, "h w"]] = {}
    for name, view in scene.episode.views.items():
        if factor == "camera_pose" and name not in true.truth.bumps:
            continue
        for t in range(scene.episode.length):
            image, now = view.rgb(t), copy.episode.views[name].rgb(t)
            wanted, old = goal.views[name].rgb(t), was.views[name].rgb(t)
            inside = reached(true, factor, name, t, wanted, old)
            judged = inside.copy()
            if factor in SEEN:
                judged &= ~copy.tally.holes.get(f"{name}/{t}", np.zeros_like(inside))
            assert view.ids is not None
            within = np.where(np.isin(view.ids(t), edited)[..., None], wanted, image)
            for part, image_shown in zip(
                squares, (now, image, taken.views[name].rgb(t), within), strict=True
            ):
                part.append(((image_shown[judged].astype(float) - wanted[judged]) ** 2).mean(-1))
            outside += int(((now != image).any(-1) & ~inside).sum())
            count += int((~inside).sum())
            if factor == "distractor":
                shown[name, t] = put_in(scene, copy.scene, true, name, t, masks, off)
    db, unedited, noisy, within_masks = (
        psnr(float(np.concatenate(part).mean())) for part in squares
    )
    iou = masks[0] / max(masks[1], 1) if factor == "distractor" else NOTHING
    depth = float(np.median(np.concatenate(off))) if off else NOTHING
    ratios = grain(copy, taken, shown) if shown else (NOTHING, NOTHING)
    share = outside / max(count, 1)
    return db, unedited, share, iou, depth, *ratios, noisy, within_masks if edited else NOTHING


def grain(
    copy: Any,
    taken: Episode,
    shown: Mapping[tuple[str, int], Bool[np.ndarray, "h w"]],
) -> tuple[float, float]:
    """How noisy what was put in is over time, by the truth as taken; and the same from pixel to pixel."""
    sums = np.zeros((2, 2))
    for (name, t), mask in shown.items():
        if (name, t + 1) not in shown:
            continue
        inside = cv2.erode((mask & shown[name, t + 1]).astype(np.uint8), np.ones((3, 3))) > 0
        for k, episode in enumerate((copy.episode, taken)):
            one, other = (episode.views[name].rgb(when).astype(np.float32) for when in (t, t + 1))
            sums[0, k] += ((one - other)[inside] ** 2).sum()
            sums[1, k] += (cv2.Laplacian(one - other, cv2.CV_32F)[inside] ** 2).sum()
    whole, fine = (
        np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1e-9)) if sums.all() else (NOTHING,) * 2
    )
    return float(whole), float(fine)


def reached(
    true: twin.Take, factor: str, name: str, t: int, wanted: np.ndarray, old: np.ndarray
) -> Bool[np.ndarray, "h w"]:
    """Pixels that truly changed."""
    if factor == "camera_pose":
        return np.ones(wanted.shape[:2], bool)
    ids = true.episode.views[name].ids
    assert ids is not None
    differs = (np.abs(wanted.astype(int) - old) > DIFFERS).any(-1)
    return np.isin(ids(t), true.truth.changed) | differs


def put_in(
    scene: Scene,
    after: Scene,
    true: twin.Take,
    name: str,
    t: int,
    masks: list[int],
    off: list[np.ndarray],
) -> Bool[np.ndarray, "h w"]:
    """Adds the overlap of what was put in with what truly stands there, and how far off its depth is; returns it."""
    view, goal = scene.episode.views[name], true.episode.views[name]
    assert view.depth is not None
    assert view.ids is not None
    assert goal.depth is not None
    assert goal.ids is not None
    base = view.rgb(t), view.depth(t), view.ids(t)
    _, depth, ids = inserted.draw(after, after.cameras[name], t, base)
    new = [h for body in inserted.bodies(after) for h in body.instance_ids]
    mine, truly = np.isin(ids, new), np.isin(goal.ids(t), true.truth.changed)
    masks[0] += int((mine & truly).sum())
    masks[1] += int((mine | truly).sum())
    off.append(np.abs(depth - goal.depth(t))[mine & truly])
    return mine & truly


def main() -> None:
    """The figures, edit by edit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--quality", choices=scripted.QUALITIES, action="append")
    parser.add_argument(
        "--factor", choices=tuple(MEASURED), action="append", help="only these edits"
    )
    parser.add_argument("--shadows", action="store_true", help="lamps cast shadows")
    parser.add_argument("--crf", type=int, help="the cameras film: H.264 of this quality")
    parser.add_argument("--posed", action="store_true", help="cameras stand where they are said to")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    look = twin.Look(antialias=True, shadows=given.shadows)
    chosen = given.quality or ["high", "middle", "low"], look, given.factor or list(MEASURED)
    found = list[Row]()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.seeds):
            for one in rows(seed, *chosen, Path(folder), given.crf, given.posed):
                found.append(one)
                sys.stderr.write(f"{vars(one)}\n")
    if given.json:
        json.dump([vars(row) for row in found], sys.stdout, indent=1)
        return
    report(found)


def report(found: list[Row]) -> None:
    """A line an edit and quality: how many were made, and the means of what was measured of those."""
    names = (
        "db",
        "unedited",
        "outside",
        "iou",
        "depth",
        "grain",
        "fine",
        "taken",
        "masked",
        "error",
        "told",
        "seconds",
    )
    sys.stdout.write(f"{'edit':28}{'made':>10}" + "".join(f"{name:>10}" for name in names) + "\n")
    for factor, quality in dict.fromkeys((row.factor, row.quality) for row in found):
        mine = [row for row in found if (row.factor, row.quality) == (factor, quality)]
        kept = [row for row in mine if not row.refused]
        means = [
            np.mean([getattr(row, name) for row in kept]) if kept else NOTHING for name in names
        ]
        line = "".join(f"{mean:10.3f}" for mean in means)
        name = f"{factor}, {quality}"
        sys.stdout.write(f"{name:28}{f'{len(kept)} of {len(mine)}':>10}{line}\n")
        for reason in dict.fromkeys(row.refused for row in mine if row.refused):
            sys.stdout.write(f"  refused: {reason}\n")


if __name__ == "__main__":
    main()
