"""Edits of things that a foreign task leaves alone, against the same states truly rendered with them edited.

    python -m tools.bench.foreign.furnished --recorded recorded --python foreign/bin/python --out furnished [--task T]

In these worlds hardly anything stands that the robot leaves alone. So the simulator records each task's states once
more with two things of rpaug's library on the table, where `distractors` puts them, as one body each; rpaug is told
nothing of them. What it draws by its defaults is then rendered by the simulator too, and scored in the changed region
as `tools.bench.foreign.edits` does. Of an inserted thing the recording is the one without the two. OUT keeps what was
scored.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from rpaug import twin
from rpaug.assets import library
from rpaug.core import registry
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.interfaces import Edit
from rpaug.core.types import Episode
from rpaug.operators.distractors import Distractors
from rpaug.pipeline import plan
from rpaug.scene import build
from rpaug.twin.look import Look
from tools.bench.foreign import convert, edits, neutral
from tools.bench.harness import edits as measured
from tools.bench.harness import pages
from tools.bench.harness.cases import Ask, FactorCase
from tools.bench.harness.scores import measure

FRAMES, EVERY = 16, 5  # of an episode, evenly spread; and which of them are scored
RPAUG, NONE = "rpaug", "no edit"


@dataclass(frozen=True, eq=False)
class Thing:
    """An asset that stands there, `scale` times its own size about the middle of its foot."""

    asset: str
    handle: int
    pose: np.ndarray  # (4, 4)
    scale: float = 1.0

    @classmethod
    def of(cls, thing: Edit) -> "Thing":
        return cls(thing["asset"], thing["handle"], np.array(thing["pose"]), thing["scale"])

    def at(self, motion: Any, handle: int | None = None) -> "Thing":
        """The same put elsewhere; with an instance id, one more of it."""
        handle = self.handle if handle is None else handle
        return replace(self, pose=np.array(motion) @ self.pose, handle=handle)

    def extra(self, pictures: Path) -> dict[str, Any]:
        """As the simulators' environment takes it."""
        mesh = library.mesh(self.asset)
        foot = np.array([0, 0, mesh.points[:, 2].min()])
        picture = pictures / f"{self.asset}.png"
        picture.write_bytes(encode_png(mesh.image))
        return {
            "points": (foot + self.scale * (mesh.points - foot)).tolist(),
            "normals": mesh.normals.tolist(), "uv": mesh.uv.tolist(), "faces": mesh.faces.tolist(),
            "pose": self.pose.tolist(), "id": self.handle, "image": str(picture.resolve()),
        }  # fmt: skip


Things = tuple[Thing, ...]


Fields = Mapping[str, Any]


@dataclass(frozen=True)
class Kind:
    """An edit of the first thing, or of all: the operator's fields, and what then truly stands there."""

    fields: Callable[[Things], Fields]
    true: Callable[[Things, Edit], Things]
    bare: bool = False  # of the recording without the things
    light: Mapping[str, Any] = field(default_factory=dict)  # what else the simulator changes


def _first(things: Things) -> Fields:
    return {"target": {"handle": things[0].handle}}


def _all(things: Things) -> Fields:
    return {"targets": [{"handle": one.handle} for one in things]}


def _inserted(things: Things, edit: Edit) -> Things:
    return tuple(map(Thing.of, edit["things"]))


def _resized(things: Things, edit: Edit) -> Things:
    return replace(things[0], scale=edit["scale"]), *things[1:]


def _moved(things: Things, edit: Edit) -> Things:
    return things[0].at(edit["motion"]), *things[1:]


def _copied(things: Things, edit: Edit) -> Things:
    return *things, *(
        things[0].at(one["motion"], *one["handles"].values()) for one in edit["copies"]
    )


def _spread(things: Things, edit: Edit) -> Things:
    motions = {one: move["motion"] for move in edit["moves"] for one in move["handles"]}
    return tuple(one.at(motions[one.handle]) if one.handle in motions else one for one in things)


KINDS: Mapping[str, Kind] = {
    "insert": Kind(lambda things: {}, _inserted, bare=True),
    "object_size": Kind(_first, _resized),
    "remove": Kind(_first, lambda things, edit: things[1:]),
    "move": Kind(_first, _moved),
    "duplicate": Kind(_first, _copied),
    "spread": Kind(_all, _spread),
    "shadows": Kind(
        lambda things: {"depth": (0.0, 0.0)},
        lambda things, edit: (),
        bare=True,
        light={"shadows": False},
    ),
}


class Furnished:
    """A foreign episode with two things more, and the edits of them."""

    def __init__(self, folder: Path, out: Path, python: Path) -> None:
        self.folder, self.out, self.python = folder, out, python
        self.trial = edits.Trial(folder, convert.read(folder), out)
        last = self.trial.whole.length - 1
        self.frames = np.unique(np.linspace(0, last, FRAMES).round().astype(int)).tolist()
        self.scored = list(range(0, len(self.frames), EVERY))

    @cached_property
    def bare(self) -> Episode:
        """The recording without the things."""
        return edits.thinned(self.trial.whole, self.frames)

    @cached_property
    def things(self) -> Things:
        """What `distractors` puts there. Raises RpaugError where it finds no place."""
        scene = build.build(self.bare, with_bodies=True)
        drawn = Distractors().sample(scene, np.random.default_rng(self.trial.facts["seed"]))
        return tuple(map(Thing.of, drawn["things"]))

    @cached_property
    def recorded(self) -> Episode:
        """The recording with them."""
        return self._rendered("recorded", self.frames, {"things": self.things}, self.bare)["things"]

    def drawn(self, name: str) -> Edit:
        """What an operator draws of its defaults. Raises RpaugError where it refuses."""
        scene = build.build(self.source(name), with_bodies=True)
        operator = TypeAdapter(registry.operator(name)).validate_python(self.fields(name))
        plan.check(operator, scene)
        return operator.sample(scene, np.random.default_rng(self.trial.facts["seed"]))

    def source(self, name: str) -> Episode:
        """The recording that an edit is made of."""
        return self.bare if KINDS[name].bare else self.recorded

    def fields(self, name: str) -> dict[str, Any]:
        """What an operator is asked."""
        return dict(KINDS[name].fields(self.things))

    def light(self, name: str) -> Mapping[str, Any]:
        """What of the light the simulator changes."""
        return KINDS[name].light if name in KINDS else {}

    def true(self, edits_drawn: Mapping[str, Edit]) -> dict[str, Episode]:
        """What truly comes of each edit, at the frames that are scored."""
        standing = {name: KINDS[name].true(self.things, edit) for name, edit in edits_drawn.items()}
        frames = [self.frames[k] for k in self.scored]
        return self._rendered("true", frames, standing, edits.thinned(self.bare, self.scored))

    def _rendered(
        self, name: str, frames: list[int], standing: Mapping[str, Things], like: Episode
    ) -> dict[str, Episode]:
        out = self.out / name
        out.mkdir(parents=True, exist_ok=True)
        changes = {
            kind: {"extras": [one.extra(out) for one in things], **self.light(kind)}
            for kind, things in standing.items()
        }
        edits.render(self.folder, out, self.python, frames, changes)
        facts = edits.robot(like), self.trial.facts["instruction"], like.key
        return {
            kind: convert.episode(edits.films(out / f"{kind}.npz"), *facts) for kind in standing
        }

    def take(self, episode: Episode, changed: Things = ()) -> twin.Take:
        """An episode, and which things are not as they were recorded."""
        self.trial.targets[""] = tuple(one.handle for one in changed)
        return self.trial.take(episode, Look())

    def figures(self, name: str, edit: Edit, true: Episode) -> dict[str, Any]:
        """Those of one edit, and of none."""
        before = edits.thinned(self.source(name), self.scored)
        here = () if KINDS[name].bare else self.things
        changed = tuple(one for one in KINDS[name].true(self.things, edit) if one not in here)
        recorded, goal = self.take(before), self.take(true, changed)
        case, ask = FactorCase(name, lambda *_: ()), Ask(RPAUG, (self.fields(name),), edit)
        made, holes = measured.edited(
            self.source(name), case, ask, 0, lambda one: edits.thinned(one, self.scored)
        )
        unseen = {
            f"{view}/{k}": holes[f"{view}/{t}"]
            for view in made.views
            for k, t in enumerate(self.scored)
            if f"{view}/{t}" in holes
        }
        images = [one.views["front"].rgb(1) for one in (before, true, made)]
        (self.out / f"{name}.png").write_bytes(encode_png(np.concatenate(images, 1)))
        return {
            RPAUG: vars(measure(recorded, made, goal, unseen, True, 0.0)),
            NONE: vars(measure(recorded, before, goal, {}, True, 0.0)),
        }


def scored(
    folder: Path, out: Path, python: Path, kept: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Figures by world, task and edit of what is not kept yet."""
    facts = neutral.facts(folder)
    place = f"{facts['world']}|{facts['task']}"
    one, drawn = Furnished(folder, out, python), dict[str, Edit]()
    for name in KINDS:
        if f"{place}|{name}" in kept:
            continue
        try:
            drawn[name] = one.drawn(name)
        except RpaugError as error:
            yield f"{place}|{name}", {edits.REFUSED: str(error)}
    true = one.true(drawn) if drawn else {}
    for name, edit in drawn.items():
        try:
            yield f"{place}|{name}", one.figures(name, edit, true[name])
        except RpaugError as error:
            yield f"{place}|{name}", {edits.REFUSED: str(error)}


COLUMNS = (
    "edit", "tasks", "refused", "dB", "95 % interval", "worst task", "no better than no edit", "no edit, dB",
    "unseen, %", "mask IoU",
)  # fmt: skip


def rows(kept: Mapping[str, Mapping[str, Any]]) -> list[list[pages.Cell]]:
    """By edit, as COLUMNS names them; medians over the tasks that were not refused, intervals by bootstrap."""
    out: list[list[pages.Cell]] = []
    for name in KINDS:
        asked = [one for place, one in kept.items() if place.endswith(f"|{name}")]
        those = [one for one in asked if edits.REFUSED not in one]
        if not those:
            out.append([name, 0, len(asked), *["-"] * (len(COLUMNS) - 3)])
            continue
        values = np.array([one[RPAUG]["psnr"] for one in those])
        worse = sum(one[RPAUG]["psnr"] <= one[NONE]["psnr"] for one in those)
        out.append(
            [
                name,
                len(those),
                len(asked) - len(those),
                round(float(np.median(values)), 1),
                edits.interval(values),
                round(float(values.min()), 1),
                worse,
                edits.median(those, NONE, "psnr"),
                round(100 * float(np.mean([one[RPAUG]["holes"] for one in those])), 1),
                round(float(np.median([one[RPAUG]["iou"] for one in those])), 3),
            ]
        )
    return out


def main() -> None:
    """Score what is not scored yet, and print or record the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recorded", type=Path, required=True)
    parser.add_argument("--python", type=Path, required=True, help="of the simulators' environment")
    parser.add_argument("--task", nargs="+", help="only these, as <world>.<task>")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    file = given.out / "furnished.json"
    kept = json.loads(file.read_text()) if file.exists() else {}
    for task in sorted((given.recorded / "worked").iterdir()):
        if given.task and task.name not in given.task:
            continue
        for folder in convert.finished(task)[:1]:
            for place, figures in scored(folder, given.out / task.name, given.python, kept):
                kept[place] = figures
                write_atomic(file, json.dumps(kept, indent=1).encode())
                said = {k: round(v["psnr"], 1) for k, v in figures.items() if k in (RPAUG, NONE)}
                print(place, said or figures, flush=True)
    places = {place.rpartition("|")[0] for place in kept}
    tasks = " ".join(["", "--task", *given.task]) if given.task else ""
    edits.tell(
        "foreign_edits", rows(kept), given.record, id="furnished", columns=COLUMNS,
        title="Things put there by the simulator, then edited",
        seeds=f"{len(places)} tasks, an episode each, {FRAMES} frames",
        command="python -m tools.bench.foreign.furnished --recorded recorded --python foreign/bin/python "
        f"--out furnished{tasks}",
    )  # fmt: skip


if __name__ == "__main__":
    main()
