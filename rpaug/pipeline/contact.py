"""The contact sheet: before, after and difference of a few episodes at their key frames, as one HTML page."""

import base64
import html
import json
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core import keyframes
from rpaug.core.files import REJECTED, encode_png, write_atomic
from rpaug.core.interfaces import Adapter
from rpaug.core.types import Episode
from rpaug.pipeline import report

NAME = "rpaug.contact.html"
MOST_EPISODES = 8
MOST_FRAMES = 4
TILE = 144  # pixels, of one image's height on the sheet
GAIN = 4  # the difference is shown four times as strong, around grey

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1500px;padding:0 1rem;
color:#1d232b;background:#fff}
h1{font-size:1.35rem}h2{font-size:1.05rem;margin:2rem 0 .3rem;border-top:1px solid #d7dce2;padding-top:1rem}
table{border-collapse:collapse;margin:.4rem 0}td,th{padding:2px 14px 2px 0;text-align:left;
vertical-align:top;font-weight:400}
th{color:#5a6673}figure{margin:.6rem 0;overflow-x:auto}figcaption{color:#5a6673}
img{image-rendering:pixelated;max-width:none}
pre{background:#f5f7f9;padding:.7rem;overflow:auto;max-height:16rem}code{background:#f5f7f9}
"""


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
    keys = [key for key in adapter.episodes(target) if PurePosixPath(key).parts[0] != REJECTED]
    picked: dict[str, dict[str, Any]] = {}
    for i in np.linspace(0, len(keys) - 1, min(MOST_EPISODES, len(keys))).astype(int):
        for key in (*keys[i:], *reversed(keys[:i])):
            one = None if key in picked else report.of(target / key)
            if one is not None and one["synthetic"]:
                picked[key] = one
                break
        else:
            break  # all that there are
    parts = [_section(adapter, source, target, key, picked[key]) for key in keys if key in picked]
    summary = json.loads((target / report.SUMMARY).read_bytes())
    page = (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>rpaug contact sheet</title>"
        f"<style>{STYLE}</style><h1>{len(keys)} episodes, {len(picked)} augmented ones shown</h1>"
        f"<p>Rows: recorded, edited, difference (times {GAIN}, grey is none). Columns: key frames.</p>"
        f"<details><summary>Recipe</summary><pre>{html.escape(json.dumps(summary['recipe'], indent=1))}</pre></details>"
        f"{''.join(parts)}</html>"
    )
    write_atomic(target / NAME, page.encode())
    return target / NAME


def key_frames(episode: Episode) -> list[int]:
    """At most four frames worth seeing: the key frames (all frames where there are none), evenly thinned."""
    found = sorted({0, *(keyframes.find(episode.robot) or range(episode.length))})
    picks = sorted(
        set(np.linspace(0, len(found) - 1, min(MOST_FRAMES, len(found))).round().astype(int))
    )
    return [min(found[i], episode.length - 1) for i in picks]


def _section(
    adapter: Adapter, source: Path, target: Path, key: str, described: dict[str, Any]
) -> str:
    before, after = adapter.read(source, described["source"]), adapter.read(target, key)
    frames = key_frames(before)
    figures = [
        f"<figure><img alt='{html.escape(name)}' src='{_embedded(image)}'>"
        f"<figcaption>{html.escape(name)}, frames {', '.join(map(str, frames))}; "
        f"{100 * described['changed_share'].get(name, 0.0):.1f} % of pixels changed</figcaption></figure>"
        for name, image in sheet(before, after, frames).items()
    ]
    draws = "".join(
        f"<tr><th>{html.escape(draw.get('op', 'skipped'))}<td><code>{html.escape(_came_to(draw))}</code>"
        for draw in described["draws"]
    )
    return (
        f"<h2>{html.escape(key)}</h2><p>from {html.escape(described['source'])}, copy {described['copy']}: "
        f"“{html.escape(after.instruction)}”</p><table>{draws}</table>{''.join(figures)}"
    )


def _came_to(draw: dict[str, Any]) -> str:
    return draw.get("left_out") or json.dumps(draw.get("edit"))


def _embedded(image: UInt8[np.ndarray, "h w 3"]) -> str:
    return f"data:image/png;base64,{base64.b64encode(encode_png(image)).decode()}"


def _column(
    before: UInt8[np.ndarray, "h w 3"], after: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "h w 3"]:
    difference = (after.astype(np.int16) - before) * GAIN + 128
    tiles = [before, after, np.clip(difference, 0, 255).astype(np.uint8)]
    width = max(1, round(before.shape[1] * TILE / before.shape[0]))
    scaled = [cv2.resize(tile, (width, TILE), interpolation=cv2.INTER_NEAREST) for tile in tiles]
    return np.pad(np.concatenate(scaled), ((0, 0), (0, 4), (0, 0)), constant_values=255)
