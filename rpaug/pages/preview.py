"""The preview: an episode's cameras side by side, recorded and edited, frame by frame, as one page to share."""

import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rpaug.core import progress, registry
from rpaug.core.errors import BadInput
from rpaug.pages.document import FOLDER, document
from rpaug.pages.session import Session
from rpaug.pipeline.recipe import Recipe

FRAMES = 24  # of an episode on a page, at most
DRAWS = 4  # copies that are made ahead
TITLE = "rpaug preview"


def page(
    root: Path,
    keys: Sequence[str],
    recipe: Recipe,
    *,
    draws: int = DRAWS,
    frames: int = FRAMES,
) -> bytes:
    """The page of these episodes with copies 1, 2, ... as `rpaug augment` makes them, gates and redraws included.

    Raises RpaugError.
    """
    shown = []
    for key in keys:
        session = Session(root, key)
        progress.told(key, "finding what is in the scene")
        described = session.describe()
        times = thinned(described["length"], frames)
        made = []
        for copy in range(1, draws + 1):
            made.append(session.drawn(recipe, copy, times, judged=True))
            progress.told(key, progress.COPY, copy, draws)
        shown.append({**described, "frames": times, "before": session.before(times), "draws": made})
        progress.told(key, progress.FINISHED)
    return built({"episodes": shown, "recipe": recipe.source, "yaml": text(recipe.source)})


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
    served = ("fields.js", "editor.js") if data.get("served") else ()
    form = "".join((FOLDER / name).read_text() for name in served)
    title = html.escape(TITLE)
    shown = (
        f"<h1 id=title>{title}</h1>{_notes(data)}<div id=facts></div>"
        "<div id=bar class=bar></div><div id=views class=views></div>"
    )
    drawn = (
        "<h2>What was drawn</h2><div id=drawn aria-live=polite></div>"
        "<h2>Roles</h2><ul id=roles class=told></ul>"
    )
    edits = (
        "<section><h2>Recipe</h2><p id=status role=status class=soft></p><div id=editor></div>"
        "<p><button id=copy type=button>copy as YAML</button> <span id=copied role=status></span></p>"
        "<details id=folded><summary>as YAML</summary><pre id=yaml></pre></details></section>"
    )
    keys = (
        "<p class=soft>Keys: left and right for frames, space plays, 1 to 6 for what is shown, n for the next draw, "
        "[ and ] for episodes.</p>"
    )
    if served:
        body = f"<div class=beside><div>{shown}{drawn}{keys}</div>{edits}</div>"
    else:
        body = f"{shown}<div class=two><section>{drawn}</section>{edits}</div>{keys}"
    return document(
        TITLE,
        body,
        f"<script type=application/json id=data>{held}</script><script>{script}{form}</script>",
    )


def _notes(data: dict[str, Any]) -> str:
    """What is to be known of the data before anything else."""
    return "".join(f"<p class=bad>{html.escape(note)}</p>" for note in data.get("notes", ()))


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
