"""The contact sheet: before, after and difference of a few episodes at their key frames, as one HTML page; and a page
for each run of twenty-four, so that all can be seen."""

import html
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
import yaml
from jaxtyping import UInt8

from rpaug.core import keyframes
from rpaug.core.errors import BadInput
from rpaug.core.files import REJECTED, write_changed
from rpaug.core.interfaces import Adapter
from rpaug.core.types import CameraView, Episode
from rpaug.core.visible import quoted
from rpaug.pages import told
from rpaug.pages.document import document, facts, figure, jpeg
from rpaug.pipeline import journal, report

MOST_EPISODES = 8  # of the sheet
ON_A_PAGE = 24  # episodes, recorded ones among them
MOST_FRAMES = 4  # side by side
ROWS = 3  # of them, where one camera of one episode is all there is to see
TILE = 144  # pixels, of one image's height on the sheet
BLACK = 8  # levels of a camera that shows nothing, at most: a codec's error
CODED = 2  # levels by which a JPEG file of best quality is off
GAIN = 2  # the difference is shown twice as strong, around grey
LEGEND = f"<p class=soft>Rows: recorded, edited, difference (times {GAIN}, grey is none). Columns: key frames.</p>"


def sheet(
    source: Episode, made: Episode, frames: Sequence[int]
) -> dict[str, UInt8[np.ndarray, "h w 3"]]:
    """Per camera: one row each of before, after and difference, one column a frame."""
    rows = {}
    for name, view in made.views.items():
        columns = [_column(source.views[name].rgb(t), view.rgb(t)) for t in frames]
        rows[name] = np.concatenate(columns, 1)
    return rows


def write(adapter: Adapter, source: Path, target: Path) -> Path:
    """The sheet of a finished output folder; returns its path."""
    keys = _keys(adapter, target)
    picked = _picked(target, keys)
    read = _recorded(adapter, source)
    rows = ROWS if len(picked) == 1 else 1
    parts = [_section(adapter, read, target, key, one, rows) for key, one in picked.items()]
    summary = json.loads((target / report.SUMMARY).read_bytes())
    body = (
        f"<h1>{len(keys)} episode{'s' * (len(keys) != 1)}, {len(picked)} augmented ones shown</h1>"
        f"{_where_others_are(keys, picked)}"
        f"{facts(_facts(summary))}{LEGEND}{''.join(parts)}"
        f"<h2>Recipe</h2><details><summary>as YAML</summary><pre tabindex=0>{_yaml(summary['recipe'])}</pre></details>"
    )
    write_changed(target / report.CONTACT_SHEET, document("rpaug contact sheet", body))
    return target / report.CONTACT_SHEET


def _picked(target: Path, keys: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Reports of the augmented episodes that are shown: those that lack none of what they drew come first, evenly
    spread over all of them, those that lack all of it last."""
    picked: dict[str, dict[str, Any]] = {}
    lacking = _lacking(target)
    for least in sorted({lacking.get(key, 0.0) for key in keys}):
        own = [key for key in keys if lacking.get(key, 0.0) == least]
        for i in np.linspace(0, len(own) - 1, min(MOST_EPISODES - len(picked), len(own))).astype(
            int
        ):
            for key in (*own[i:], *reversed(own[:i])):
                one = None if key in picked else report.of(target / key)
                if one is not None and one["synthetic"]:
                    picked[key] = one
                    break
            else:
                break  # all that there are
    return picked


def _lacking(target: Path) -> dict[str, float]:
    """By key, of episodes that lack an edit that they drew, the share of those that they lack: by the journal, which
    takes no reading of each report."""
    found: dict[str, float] = {}
    for _, line in journal.lines(target):
        if line.get("in"):
            continue  # rejected ones
        if "made" in line:
            drawn = [left_out for _, _, left_out, _ in line["facts"].get("draws", ())]
            share = sum(map(bool, drawn)) / len(drawn) if drawn else 0.0
            found |= {line["made"]: share} if share else {}
        elif line.get("renamed") in found:
            found[line["to"]] = found.pop(line["renamed"])
    return found


def _where_others_are(keys: Sequence[str], picked: Mapping[str, Any]) -> str:
    """How episodes that the sheet leaves out are seen; nothing where it shows all."""
    if len(picked) == len(keys):
        return ""
    last = f", up to page {_pages(keys)}," if _pages(keys) > 1 else ""
    return (
        "<p class=soft>Those that lack least of what they drew, evenly spread. "
        "<code>rpaug contact OUT --page 1 --html FILE</code>"
        f"{last} shows every episode.</p>"
    )


def page(
    adapter: Adapter,
    source: Path,
    target: Path,
    number: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[bytes, int]:
    """One page of all episodes of an output, counted from 1, and how many there are. `progress` is called with the
    episodes that are drawn, and all. Raises BadInput where there is no such page."""
    keys = _keys(adapter, target)
    most, first = _pages(keys), (number - 1) * ON_A_PAGE
    if not 1 <= number <= most:
        raise BadInput(target, "--page", found=number, expected=f"a page from 1 to {most}")
    read = _recorded(adapter, source)
    parts: list[str] = []
    shown = keys[first : first + ON_A_PAGE]
    for key in shown:
        progress(len(parts), len(shown))
        one = report.of(target / key)
        if one is None or not one["synthetic"]:
            parts.append(
                f"<h2>{html.escape(key)}</h2><p class=soft>recorded, nothing was edited</p>"
            )
        else:
            parts.append(_section(adapter, read, target, key, one))
    last = first + len(parts)
    title = f"Episodes {first + 1} to {last} of {len(keys)}"
    body = f"<h1>{title}</h1><p class=soft>Page {number} of {most}.</p>{LEGEND}{''.join(parts)}"
    return document(f"rpaug: {title}", body), most


def _pages(keys: Sequence[str]) -> int:
    return -(-len(keys) // ON_A_PAGE)


def _keys(adapter: Adapter, target: Path) -> list[str]:
    """Episodes that were kept."""
    return [key for key in adapter.episodes(target) if PurePosixPath(key).parts[0] != REJECTED]


def key_frames(episode: Episode, most: int = MOST_FRAMES) -> list[int]:
    """At most so many frames worth seeing: the key frames (all frames where there are none), evenly thinned."""
    found = sorted({0, *(keyframes.find(episode.robot) or range(episode.length))})
    picks = sorted(set(np.linspace(0, len(found) - 1, min(most, len(found))).round().astype(int)))
    return [min(found[i], episode.length - 1) for i in picks]


def _facts(summary: Mapping[str, Any]) -> list[tuple[str, object]]:
    """What a run came to, at a glance."""
    changed = summary.get("changed_share", {})
    found: list[tuple[str, object]] = [
        ("rejected", len(summary.get("rejected", {}))),
        ("skipped", len(summary.get("failures", {}))),
        ("seconds", f"{sum(summary.get('seconds', {}).values()):.0f}"),
    ]
    shares = ", ".join(
        f"{name} {100 * share:.{0 if share >= 0.01 else 1}f} %" for name, share in changed.items()
    )
    levels = ", ".join(
        f"{name} {mean:.1f}" for name, mean in summary.get("mean_change", {}).items()
    )
    more = [("pixels changed", shares), ("mean change in levels of 255", levels)]
    return [*found, *((name, value) for name, value in more if value)]


def _recorded(adapter: Adapter, source: Path) -> Callable[[str], Episode]:
    """Reads a recorded episode; the last one is kept, since its copies lie side by side."""
    return lru_cache(1)(lambda key: adapter.read(source, key))


def _section(
    adapter: Adapter,
    recorded: Callable[[str], Episode],
    target: Path,
    key: str,
    described: dict[str, Any],
    rows: int = 1,
) -> str:
    before, after = recorded(described["source"]), adapter.read(target, key)
    frames = key_frames(before, MOST_FRAMES * (rows if len(before.views) == 1 else 1))
    times = [*frames, *(t for t in range(before.length) if t not in frames)]
    shown = {n: one for n, one in before.views.items() if not _black(one, after.views[n], times)}
    after = replace(after, views={name: after.views[name] for name in shown})
    dark = [name for name in before.views if name not in shown]
    left_out = f"<p class=soft>Black throughout, left out: {html.escape(', '.join(dark))}.</p>"
    figures = [
        figure(
            jpeg(image),
            f"{name}: recorded, edited, difference",
            f"{name}, {_by_frame(before.views[name], after.views[name], some)}; of all frames "
            f"{report.change(described, name)}",
        )
        for some in (frames[n : n + MOST_FRAMES] for n in range(0, len(frames), MOST_FRAMES))
        for name, image in sheet(replace(before, views=shown), after, some).items()
    ]
    repainted = {int(one): word for one, word in described.get("repainted", {}).items()}
    words = "".join(
        f"<li><span class=soft>{html.escape(op)}</span> {html.escape(what)}"
        for op, what in told.draws(described["draws"], repainted)
    )
    drawn = json.dumps(described["draws"], indent=1)
    return (
        f"<h2>{html.escape(key)}</h2><p>{html.escape(quoted(after.instruction))}, copy {described['copy']} of "
        f"{html.escape(described['source'])}</p><ul class=told>{words or '<li>nothing was drawn'}</ul>"
        f"<div class='views large'>{''.join(figures)}</div>{left_out if dark else ''}"
        f"<details><summary>drawn values as JSON</summary><pre tabindex=0>{html.escape(drawn)}</pre></details>"
    )


def _by_frame(recorded: CameraView, made: CameraView, frames: Sequence[int]) -> str:
    """How much of each shown frame changed, by more than a file's own error."""
    words = []
    for t in frames:
        off = np.abs(made.rgb(t).astype(np.int16) - recorded.rgb(t)).max(-1)
        share = float((off > CODED).mean())
        some = f"{100 * share:.0f} %" if share >= 0.005 else "under 1 %"
        words.append(f"frame {t}: {some if off.any() else 'unchanged'}")
    return ", ".join(words)


def _black(recorded: CameraView, made: CameraView, times: Sequence[int]) -> bool:
    """Whether a camera shows nothing at these times, neither recorded nor edited."""
    return all(max(int(view.rgb(t).max()) for view in (recorded, made)) <= BLACK for t in times)


def _yaml(recipe: Mapping[str, Any]) -> str:
    return html.escape(
        yaml.safe_dump(dict(recipe), sort_keys=False, width=100, default_flow_style=None)
    )


def _column(
    before: UInt8[np.ndarray, "h w 3"], after: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "h w 3"]:
    difference = (after.astype(np.int16) - before) * GAIN + 128
    tiles = [before, after, np.clip(difference, 0, 255).astype(np.uint8)]
    width = max(1, round(before.shape[1] * TILE / before.shape[0]))
    how = cv2.INTER_AREA if before.shape[0] > TILE else cv2.INTER_NEAREST
    scaled = [cv2.resize(tile, (width, TILE), interpolation=how) for tile in tiles]
    return np.pad(np.concatenate(scaled), ((0, 0), (0, 4), (0, 0)), constant_values=255)
