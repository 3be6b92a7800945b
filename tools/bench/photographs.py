"""What recordings of color images alone are edited into: contact sheets to be judged by eye, one half of the episodes.

    python -m tools.bench.photographs --data data --out sheets [--held | --drawn FILE] [--command recolor ...]

Every command of COMMANDS makes one copy of each episode; OUT gets `<half>/<command>/<key>.png`, a pair of rows for each
camera that shows anything: recorded above edited at the first, middle and last frame, four times as large; and
`<half>.json`, what became of each and how much of every camera changed. `{noun}` in a command is each noun of the
episode's instruction in turn; the colored ones are asked of every episode, most of which show no such thing. `--drawn`
takes the episodes that a file of outlines (`docs/models.md`) has, with it for a model; that of ten Bridge records was
drawn by hand and is `tools/bench/bridge_outlines.json`. Judgments by eye stand in docs/benchmarks/rgb_only.md by
command and key.
"""

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import rpaug
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.types import Episode
from rpaug.pipeline import copies, prepare, recipe
from rpaug.scene.recorded.surfels import recorded
from rpaug.scene.targets.instruction import mentions

HALVES = ("worked", "held")
LARGER = 4
SHEET = 256  # pixels of a shown image's height at least
COLORED = (
    ("green", "plate"),
    ("orange", "carrot"),
    ("blue", "cup"),
    ("yellow", "knife"),
    ("purple", "eggplant"),
)
COMMANDS: Mapping[str, dict[str, Any]] = {
    "recolor the {noun}": {"op": "recolor", "target": {"text": "the {noun}"}, "color": "blue"},
    **{
        f"recolor the {words}": {
            "op": "recolor",
            "target": {"text": f"the {words}"},
            "color": "red",
        }
        for color, noun in COLORED
        for words in (f"{color} thing", f"{color} {noun}")
    },
    "recolor manipulated": {
        "op": "recolor",
        "target": {"role": "manipulated"},
        "color": {"sample": "colosseum"},
    },
    "retexture the {noun}": {"op": "retexture", "target": {"text": "the {noun}"}},
    "table_color": {"op": "table_color"},
    "table_texture": {"op": "table_texture"},
    "background_texture": {"op": "background_texture"},
    "light_color": {"op": "light_color"},
}


def half(key: str, keys: Sequence[str]) -> str:
    """The half an episode belongs to: every second one in the order of the SHA-256 of their keys is set aside."""
    order = sorted(keys, key=lambda one: hashlib.sha256(one.encode()).hexdigest())
    return HALVES[order.index(key) % 2]


def commands(
    episode: Episode, only: Sequence[str] = ()
) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """What is asked of an episode: a name and the recipe's edits."""
    nouns = dict.fromkeys(one.noun for text in episode.descriptions for one in mentions(text))
    for command, edit in COMMANDS.items():
        if only and not any(command.startswith(one) for one in only):
            continue
        for noun in nouns if "{noun}" in command else [""]:
            yield command.format(noun=noun), [json.loads(json.dumps(edit).replace("{noun}", noun))]


def one(
    episode: Episode, edits: Sequence[Mapping[str, Any]], drawn: Path | None = None
) -> tuple[dict[str, Any], np.ndarray | None]:
    """What became of one copy, `written` or `refused` with the reason, and its sheet; with `drawn` outlines if any."""
    models = {"text": f"outlines:{drawn}"} if drawn else {}
    start = time.process_time()
    try:
        asked = recipe.build({"version": 1, "seed": 1, "models": models, "edits": list(edits)})
        scene, plan = prepare.prepare_scene(episode, asked, 0)
        missing = prepare.ground(scene, asked)
        prepared = copies.PreparedEpisode(scene, plan, asked, cache(partial(recorded, scene)))
        made = copies.draw_copy(prepared, 1)
        shares, tiles = {}, []
        for name, view in episode.views.items():
            if np.ptp(view.rgb(0)) < 8:
                continue  # a black dummy
            edited = made.episode.views[name]
            pairs = [(view.rgb(t), edited.rgb(t)) for t in range(episode.length)]
            shares[name] = round(float(np.mean([(a != b).any(-1).mean() for a, b in pairs])), 4)
            frames = [pairs[t] for t in (0, episode.length // 2, episode.length - 1)]
            tiles += [np.concatenate([pair[k] for pair in frames], 1) for k in (0, 1)]
    except RpaugError as error:
        return {"became": "refused", "why": str(error)}, None
    left = {
        str(d["op"]): d["left_out"] for d in (x.describe() for x in made.draws) if d.get("left_out")
    }
    told = {"became": "written", "changed": shares, "left_out": left, "missing": list(missing)}
    return told | {"seconds": round(time.process_time() - start, 2)}, np.concatenate(tiles)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--held", action="store_true", help="the half that is set aside")
    parser.add_argument(
        "--command", action="append", default=[], help="only commands that begin so"
    )
    parser.add_argument("--drawn", type=Path, help="outlines; their episodes instead of a half")
    given = parser.parse_args()
    keys, kept = rpaug.episodes(given.data), {}
    which = "drawn" if given.drawn else HALVES[given.held]
    known = json.loads(given.drawn.read_text()) if given.drawn else {}
    for key in keys:
        if key not in known if given.drawn else half(key, keys) != which:
            continue
        episode = rpaug.read(given.data, key)
        for command, edits in commands(episode, given.command):
            told, sheet = one(episode, edits, given.drawn)
            kept[f"{key} | {command}"] = told
            sys.stdout.write(f"{key} ({episode.instruction}) | {command}: {json.dumps(told)}\n")
            if sheet is not None:
                large = max(
                    LARGER, SHEET // max(episode.views[next(iter(episode.views))].camera.height, 1)
                )
                path = (
                    given.out / which / command.replace(" ", "_") / (key.replace("/", "_") + ".png")
                )
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(
                    path,
                    encode_png(
                        cv2.resize(sheet, None, fx=large, fy=large, interpolation=cv2.INTER_CUBIC)
                    ),
                )
    write_atomic(given.out / f"{which}.json", json.dumps(kept, indent=1).encode())


if __name__ == "__main__":
    main()
