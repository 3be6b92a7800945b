"""Moved cameras against the simulators' true renders, on foreign worlds and on the twin.

    python -m tools.bench.foreign.cameras --recorded recorded --python foreign/bin/python --out cameras


Three moves: up to 0.1 m and 0.05 rad an axis, and 0.2 m and 15 degrees, of the front and shoulder cameras, and 2 cm
and 0.02 rad of the wrist's. The pipeline makes a copy of the whole episode; pairs of its frames are compared, and
judged by the default gates. A pixel is co-visible if some recorded camera saw its point then, or at another time if it
is static.
"""

import argparse
import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from rpaug import twin
from rpaug.core import geometry
from rpaug.core.files import write_atomic
from rpaug.core.metrics import decibels
from rpaug.core.types import Episode
from rpaug.pipeline import copies, prepare
from rpaug.pipeline.left_out import covisible
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.recorded import surfels
from rpaug.twin.look import Bump
from tools.bench.foreign import convert, edits, neutral
from tools.bench.foreign.scoring import DRAWS
from tools.bench.harness import pages

MOVED = ("front", "left_shoulder", "right_shoulder")
WITHIN, BEYOND, WRIST = "0.1 m, 0.05 rad", "0.2 m, 15 degrees", "wrist, 2 cm"
STARTS = (0.1, 0.5, 0.9)  # of an episode: where a pair of frames is compared
Bumps = dict[str, Bump]


def bumps(task: str, others: Sequence[str] = MOVED, wrist: str = "wrist") -> dict[str, Bumps]:
    """Each camera's motion in its own frame, by move."""
    rng = np.random.default_rng(zlib.crc32(task.encode()))

    def bump(turn: np.ndarray, shift: np.ndarray) -> Bump:
        turned, by = turn.tolist(), shift.tolist()
        return Bump(turn=(turned[0], turned[1], turned[2]), shift=(by[0], by[1], by[2]))

    def within(shift: float, turn: float) -> Bump:
        return bump(rng.uniform(-turn, turn, 3), rng.uniform(-shift, shift, 3))

    def exactly(shift: float, turn: float) -> Bump:
        by, axis = rng.normal(size=(2, 3))
        by, axis = by / np.linalg.norm(by), axis / np.linalg.norm(axis)
        return bump(turn * axis, shift * by)

    return {
        WITHIN: {name: within(0.1, 0.05) for name in others},
        BEYOND: {name: exactly(0.2, np.deg2rad(15)) for name in others},
        WRIST: {wrist: exactly(0.02, 0.02)},
    }


def frames(length: int) -> list[int]:
    """Pairs of neighbouring frames."""
    return [t + k for t in (round(start * (length - 2)) for start in STARTS) for k in (0, 1)]


def shown(
    folder: Path, episode: Episode, moves: Mapping[str, Bumps], out: Path, python: Path
) -> dict[str, Episode]:
    """By move what the simulator of a foreign episode shows at `frames`."""
    at = frames(episode.length)
    changes = {
        move: {
            "bumps": {
                name: geometry.rigid(np.array(one.turn), np.array(one.shift)).tolist()
                for name, one in moved.items()
            }
        }
        for move, moved in moves.items()
    }
    edits.render(folder, out, python, at, changes)
    robot = edits.robot(edits.thinned(episode, at))
    films = {move: edits.films(out / f"{move}.npz") for move in moves}
    return {
        move: convert.episode(film, robot, episode.key, episode.key) for move, film in films.items()
    }


def recorded_truth(
    folder: Path, out: Path, python: Path
) -> tuple[Episode, dict[str, Episode], dict[str, Bumps]]:
    """A foreign episode, and by move what its simulator shows at `frames`."""
    episode, moves = convert.read(folder), bumps(neutral.facts(folder)["task"])
    return episode, shown(folder, episode, moves, out, python), moves


def twin_truth(task: str, seed: int) -> tuple[Episode, dict[str, Episode], dict[str, Bumps]]:
    """An episode of the twin, and by move what it shows at `frames`."""
    moves = bumps(f"{task} {seed}")
    episode = twin.perform(task, seed).episode
    true = {
        move: twin.perform(task, seed, factor="camera_pose", value=moved).episode
        for move, moved in moves.items()
    }
    at = frames(episode.length)
    return episode, {move: edits.thinned(one, at) for move, one in true.items()}, moves


def figures(
    episode: Episode,
    true: Mapping[str, Episode],
    moves: Mapping[str, Bumps],
    arms: Sequence[Path] = (),
) -> dict[str, dict[str, Any]]:
    """By move: squared errors and pixels (all, co-visible, holes), flicker in levels, the gates' figures and faults."""
    edit = {"op": "camera_pose", "camera": [name for moved in moves.values() for name in moved]}
    recipe = Recipe.from_dict(
        {"version": 1, "edits": [edit], "gates": {}, "arms": [*map(str, arms)]}
    )
    prepared = copies.PreparedEpisode(*prepare.prepare_scene(episode, recipe, 0), recipe)
    static = surfels.recorded(prepared.scene).static
    found = {}
    for move, moved in moves.items():
        drawn = {
            name: {"turn": list(one.turn), "shift": list(one.shift)} for name, one in moved.items()
        }
        draw = {"step": 0, "op": "camera_pose", "fields": {"camera": list(moved)}, "edit": drawn}
        copy = copies.draw_copy(prepared, 1, known=copies.Known(draws=[draw]))
        totals, flicker = np.zeros((3, 2)), []
        for name in moved:
            view, truly = copy.episode.views[name], true[move].views[name]
            offs = []
            for k, t in enumerate(frames(episode.length)):
                offs.append(view.rgb(t).astype(np.float64) - truly.rgb(k))
                square = (offs[k] ** 2).mean(-1) / 255**2
                now = edits.thinned(replace(true[move], views={name: truly}), [k] * episode.length)
                seen = covisible(prepared.scene, static, now.views[name], t)
                hole = copy.tally.holes[f"{name}/{t}"]
                totals += [(square[at].sum(), at.sum()) for at in (seen | True, seen, hole)]
                if k % 2 and truly.camera.fixed:
                    same = truly.ids(k) == truly.ids(k - 1)
                    flicker.append(np.abs(offs[k] - offs[k - 1])[same].mean())
        found[move] = {
            "totals": totals.tolist(),
            "flicker": float(np.mean(flicker)) if flicker else None,
            "faults": list(copy.judged()),
            "gates": copy.figures.describe(),
        }
    return found


def rows(kept: Mapping[str, Mapping[str, Any]], half: str) -> list[list[pages.Cell]]:
    """By move: tasks, co-visible and all dB with intervals over tasks, holes, flicker, copies rejected."""
    out: list[list[pages.Cell]] = []
    for move in (WITHIN, BEYOND, WRIST):

        def aimed(value: float, target: str, asked: str, move: str = move) -> pages.Cell:
            return {"value": value, "target": target} if move == asked else value

        those = [one[move] for one in kept.values()]
        totals = np.array([one["totals"] for one in those])
        (_, count), _, (hole, holes) = totals.sum(0)
        flicker = [one["flicker"] for one in those if one["flicker"] is not None]
        (every, all_range), (seen, seen_range) = (_ranged(totals[:, k]) for k in (0, 1))
        rejected = round(100 * float(np.mean([bool(one["faults"]) for one in those])))
        out.append(
            [
                f"{half}: {move}", len(those),
                aimed(seen, ">= 28", WITHIN), seen_range, aimed(every, ">= 26", WITHIN), all_range,
                round(decibels(hole / holes), 1),
                round(100 * float(holes / count), 1),
                round(float(np.mean(flicker)), 2) if flicker else "-",
                aimed(rejected, ">= 100", BEYOND),
            ]
        )  # fmt: skip
    return out


def _ranged(totals: Float64[np.ndarray, "tasks 2"]) -> tuple[float, str]:
    """dB of squared errors over pixels, and its 95 % interval: tasks are drawn anew."""
    drawn = np.random.default_rng(0).integers(len(totals), size=(DRAWS, len(totals)))
    sums = np.concatenate([totals.sum(0)[None], totals[drawn].sum(1)])
    found = [decibels(value) for value in sums[:, 0] / sums[:, 1]]
    low, high = np.percentile(found[1:], [2.5, 97.5])
    return round(found[0], 1), f"{low:.1f} to {high:.1f}"


COLUMNS = (
    "move", "tasks", "co-visible, dB", "co-visible, 95 %", "all, dB", "all, 95 %", "holes, dB", "holes, %",
    "flicker, levels", "rejected, %",
)  # fmt: skip


def main() -> None:
    """Score what is not scored yet, and print or record the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recorded", type=Path, help="neutral folders")
    parser.add_argument("--python", type=Path, help="of the simulators' environment")
    parser.add_argument("--held", action="store_true", help="the set-aside tasks instead")
    parser.add_argument(
        "--twin", type=int, default=0, metavar="SEEDS", help="the twin's tasks instead"
    )
    parser.add_argument("--arm", action="store_true", help="give rpaug the robot's file")
    parser.add_argument("--task", action="append", help="only these, as <world>.<task>")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    half = "twin" if given.twin else "held" if given.held else "worked"
    title = f"{half}, arm by its file" if given.arm else half
    file = given.out / f"{title}.json"
    given.out.mkdir(parents=True, exist_ok=True)
    kept = json.loads(file.read_text()) if file.exists() else {}
    for name, model, truth in _trials(given, half):
        if name not in kept and (not given.task or name in given.task):
            kept[name] = figures(*truth(), arms=[model] if given.arm and model else [])
            write_atomic(file, json.dumps(kept, indent=1).encode())
            print(name, rows({name: kept[name]}, title), flush=True)
    table = rows(kept, title)
    for row in table:
        print("  ".join(pages.shown(cell) for cell in row))
    if given.record:
        asked = {"twin": f"--twin {given.twin}", "held": "--recorded RECORDED --held"}
        pages.record(
            "cameras",
            pages.Table(
                id=half + "-arm" * given.arm, title=f"Moved cameras, {title}", columns=COLUMNS, rows=table,
                seeds=f"{len(kept)} episodes, {len(frames(60))} frames of each camera",
                command=f"python -m tools.bench.foreign.cameras {asked.get(half, '--recorded RECORDED')}"
                + " --arm" * given.arm
                + "".join(f" --task {name}" for name in given.task or ()),
                **pages.stamp(),
            ),
        )  # fmt: skip


def _trials(
    given: argparse.Namespace, half: str
) -> Iterator[
    tuple[str, Path | None, Callable[[], tuple[Episode, dict[str, Episode], dict[str, Bumps]]]]
]:
    """Names, the robots' files, and what makes recordings and their truth."""
    if given.twin:
        for seed in range(given.twin):
            for task in twin.TASKS:
                yield f"{task} {seed}", None, partial(twin_truth, task, seed)
        return
    for task in sorted((given.recorded / half).iterdir()):
        for folder in convert.finished(task)[:1]:
            out = given.out / half / task.name
            model = folder / neutral.facts(folder)["model"]
            yield task.name, model, partial(recorded_truth, folder, out, given.python)


if __name__ == "__main__":
    main()
