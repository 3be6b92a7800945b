"""What color images alone are enough for: the twin's recordings with depth, masks and calibration hidden.

    python -m tools.bench.rgb_only [--seeds 4] [--first 0] [--size 128] [--frames 17] [--factor F] [--models Q]
        [--cost] [--json]

Of each seed's recording only the fixed cameras' colors are kept. Edits made from those are held against the truly
changed recording: dB inside the truly changed pixels and outside them, beside the unedited images'. `IoU` is that of
the mask an edit went by with the true one; `handle` asks for the thing's handle that fits best, `words` for the
color's name, `role` for what is manipulated. `things` is the mean over all true things beside the robot, each by its
best handle over all cameras, and `thing in a camera` by its best handle there; nothing is edited. `--uncut` leaves
GrabCut out. `--models` asks models of that quality (`tools.bench.scripted`) for everything on the table by its part's
name, and the changed thing is named by words.
Textures lie in another place than the true ones, since cameras are assumed: dB are of their mean color in each image.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from pydantic import TypeAdapter

from rpaug import Camera, CameraView, twin
from rpaug.core import color_space, registry
from rpaug.core.errors import RpaugError
from rpaug.core.metrics import psnr
from rpaug.core.types import Episode, Scene
from rpaug.pipeline import copies, inputs, prepare
from rpaug.pipeline.contracts import shown
from rpaug.providers.models_settings import Models
from rpaug.scene.build import build, find, sources
from rpaug.scene.instances import outlines
from rpaug.scene.instances.by_models import AskedModels
from rpaug.scene.recorded import surfels
from rpaug.scene.targets import targets
from tools.bench import scripted

FACTORS = (
    "object_color", "table_color", "background_texture", "light_color", "object_texture", "table_texture",
)  # fmt: skip
TEXTURED = {  # what its row is called, the role that is painted (none: the changed thing), and the operator
    "background_texture": ("background", "background", "background_texture"),
    "table_texture": ("table's texture", "table", "table_texture"),
    "object_texture": ("object's texture", None, "retexture"),
}
SEEN = 12  # pixels a frame: of a thing that a camera shows less of nothing is asked there
HANDLES = 200
TOLD = 0.05  # overlap up to which a thing was not told apart at all
ROOM = (
    "link",
    "hand",
    "finger",
    "table",
    "floor",
    "wall",
)  # what these parts' names begin with is no thing
NAMED = "gadget"  # what the changed thing is called
FOCAL = 1.2  # longest sides, as adapters assume


def bare(episode: Episode) -> Episode:
    """The fixed cameras' colors, and nothing else."""

    def stripped(view: CameraView) -> CameraView:
        w, h = view.camera.width, view.camera.height
        focal = FOCAL * max(w, h)
        K = np.array([[focal, 0, (w - 1) / 2], [0, focal, (h - 1) / 2], [0, 0, 1]])
        still = np.tile(np.eye(4), (episode.length, 1, 1))
        return CameraView(Camera(K, still, w, h, assumed=True), view.rgb)

    views = {name: stripped(v) for name, v in episode.views.items() if v.camera.fixed}
    return replace(episode, views=views)


@dataclass(frozen=True)
class Row:
    """One edit of one seed."""

    edit: str
    seed: int
    task: str
    iou: float
    inside: float  # dB
    unedited: float  # dB inside, of the recording itself
    outside: float  # dB
    seconds: float


def overlap(scene: Scene, true: twin.Take, ours: frozenset[int], theirs: set[int]) -> float:
    """Intersection over union of two sets of handles, all cameras and frames pooled."""
    both = either = 0
    for name, view in scene.episode.views.items():
        for t in range(scene.episode.length):
            a = np.isin(view.ids(t), list(ours))  # type: ignore[misc]
            b = np.isin(true.episode.views[name].ids(t), list(theirs))  # type: ignore[misc]
            both, either = both + int((a & b).sum()), either + int((a | b).sum())
    return both / max(either, 1)


def best(scene: Scene, true: twin.Take, theirs: set[int]) -> frozenset[int]:
    """The found thing that fits the true ones best; none where nothing of them was told from robot, table or room."""
    room = frozenset().union(*(scene.roles.get(r, ()) for r in ("robot", "table", "background")))
    each = {h: overlap(scene, true, frozenset([h]), theirs) for h in set(scene.instance_ids) - room}
    fits = {h: iou for h, iou in each.items() if iou > TOLD}
    return frozenset([max(fits, key=lambda h: fits[h])]) if fits else frozenset()


def errors(
    scene: Scene, edited: Episode, recorded: twin.Take, true: twin.Take, mean: bool
) -> tuple[float, float, float]:
    """dB inside the truly changed pixels, the recording's own, and dB outside."""
    ours, theirs, before = [], [], []
    out, kept = [], []
    for name in scene.episode.views:
        view, view_true = recorded.episode.views[name], true.episode.views[name]
        for t in range(scene.episode.length):
            a, b, c = edited.views[name].rgb(t), view_true.rgb(t), view.rgb(t)
            inside: Bool[np.ndarray, "h w"] = np.isin(view_true.ids(t), true.truth.changed)  # type: ignore[misc]
            if true.truth.factor == "light_color":
                inside = np.ones(inside.shape, bool)
            if mean and inside.any():
                ours.append(a[inside].mean(0)[None])
                theirs.append(b[inside].mean(0)[None])
                before.append(c[inside].mean(0)[None])
            elif inside.any():
                ours.append(a[inside])
                theirs.append(b[inside])
                before.append(c[inside])
            out.append(a[~inside])
            kept.append(b[~inside])
    wanted = np.concatenate(theirs)
    outside = _db(np.concatenate(out), np.concatenate(kept)) if sum(map(len, out)) else np.nan
    return _db(np.concatenate(ours), wanted), _db(np.concatenate(before), wanted), outside


def _db(one: np.ndarray, other: np.ndarray) -> float:
    return psnr(float(((one.astype(float) - other) ** 2).mean()))


def asked(
    scene: Scene,
    factor: str,
    recorded: twin.Take,
    true: twin.Take,
    folder: Path,
    words: str | None = None,
) -> Iterator[tuple[str, frozenset[int] | None, str, dict[str, Any]]]:
    """The edits that imitate a factor: a name, the handles it goes by, operator and fields."""
    changed = true.truth.changed
    if factor == "light_color":
        new = true.truth.light[1]
        yield "light", None, "light_color", {"range": (new, new)}
    elif factor == "table_color":
        new = true.truth.albedos[changed[0]]
        yield "table", scene.roles.get("table"), "table_color", {"range": (new, new)}
    elif factor in TEXTURED:
        laid = next(iter(true.truth.covers.values()))
        (folder / laid.file).write_bytes(true.side()[laid.file])
        fields = {"textures": str(folder), "texture": laid.file, "scale": laid.cover.side}
        name, role, op = TEXTURED[factor]
        instance_ids = scene.roles.get(role) if role else best(scene, recorded, set(changed))
        target = {} if role else {"target": {"handle": sorted(instance_ids or ())}}
        yield name, instance_ids, op, fields | target
    else:
        fields = {"color": {"rgb": true.truth.albedos[changed[0]]}}
        instance_ids = best(scene, recorded, set(changed))
        target: dict[str, Any] = {"handle": sorted(instance_ids)}
        yield (
            "object by handle" if instance_ids else "object not told apart",
            instance_ids,
            "recolor",
            fields | {"target": target},
        )
        if manipulated := scene.roles.get("manipulated"):
            target = {"handle": sorted(manipulated)}
            yield "object by role", manipulated, "recolor", fields | {"target": target}
        word = color_space.nearest(np.array(recorded.truth.albedos[changed[0]]))
        target = {"text": words or f"the {word} thing"}
        try:
            instance_ids = targets.find(scene, targets.Target(**target))
        except RpaugError:
            yield "object by words refused", frozenset(), "recolor", {}
            return
        yield "object by words", instance_ids, "recolor", fields | {"target": target}


def things(scene: Scene, true: twin.Take) -> tuple[float, float]:
    """Mean overlap of the true things with their best handles: over all cameras, and camera by camera."""
    parts = {h for name, h in true.truth.handles.items() if not name.startswith(ROOM)}
    both: dict[int, list[np.ndarray]] = {}
    for name, view in scene.episode.views.items():
        ours = np.stack([view.ids(t) for t in range(scene.episode.length)])  # type: ignore[misc]
        views = true.episode.views
        theirs = np.stack([views[name].ids(t) for t in range(scene.episode.length)])  # type: ignore[misc]
        for part in parts:
            mask = theirs == part
            if mask.sum() < SEEN * scene.episode.length:
                continue
            found = {h: (ours == h) for h in np.unique(ours[mask]).tolist()}
            counts = np.zeros((HANDLES, 3))
            for row, instance_id in enumerate(sorted(scene.instance_ids)):
                held = found.get(instance_id)
                counts[row] = (
                    mask.sum(),
                    (ours == instance_id).sum(),
                    (held & mask).sum() if held is not None else 0,
                )
            both.setdefault(part, []).append(counts)
    every = [_best(np.sum(rows, 0)) for rows in both.values()]
    each = [_best(counts) for rows in both.values() for counts in rows]
    return float(np.mean(every)), float(np.mean(each))


def _best(counts: np.ndarray) -> float:
    mask, held, common = counts.T
    return float((common / np.maximum(mask + held - common, 1)).max())


def found(
    recorded: twin.Take, true: twin.Take, quality: str | None, seed: int, folder: Path
) -> Scene:
    """The bare recording's scene, by colors alone or with outlines of what stands on the table."""
    episode = bare(recorded.episode)
    if quality is None:
        return build(episode, with_bodies=True)
    alone = true.truth.factor in ("object_color", "object_texture")
    changed = set(true.truth.changed) if alone else set[int]()
    parts = [
        h for n, h in recorded.truth.handles.items() if not n.startswith(ROOM) and h not in changed
    ]
    named = {
        f"thing{'abcdefghijklmnopqrstuvwxyz'[k]}": [h] for k, h in enumerate(sorted(parts)[:26])
    }
    named |= {NAMED: sorted(changed)} if changed else {}
    drawn = replace(recorded.episode, views={n: recorded.episode.views[n] for n in episode.views})
    path = folder / f"{seed}-{true.truth.factor}-{quality}.json"
    path.write_text(json.dumps(scripted.outlines(drawn, named, scripted.QUALITIES[quality], seed)))
    known = AskedModels(Models(text=f"outlines:{path}"), tuple(named))
    return find(episode, sources(tuple, known)).scene()


def rows(
    seed: int,
    size: int,
    frames: int,
    folder: Path,
    factors: Sequence[str] = FACTORS,
    quality: str | None = None,
) -> Iterator[Row]:
    """The edits of one seed that imitate these factors; with models of a `quality`."""
    task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
    recorded = twin.perform(task, seed, frames=frames, size=size)
    for factor in factors:
        true = twin.perform(
            task, seed, factor=factor, look=recorded.truth.new, size=size, frames=frames
        )
        start = time.process_time()
        scene = found(recorded, true, quality, seed, folder)
        built = time.process_time() - start
        if factor == FACTORS[0]:
            for name, iou in zip(
                ("things", "thing in a camera"), things(scene, recorded), strict=True
            ):
                yield Row(name, seed, task, iou, np.nan, np.nan, np.nan, built)
        words = NAMED if quality else None
        for name, instance_ids, op, fields in asked(scene, factor, recorded, true, folder, words):
            if instance_ids is not None and not instance_ids:
                yield Row(name, seed, task, 0.0, np.nan, np.nan, np.nan, built)
                continue
            start = time.process_time()
            operator = TypeAdapter(registry.operator(op)).validate_python(fields)
            try:
                edit = operator.sample(scene, np.random.default_rng(seed))
            except RpaugError:
                yield Row(f"{name} refused", seed, task, np.nan, np.nan, np.nan, np.nan, built)
                continue
            edited = shown(operator.apply(scene, edit))
            inside, unedited, outside = errors(scene, edited, recorded, true, factor in TEXTURED)
            iou = (
                overlap(scene, recorded, instance_ids, set(true.truth.changed))
                if instance_ids
                else np.nan
            )
            spent = built + time.process_time() - start
            yield Row(name, seed, task, iou, inside, unedited, outside, spent)


def cost(size: int, frames: int, further: int = 3) -> tuple[float, float]:
    """Processor seconds of the first copy of one camera's episode, and the median of further ones, by the shipped
    recipe `robust`: reading and writing files is not among them."""
    take = twin.perform("pick_block", 1, frames=frames, size=size)
    episode = bare(take.episode)
    name = next(iter(episode.views))
    episode = replace(episode, views={name: episode.views[name]})
    asked_for = inputs.recipe("robust", models=["off"])
    start, spent = time.process_time(), []
    scene, plan = prepare.prepare_scene(episode, asked_for, 0)
    prepare.ground(scene, asked_for)
    prepared = copies.PreparedEpisode(
        scene, plan, asked_for, cache(partial(surfels.recorded, scene))
    )
    for number in range(further + 1):
        made = copies.draw_copy(prepared, number + 1)
        for t in range(frames):
            made.episode.views[name].rgb(t)
        spent.append(time.process_time() - start)
        start = time.process_time()
    return spent[0], float(np.median(spent[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="the first of the seeds")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--frames", type=int, default=17)
    parser.add_argument("--factor", choices=FACTORS, action="append", help="only these edits")
    parser.add_argument("--cost", action="store_true", help="only what a copy costs")
    parser.add_argument("--models", choices=scripted.QUALITIES)
    parser.add_argument("--uncut", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.cost:
        first, further = cost(given.size, given.frames)
        sys.stdout.write(f"first copy {first:.1f}, each further one {further:.1f} processor s\n")
        return
    if given.uncut:
        outlines.cut = lambda image, ids, only=None: ids
    with tempfile.TemporaryDirectory() as folder:
        measured = [
            row
            for seed in range(given.first, given.first + given.seeds)
            for row in rows(
                seed,
                given.size,
                given.frames,
                Path(folder),
                given.factor or FACTORS,
                given.models,
            )
        ]
    if given.json:
        json.dump([vars(row) for row in measured], sys.stdout, indent=1)
        return
    head = f"{'edit':18}{'seeds':>6}{'IoU':>7}{'inside, dB':>12}{'unedited':>10}{'outside, dB':>13}{'CPU s':>7}"
    sys.stdout.write(head + "\n")
    for name in dict.fromkeys(row.edit for row in measured):
        mine = [row for row in measured if row.edit == name]

        def mean(part: str, mine: list[Row] = mine) -> float:
            values = np.array([getattr(row, part) for row in mine])
            return float(values[~np.isnan(values)].mean()) if (~np.isnan(values)).any() else np.nan

        sys.stdout.write(
            f"{name:18}{len(mine):6d}{mean('iou'):7.2f}{mean('inside'):12.1f}{mean('unedited'):10.1f}"
            f"{mean('outside'):13.1f}{mean('seconds'):7.1f}\n"
        )


if __name__ == "__main__":
    main()
