"""The preview: an episode's cameras side by side, recorded and edited, frame by frame, as one page to share."""

import html
import json
from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rpaug.core import owner, progress, registry
from rpaug.core.errors import BadInput
from rpaug.pages.document import FOLDER, document
from rpaug.pages.session import Session
from rpaug.pipeline import journal, report
from rpaug.pipeline.recipe import Recipe

FRAMES, FEWER = (
    24,
    12,
)  # of an episode on a page, at most; the second where there are more episodes than
FEW = 3  # episodes
DRAWS = 4  # copies that are made ahead
TITLE = "rpaug preview"


def page(
    root: Path,
    keys: Sequence[str],
    recipe: Recipe,
    *,
    draws: int = DRAWS,
    frames: int | None = None,
    judged: bool = True,
    count: Callable[[int, int], None] = lambda _done, _total: None,
) -> bytes:
    """The page of these episodes with copies 1, 2, ... as `rpaug augment` makes them, gates and redraws included; the
    first draw of each, and no more than the frames that are shown, where they are not to be `judged`.

    `count` is called with the copies that are done, and all. Raises RpaugError.
    """
    count(0, len(keys) * draws)
    frames = frames or (FRAMES if len(keys) <= FEW else FEWER)
    shown = []
    for number, key in enumerate(keys, 1):
        session = Session(root, key)
        progress.told(key, "finding what is in the scene")
        described = session.describe()
        times = thinned(described["length"], frames)
        made = []
        for copy in range(1, draws + 1):
            made.append(session.drawn(recipe, copy, times, judged=judged))
            progress.told(key, progress.COPY, copy, draws)
        shown.append(
            {**described, "frames": times, "before": deepcopy(session.before(times)), "draws": made}
        )
        progress.told(key, progress.FINISHED)
        count(number * draws, len(keys) * draws)
    images = _shared(shown)
    notes = dict.fromkeys(
        f"{one['key']}: {warning}"
        for one in shown
        for draw in one["draws"]
        for warning in draw["warnings"]
    )
    told = {
        "notes": [*unfinished(root), *notes],
        "recipe": recipe.source,
        "yaml": text(recipe.source),
    }
    return built({"episodes": shown, "images": images, **told})


def unfinished(root: Path) -> list[str]:
    """In a sentence, that a dataset is being written, or that the run which wrote it never ended."""
    root = root.resolve()
    if who := owner.writer(root):
        return [f"{root.name} is being written: {who}. What is written later is not shown here."]
    if (root / journal.NAME).exists() and not (root / report.SUMMARY).exists():
        return [
            f"{root.name} is not complete: its run has not ended. rpaug augment --resume ends it."
        ]
    return []


def _shared(episodes: list[dict[str, Any]]) -> list[str]:
    """All pictures, each once: edits of color leave depth and masks as they are. The episodes get their numbers."""
    numbers: dict[str, int] = {}
    for episode in episodes:
        for images in (episode["before"], *(draw["images"] for draw in episode["draws"])):
            for kinds in images.values():
                for one in kinds.values():
                    one["url"] = numbers.setdefault(one["url"], len(numbers))
    return list(numbers)


def thinned(length: int, most: int) -> list[int]:
    """At most so many frames, the first and the last among them."""
    return sorted(set(np.linspace(0, length - 1, min(length, most)).round().astype(int).tolist()))


def text(recipe: dict[str, Any]) -> str:
    """A recipe as YAML."""
    return yaml.safe_dump(recipe, sort_keys=False, width=100, default_flow_style=None)


def built(data: dict[str, Any]) -> bytes:
    """The page around its data: `episodes` with their images, or `served` where a server gives them as asked."""
    held = json.dumps(data).replace("<", "\\u003c")
    script = (FOLDER / "preview.js").read_text()
    served = bool(data.get("served"))
    form = "".join((FOLDER / name).read_text() for name in ("fields.js", "editor.js") if served)
    body = _body(data.get("notes", ()), served)
    return document(
        TITLE,
        body,
        f"<script type=application/json id=data>{held}</script><script>{script}{form}</script>",
    )


def _body(notes: Sequence[str], served: bool) -> str:
    """The places that scripts fill; where a server draws, the form stands beside the images."""
    noted = "".join(f"<p class=bad>{html.escape(note)}</p>" for note in notes)
    shown = (
        f"<h1 id=title>{html.escape(TITLE)}</h1>{noted}<div id=facts></div>"
        "<div id=bar class=bar></div><div id=views class=views></div>"
    )
    drawn = (
        "<h2>What was drawn</h2><div id=drawn aria-live=polite></div>"
        "<h2>Roles</h2><ul id=roles class=told></ul>"
    )
    how = (
        "<p id=status role=status class=soft></p><div id=editor></div>"
        if served
        else "<p class=soft>Edited and tried in the browser by <code>rpaug preview DATASET --serve</code>.</p>"
    )
    edits = (
        f"<section><h2>Recipe</h2>{how}"
        "<p><button id=copy type=button>copy as YAML</button> <span id=copied role=status></span></p>"
        f"<details id=folded{'' if served else ' open'}><summary>as YAML</summary>"
        "<pre id=yaml tabindex=0></pre></details></section>"
    )
    keys = (
        "<p class=soft>Keys: left and right for frames, space plays, 1 to 6 for what is shown, n for the next draw, "
        "[ and ] for episodes.</p>"
    )
    if served:
        return f"<div class=beside><div>{shown}{drawn}{keys}</div>{edits}</div>"
    return f"{shown}<div class=two><section>{drawn}</section>{edits}</div>{keys}"


def replaced(path: Path) -> None:
    """See that nothing but an earlier preview is there. Raises BadInput."""
    if path.exists() and (path.is_dir() or TITLE.encode() not in path.read_bytes()[:400]):
        raise BadInput(
            path, "--out", found="something else", expected="a new file, or an earlier preview"
        )


def chosen(root: Path, key: str | None, count: int) -> list[str]:
    """The key that was asked for, else the first ones. Raises BadInput."""
    keys = list(registry.adapter_for(root).episodes(root))
    if key is not None and key not in keys:
        raise BadInput(root, "episode", found=key, expected=f"one of: {', '.join(keys[:20])}")
    return [key] if key is not None else keys[:count]
