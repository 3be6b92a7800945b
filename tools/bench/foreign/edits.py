"""rpaug's edits of foreign recordings against the same states truly rendered again, by factor and world.

    python -m tools.bench.foreign.edits --recorded recorded --python foreign/bin/python --out edits [--held]

One episode a task, compared at a few frames; rpaug sees them all. Each factor is drawn from the task's name as on the
twin, rendered by the simulator (`tools.bench.foreign.changed`, run by --python), asked of rpaug as `tools.bench.edits`
asks it, and scored alike. What was scored is kept in OUT and not scored again. The twin's own
figures are those of its page. Moved cameras have a bench of their own.
"""

import argparse
import json
import subprocess
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from rpaug import twin
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.types import Episode
from rpaug.twin.factors import FACTORS
from rpaug.twin.look import Look
from rpaug.twin.truth import Laid
from tools.bench.foreign import convert, neutral
from tools.bench.harness import edits as measured
from tools.bench.harness import pages
from tools.bench.harness.cases import CASES, ESTIMATED, TOLD, drawn_things
from tools.bench.harness.scores import measure

FRAMES = 3  # of an episode, evenly spread
FACTORS_ASKED = (
    "object_color", "object_texture", "light_color", "light_direction", "table_color", "table_texture",
    "background_texture", "distractor",
)  # fmt: skip
LAMP = (twin.TwinLamp(0.4, 0.9),)  # the only one, where its direction changes
OLD_LIGHT = 0.5  # as the twin's lamps are recorded
DIMMED = 0.5  # of the light, to see which pixels follow it
UNASKED = ("light_direction", "distractor")  # factors that take no recorded surface's light apart
ROUNDED = 4  # levels by which twice the dimmed pixel may differ
REFUSED = "refused"
Changes = dict[str, dict[str, Any]]


class Trial:
    """A foreign episode, and what is changed in it: looks in the twin's words, changes in the simulator's."""

    def __init__(self, folder: Path, whole: Episode, out: Path) -> None:
        self.out, self.facts, self.whole = out, neutral.facts(folder), whole
        last = whole.length - 1
        self.frames = np.unique(np.linspace(0, last, FRAMES).round().astype(int)).tolist()
        self.episode = thinned(self.whole, self.frames)
        self.looks: dict[str, Look] = {}
        self.targets: dict[str, tuple[int, ...]] = {}
        out.mkdir(parents=True, exist_ok=True)

    def changes(self) -> Changes:
        """What the simulator shall render, by name."""
        found: Changes = {
            "lamp": {"lamp": _towards(LAMP[0])},
            "dimmed": {"light": [DIMMED] * 3},
        }
        for factor in FACTORS_ASKED:
            if targets := self._targets(factor):
                found[factor] = self._change(factor, targets)
        return found

    def _targets(self, factor: str) -> tuple[int, ...]:
        """The instance ids that a factor changes; none where the episode lacks them."""
        roles = {role: tuple(told["must"]) for role, told in self.facts["roles"].items()}
        role = {"object": "manipulated", "table": "table", "background": "background"}.get(
            factor.split("_")[0]
        )
        everything = tuple(self.facts["ids"].values())
        self.targets[factor] = everything if role is None else roles[role]
        return self.targets[factor]

    def _change(self, factor: str, targets: tuple[int, ...]) -> dict[str, Any]:
        rng = np.random.default_rng(zlib.crc32(f"{self.facts['task']} {factor}".encode()))
        names = tuple(map(str, targets))
        start = Look(lamps=LAMP) if factor == "light_direction" else Look()
        value = drawn_things(self.take(self.episode, Look())) if factor == "distractor" else None
        look = self.looks[factor] = FACTORS[factor].change(start, names, value, rng)
        if factor.endswith("color") and factor != "light_color":
            self.targets[factor] = targets[:1]  # of several that are moved together, one
            return {"colors": [{"id": targets[0], "rgb": look.tints[names[0]]}]}
        if factor.endswith("texture"):
            cover = look.covers[names[0]]
            image = self._picture(factor, cover.image)
            return {"covers": [{"ids": targets, "image": image, "side": cover.side}]}
        if factor == "light_color":
            return {"light": (np.array(look.light) / OLD_LIGHT).tolist()}
        if factor == "light_direction":
            return {"lamp": _towards(look.lamps[0])}
        self.targets[factor] = tuple(extra.handle for extra in look.extras)
        return {"extras": [self._extra(extra) for extra in look.extras]}

    def _extra(self, extra: Any) -> dict[str, Any]:
        flat = {
            name: getattr(extra, name).tolist()
            for name in ("points", "normals", "uv", "faces", "pose")
        }
        return flat | {"id": extra.handle, "image": self._picture(extra.name, extra.image)}

    def _picture(self, name: str, image: np.ndarray) -> str:
        file = self.out / f"{name}.png"
        file.write_bytes(encode_png(image))
        return str(file.resolve())

    def take(
        self, episode: Episode, look: Look, factor: str = "", albedos: Any = None
    ) -> twin.Take:
        """An episode with its truth as the twin tells it."""
        names = {str(one): one for one in self.facts["ids"].values()}
        where = tuple(tuple(row) for row in np.eye(4).tolist())
        covers = {
            int(name): Laid(
                cover=cover, file=f"truth-{cover.kind}-{cover.seed}.png", body_to_world=where
            )
            for name, cover in look.covers.items()
        }
        truth = twin.Truth(
            task=self.facts["task"], seed=self.facts["seed"], episode=0, variation=0, manipulated="", handles=names,
            bodies={}, key_frames=(), factor=factor or None, tints={}, albedos=albedos or {},
            old=Look(lamps=look.lamps), new=look, changed=self.targets.get(factor, ()), covers=covers,
        )  # fmt: skip
        return twin.Take(episode, truth, {})

    def pair(self, factor: str) -> tuple[twin.Take, twin.Take]:
        """What was recorded, and what truly came of the change."""
        albedos = json.loads((self.out / "albedos.json").read_text())[factor]
        old, new = ({int(one): tuple(both[k]) for one, both in albedos.items()} for k in (0, 1))
        first = self.film("lamp") if factor == "light_direction" else self.episode
        look = Look(lamps=LAMP) if factor == "light_direction" else Look()
        recorded = self.take(first, look, factor, old)
        true = self.take(self.film(factor), self.looks[factor], factor, new)
        return recorded, replace(true, truth=replace(true.truth, old=recorded.truth.new))

    def film(self, name: str) -> Episode:
        """A render of the simulator's as an episode."""
        found = films(self.out / f"{name}.npz")
        facts = robot(self.episode), self.facts["instruction"], self.episode.key
        return convert.episode(found, *facts)

    def overlit(self) -> Mapping[str, Bool[np.ndarray, "h w"]]:
        """Pixels that do not follow the lamps, by camera/frame: lit beyond white, above or below their picture.

        What such a surface looks like in another color or light is in no pixel of the recording.
        """
        dimmed = self.film("dimmed")
        out = {}
        for name, view in self.episode.views.items():
            assert view.ids is not None
            for t in range(self.episode.length):
                lost = dimmed.views[name].rgb(t) / DIMMED - view.rgb(t) > ROUNDED
                out[f"{name}/{t}"] = lost.any(-1) & (view.ids(t) > 0)
        return out


def films(file: Path) -> dict[str, dict[str, np.ndarray]]:
    """A render of the simulator's, by camera."""
    found: dict[str, dict[str, np.ndarray]] = {}
    with np.load(file) as kept:
        for key in kept.files:
            camera, what = key.split("/")
            found.setdefault(camera, {})[what] = kept[key]
    return found


def robot(episode: Episode) -> dict[str, Any]:
    """What the robot of an episode did, as `convert.episode` takes it."""
    names = "joint_positions", "gripper_to_world", "gripper_open"
    return {name: getattr(episode.robot, name) for name in names}


def thinned(episode: Episode, frames: list[int]) -> Episode:
    """The episode at `frames` alone."""

    def at(image: Callable[[int], Any] | None) -> Callable[[int], Any] | None:
        return None if image is None else lambda t: image(frames[t])

    views = {
        name: replace(
            view, rgb=at(view.rgb), depth=at(view.depth), ids=at(view.ids),
            camera=replace(view.camera, cam_to_world=view.camera.cam_to_world[frames]),
        )
        for name, view in episode.views.items()
    }  # fmt: skip
    robot = episode.robot
    assert robot.gripper_to_world is not None
    assert robot.gripper_open is not None
    robot = replace(
        robot, joint_positions=robot.joint_positions[frames], joint_velocities=robot.joint_velocities[frames],
        gripper_to_world=robot.gripper_to_world[frames], gripper_open=robot.gripper_open[frames],
    )  # fmt: skip
    return replace(episode, views=views, robot=robot, length=len(frames))


def _towards(lamp: twin.TwinLamp) -> list[float]:
    flat = np.cos(lamp.height)
    return [
        float(flat * np.cos(lamp.heading)),
        float(flat * np.sin(lamp.heading)),
        float(np.sin(lamp.height)),
    ]


def render(
    folder: Path, out: Path, python: Path, frames: Sequence[int], changes: Mapping[str, Any]
) -> None:
    """Have the simulators' environment render these changes of an episode into `out`, unless they are there."""
    out.mkdir(parents=True, exist_ok=True)
    asked = json.dumps({"frames": [*frames], "changes": changes})
    file, done = out / "changes.json", out / "albedos.json"
    if done.exists() and file.read_text() == asked:
        return
    done.unlink(missing_ok=True)  # the simulators' environment writes it last
    file.write_text(asked)
    command = [
        python,
        "-W",
        "ignore",
        "-m",
        "tools.bench.foreign.changed",
        "--recorded",
        folder.resolve(),
    ]
    command += ["--changes", file.resolve(), "--out", out.resolve()]
    subprocess.run([str(word) for word in command], check=True)


def scored(
    folder: Path, out: Path, python: Path, kept: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Figures by world, task, factor and method of what is not kept yet."""
    facts = neutral.facts(folder)
    place = f"{facts['world']}|{facts['task']}"
    yield from figures(place, folder, Trial(folder, convert.read(folder), out), python, kept)


def figures(
    place: str, folder: Path, trial: Trial, python: Path, kept: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Figures of one episode's factors and methods that are not kept yet, by `place` and factor."""
    changes = trial.changes()
    if all(f"{place}|{factor}" in kept for factor in trial.looks):
        return
    render(folder, trial.out, python, trial.frames, changes)
    for factor in trial.looks:
        if f"{place}|{factor}" not in kept:
            try:
                yield f"{place}|{factor}", _figures(trial, factor)
            except RpaugError as error:
                yield f"{place}|{factor}", {REFUSED: str(error)}


def _figures(trial: Trial, factor: str) -> dict[str, Any]:
    recorded, true = trial.pair(factor)
    case, found = CASES[factor], {}
    apart = {} if factor in UNASKED else trial.overlit()
    whole = factor != "light_direction"  # of that lamp's light only some frames are rendered
    seen = replace(recorded, episode=trial.whole) if whole else recorded
    frames = trial.frames if whole else list(range(recorded.episode.length))
    asks = {ask.method: ask for ask in case.ask(seen, true, trial.out)}
    for method, ask in asks.items():
        edited, holes = measured.edited(
            seen.episode, case, ask, 0, lambda made: thinned(made, frames)
        )
        untold = dict(apart)
        for name in edited.views:
            for k, t in enumerate(frames):
                if f"{name}/{t}" in holes:
                    untold[f"{name}/{k}"] = holes[f"{name}/{t}"] | untold.get(f"{name}/{k}", False)
        found[method] = vars(measure(recorded, edited, true, untold, True, 0.0))
        reels = {
            name: np.stack([view.rgb(t) for t in range(edited.length)])
            for name, view in edited.views.items()
        }
        np.savez_compressed(trial.out / f"{factor}-{method.replace(', ', '-')}-rpaug.npz", **reels)
    found["no edit"] = vars(measure(recorded, recorded.episode, true, apart, True, 0.0))
    return found


def twins() -> dict[str, float]:
    """The given figure of each factor on the twin where it is least: under highlights, or under cast shadows."""
    kinds = (("highlights", "highlights"), ("lights", "shadows"), ("lights", "others"))
    found = dict[str, float]()
    for topic, name in kinds:
        (table,) = (one for one in pages.load(topic).tables if one.id == name)
        for row in table.rows:
            factor, given = str(row[0]), pages.plain(row[table.columns.index("given")])
            if given != "-":
                found[factor] = min(float(given), found.get(factor, float(given)))
    return found


def rows(
    kept: Mapping[str, Mapping[str, Any]], half: str, twins: Mapping[str, float]
) -> list[list[pages.Cell]]:
    """By factor, as COLUMNS names them; medians over the tasks that were not refused, intervals by bootstrap."""
    out: list[list[pages.Cell]] = []
    for factor in FACTORS_ASKED:
        asked = [one for place, one in kept.items() if place.endswith(f"|{factor}")]
        those = [one for one in asked if REFUSED not in one]
        if not those:
            continue
        given = np.array([one[TOLD]["psnr"] for one in those])
        middle, twin_psnr = round(float(np.median(given)), 1), twins.get(factor)
        short: pages.Cell = "-"
        if twin_psnr is not None:
            short = {"value": round(twin_psnr - middle, 1), "target": "<= 3"}
        holes = [one[TOLD]["holes"] for one in those]
        out.append(
            [
                f"{half}: {factor}",
                len(those),
                len(asked) - len(those),
                middle,
                interval(given),
                round(float(given.min()), 1),
                sum(one[TOLD]["psnr"] <= one["no edit"]["psnr"] for one in those),
                "-" if twin_psnr is None else round(twin_psnr, 1),
                short,
                median(those, TOLD, "psnr_seen"),
                round(100 * float(np.mean(holes)), 1),
                median(those, ESTIMATED, "psnr"),
                median(those, "no edit", "psnr"),
                {"value": int(max(one[TOLD]["outside"] for one in those)), "target": "<= 0"},
            ]
        )
    return out


def median(those: Sequence[Mapping[str, Any]], method: str, figure: str) -> float | str:
    values = [one[method][figure] for one in those if method in one]
    values = [value for value in values if np.isfinite(value)]
    return round(float(np.median(values)), 1) if values else "-"


def interval(values: np.ndarray) -> str:
    """95 % of the median, tasks drawn anew."""
    drawn = np.random.default_rng(0).choice(values, (2000, len(values)))
    low, high = np.percentile(np.median(drawn, axis=1), [2.5, 97.5])
    return f"{low:.1f} to {high:.1f}"


COLUMNS = (
    "factor", "tasks", "refused", "given, dB", "95 % interval", "worst task", "no better than no edit", "the twin, dB",
    "short of it, dB", "where the recording tells, dB", "elsewhere, %", "estimated, dB", "no edit, dB",
    "pixels changed outside, worst",
)  # fmt: skip


def main() -> None:
    """Score what is not scored yet, and print or record the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recorded", type=Path, required=True)
    parser.add_argument("--python", type=Path, required=True, help="of the simulators' environment")
    parser.add_argument("--held", action="store_true", help="the set-aside tasks instead")
    parser.add_argument("--task", nargs="+", help="only these, as <world>.<task>")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    half = "held" if given.held else "worked"
    file = given.out / f"{half}.json"
    given.out.mkdir(parents=True, exist_ok=True)
    kept = json.loads(file.read_text()) if file.exists() else {}
    for task in sorted((given.recorded / half).iterdir()):
        if given.task and task.name not in given.task:
            continue
        for folder in convert.finished(task)[:1]:
            for place, figures in scored(folder, given.out / half / task.name, given.python, kept):
                kept[place] = figures
                write_atomic(file, json.dumps(kept, indent=1).encode())
                if REFUSED in figures:
                    print(place, figures, flush=True)
                    continue
                said = {method: round(one["psnr"], 1) for method, one in figures.items()}
                print(place, said, "outside", figures[TOLD]["outside"], flush=True)
    tasks = " ".join(["", "--task", *given.task]) if given.task else ""
    places = {place.rpartition("|")[0] for place in kept}
    command = (
        "tools.bench.foreign.edits --recorded recorded --python foreign/bin/python --out edits"
    )
    tell(
        "foreign_edits", rows(kept, half, twins()), given.record, id=f"edits-{half}", columns=COLUMNS,
        title=f"Edits against the truth, {half}", seeds=f"{len(places)} tasks, an episode each, {FRAMES} frames",
        command=f"python -m {command}{' --held' * given.held}{tasks}",
    )  # fmt: skip


def tell(topic: str, rows: list[list[pages.Cell]], record: bool, **table: Any) -> None:
    """Print rows, and keep them as a table of a topic's page if they are to be recorded."""
    for row in rows:
        print("  ".join(pages.shown(cell) for cell in row))
    if record:
        pages.record(topic, pages.Table(rows=rows, **table, **pages.stamp()))


if __name__ == "__main__":
    main()
