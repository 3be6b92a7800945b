"""Every shipped recipe on every foreign task: copies kept, rejected and refused with the reasons, and sheets for eyes.

    python -m tools.bench.foreign.run --data data --out run [--held] [--recipe robust] [--each 2] [--arms recorded]

The first episode of each task, whole; a few of its frames are rendered and judged. With --each, a task gets one copy by
`robust` and that many other recipes, in turn over tasks and recipes in the order of the SHA-256 of their names. OUT
gets `<half>.json`, which keeps what was run, and `<half>/<task>/<recipe>-<copy>.png`: three cameras by the first,
middle and last frame, four times as large. With --arms, rpaug is given the robots' files, which the neutral folders
name.
"""

import argparse
import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rpaug_recipes

from rpaug.core import registry
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.types import Episode
from rpaug.physics import materials
from rpaug.pipeline import copies, prepare
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.recorded.surfels import recorded
from tools.bench.foreign import convert, neutral
from tools.bench.foreign.edits import tell
from tools.bench.harness import pages

FRAMES = 4  # of an episode that are rendered to be judged, evenly spread
COPIES = {"robust": 4}  # of a recipe; one of the others
ASIDE = {"stylize": "needs a network's weights"}
SHOWN = ("front", "left_shoulder", "overhead")
LARGER = 4


def recipes() -> Iterator[tuple[str, Path]]:
    """The shipped recipes by name, `robust` first."""
    root = Path(rpaug_recipes.__file__).parent
    found = {
        path.relative_to(root).with_suffix("").as_posix(): path
        for path in sorted(root.rglob("*.yaml"))
        if path.name != materials.FILE and "tasks" not in path.parts
    }
    yield "robust", found.pop("robust")
    yield from ((name, path) for name, path in found.items() if name not in ASIDE)


def asked(tasks: Sequence[str], each: int | None) -> dict[str, list[tuple[str, int]]]:
    """Recipes and the number of their copy by task: all, or one of `robust` and `each` others."""
    names = [name for name, _ in recipes()]
    if each is None:
        every = [(name, k) for name in names for k in range(1, COPIES.get(name, 1) + 1)]
        return dict.fromkeys(tasks, every)
    others = sorted(names[1:], key=_digest)
    return {
        task: [
            (names[0], 1 + n % COPIES[names[0]]),
            *((others[(each * n + k) % len(others)], 1) for k in range(each)),
        ]
        for n, task in enumerate(sorted(tasks, key=_digest))
    }


def _digest(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()


def arms(recorded: Path, task: str, half: str) -> tuple[Path, ...]:
    """The robot's file, as the first recorded episode of a task names it; none where it has none."""
    folder = convert.finished(recorded / half / task)[0]
    model = neutral.facts(folder)["model"]
    return (folder / model,) if model else ()


def one(
    episode: Episode, recipe: Path, copy: int, picture: Path, files: tuple[Path, ...] = ()
) -> dict[str, Any]:
    """What became of one copy: `kept`, `rejected` or `refused` with the reason, and the edits that were left out."""
    try:
        asked = replace(Recipe.from_yaml(recipe), arms=files)
        scene, plan = prepare.prepare_scene(episode, asked, 0)
        prepare.ground(scene, asked)
        prepared = copies.PreparedEpisode(scene, plan, asked, cache(partial(recorded, scene)))
        made = copies.draw_copy(prepared, copy, judged)
    except RpaugError as error:
        return {"became": "refused", "why": str(error)}
    if made.faults:
        return {"became": "rejected", "why": "; ".join(made.faults)}
    views, last = made.episode.views, episode.length - 1
    frames = 0, last // 2, last
    tiles = [[views[name].rgb(t) for t in frames] for name in SHOWN if name in views]
    image = np.concatenate([np.concatenate(row, 1) for row in tiles], 0)
    picture.parent.mkdir(parents=True, exist_ok=True)
    size = image.shape[1] * LARGER, image.shape[0] * LARGER
    picture.write_bytes(encode_png(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST)))
    told = [draw.describe() for draw in made.draws]
    left = {str(draw["op"]): draw["left_out"] for draw in told if draw.get("left_out")}
    return {
        "became": "kept",
        "left_out": left,
        "edits": [draw["op"] for draw in told if draw.get("edit")],
    }


def judged(made: copies.Made) -> Sequence[str]:
    """The faults that a few frames show, evenly spread, beside those that the gates look for in frames of their own."""
    if made.gates is None:
        return ()
    for view in made.episode.views.values():
        for t in np.linspace(0, made.episode.length - 1, FRAMES).round().astype(int).tolist():
            view.rgb(t)
    return made.judged()


def rows(kept: Mapping[str, Mapping[str, Any]], half: str) -> list[list[pages.Cell]]:
    """By recipe: copies, share kept, those that lost an edit, and the most frequent reason of what was not kept.

    Recipes of which every copy was kept whole have no row but in the last one.
    """
    out: list[list[pages.Cell]] = []
    names = ["robust", *(name for name, _ in recipes() if name != "robust"), "all"]
    for name in names:
        those = [one for place, one in kept.items() if name in (place.split("|")[1], "all")]
        if not those:
            continue
        became = Counter(str(one["became"]) for one in those)
        why = Counter(one["why"] for one in those if one["became"] != "kept")
        share = round(100 * became["kept"] / len(those), 1)
        figure: pages.Cell = {"value": share, "target": ">= 95"} if name == "all" else share
        lost = sum(bool(one.get("left_out")) for one in those)
        if became["kept"] == len(those) and not lost and name not in ("robust", "all"):
            continue
        most = why.most_common(1)[0][0][:90] if why else "-"
        out.append(
            [
                f"{half}: {name}",
                len(those),
                figure,
                became["rejected"],
                became["refused"],
                lost,
                most,
            ]
        )
    return out


def reasons(kept: Mapping[str, Mapping[str, Any]], half: str) -> list[list[pages.Cell]]:
    """Why copies were not made and edits left out of them, most frequent first: what, how often, the reason."""
    found = Counter[tuple[str, str]]()
    for one in kept.values():
        if one["became"] != "kept":
            found[str(one["became"]), str(one["why"])] += 1
        found.update((f"left out: {op}", str(why)) for op, why in one.get("left_out", {}).items())
    return [[f"{half}: {what}", count, why[:150]] for (what, why), count in found.most_common()]


COLUMNS = (
    "recipe",
    "copies",
    "kept, %",
    "rejected",
    "refused",
    "an edit left out",
    "most frequent reason",
)


def main() -> None:
    """Run what was not run yet, and print or record the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of worked/ and held/")
    parser.add_argument("--held", action="store_true", help="the set-aside tasks instead")
    parser.add_argument("--task", action="append", help="only these, as <world>.<task>")
    parser.add_argument("--recipe", action="append", help="only these")
    parser.add_argument("--each", type=int, help="other recipes than robust a task, in turn")
    parser.add_argument(
        "--arms", type=Path, metavar="RECORDED", help="give rpaug the robots' files"
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    half = "held" if given.held else "worked"
    given.out.mkdir(parents=True, exist_ok=True)
    file = given.out / f"{half}.json"
    kept = json.loads(file.read_text()) if file.exists() else {}
    paths, roots = dict(recipes()), sorted((given.data / half).iterdir())
    chosen = asked([root.name for root in roots], given.each)
    for root in roots:
        if given.task and root.name not in given.task:
            continue
        episode = None
        for name, copy in chosen[root.name]:
            place = f"{root.name}|{name}|{copy}"
            if place in kept or (given.recipe and name not in given.recipe):
                continue
            episode = episode or registry.read(root, None)
            picture = given.out / half / root.name / f"{name.replace('/', '-')}-{copy}.png"
            files = arms(given.arms, root.name, half) if given.arms else ()
            kept[place] = one(episode, paths[name], copy, picture, files)
            write_atomic(file, json.dumps(kept, indent=1).encode())
            print(place, kept[place], flush=True)
    tasks = {place.split("|")[0] for place in kept}
    each = "" if given.each is None else f" --each {given.each}"
    each += "".join(f" --recipe {name}" for name in given.recipe or ())
    each += " --arms RECORDED" * bool(given.arms)
    origin = {
        "seeds": f"{len(tasks)} tasks, one episode each",
        "command": f"python -m tools.bench.foreign.run --data DATA{' --held' * given.held}{each}",
    }
    by_file = bool(given.arms)
    tell(
        "foreign_recipes", rows(kept, half), given.record, id=f"recipes-{half}{'-arms' * by_file}",
        columns=COLUMNS, title=f"Shipped recipes, {half}{', arm by its file' * by_file}", **origin,
    )  # fmt: skip
    tell(
        "foreign_recipes", reasons(kept, half), given.record and not by_file, id=f"reasons-{half}",
        columns=("what", "copies", "reason"), title=f"What was not made, {half}", **origin,
    )  # fmt: skip


if __name__ == "__main__":
    main()
