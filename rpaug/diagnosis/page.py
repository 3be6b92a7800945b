"""A diagnosis as one HTML page that needs nothing beside it: causes, figures, the recipe and the key frames."""

import html
from collections.abc import Sequence

import cv2
import numpy as np
import yaml
from jaxtyping import UInt8

from rpaug.diagnosis import pictures
from rpaug.diagnosis.evaluation import Evaluation, Rollout
from rpaug.diagnosis.messages import Cause, Diagnosis
from rpaug.diagnosis.reference import Reference

MOST_FAILURES, MOST_SUCCESSES = 12, 4
TILE = 160  # pixels, of one picture's height
STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1200px;padding:0 1rem;color:#1d232b;background:#fff}
h1{font-size:1.35rem}h2{font-size:1.1rem;margin:2rem 0 .4rem;border-top:1px solid #d7dce2;padding-top:1rem}
table{border-collapse:collapse;margin:.4rem 0}td,th{padding:4px 14px 4px 0;text-align:left;vertical-align:top;
border-bottom:1px solid #e6e9ed}th{color:#5a6673;font-weight:400}
td.n{text-align:right;font-variant-numeric:tabular-nums}
figure{display:inline-block;margin:.4rem 1rem .4rem 0}figcaption{color:#5a6673;max-width:40rem}
img{display:block;image-rendering:pixelated;max-width:100%}.bar{background:#c9402f;height:.7em;display:inline-block}
pre{background:#f5f7f9;padding:.7rem;overflow:auto}.by{color:#5a6673}
"""


def page(diagnosis: Diagnosis, evaluation: Evaluation, reference: Reference | None = None) -> bytes:
    """The page. Everything that came out of a file is escaped."""
    told = html.escape
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8><title>rpaug diagnosis</title>",
        f"<style>{STYLE}</style><h1>{told(diagnosis.verdict.capitalize())}: "
        f"{diagnosis.failures} of {diagnosis.rollouts} rollouts failed</h1>",
        f"<p class=by>Judged by: {told(diagnosis.analyst)}</p>",
        *(f"<p>{told(note)}</p>" for note in diagnosis.notes),
    ]
    if diagnosis.causes:
        parts += ["<h2>Causes</h2>", _causes(diagnosis.causes)]
    if diagnosis.measured:
        parts += ["<h2>Measured</h2>", _measured(diagnosis)]
    if diagnosis.recipe is not None:
        parts += ["<h2>Recipe</h2>", f"<pre>{told(recipe_file(diagnosis))}</pre>"]
    failures = [one for one in evaluation.rollouts if not one.success]
    parts += _frames("Failed", failures[:MOST_FAILURES], len(failures), diagnosis, reference)
    others = [one for one in evaluation.rollouts if one.success]
    if failures:
        parts += _frames("Succeeded", others[:MOST_SUCCESSES], len(others), diagnosis, reference)
    if diagnosis.usage:
        used = "; ".join(f"{told(who)}: {told(str(cost))}" for who, cost in diagnosis.usage.items())
        parts.append(f"<h2>Cost</h2><p>{used}</p>")
    return ("\n".join(parts) + "</html>\n").encode()


def recipe_file(diagnosis: Diagnosis) -> str:
    """The recipe as a file, with its causes on top."""
    lines = [f"# {diagnosis.failures} of {diagnosis.rollouts} rollouts failed: {diagnosis.analyst}"]
    lines += [f"# {one.factor}: {one.detail}" for one in diagnosis.causes]
    head = "\n".join(" ".join(line.split()) for line in lines)
    text = yaml.safe_dump(diagnosis.recipe, sort_keys=False, width=110, default_flow_style=None)
    return f"{head}\n{text}"


def _causes(causes: Sequence[Cause]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(one.factor)}<td class=n>{one.confidence:.2f}<td class=n>{100 * one.rate:.0f} %"
        f"<td>{html.escape(one.detail)}<td>{html.escape(one.remedy or one.note)}"
        f"<td>{html.escape(one.named)}"
        for one in causes
    )
    head = "<tr><th>factor<th>confidence<th>fails<th>what<th>remedy<th>named in"
    return f"<table>{head}{rows}</table>"


def _measured(diagnosis: Diagnosis) -> str:
    most = max((abs(one.effect) for one in diagnosis.measured), default=1) or 1
    rows = "".join(
        f"<tr><td>{one.factor}<td class=n>{one.failed:.1f}<td class=n>{one.succeeded:.1f}"
        f"<td class=n>{one.effect:+.2f} <span class=bar style='width:{60 * max(0, one.effect) / most:.0f}px'></span>"
        f"<td class=n>{one.threshold:.1f}<td class=n>{100 * one.exposed:.0f} %<td class=n>{100 * one.spared:.0f} %"
        f"<td class=n>{one.gain:.1f}<td class=n>{one.confidence:.2f}"
        for one in diagnosis.measured
    )
    return (
        "<p>Distance from the training recordings, in their standard deviations (medians); the effect is Cliff's "
        "delta; rates are of failures beyond and within the threshold.</p><table><tr><th>factor<th>failed"
        f"<th>succeeded<th>effect<th>threshold<th>beyond<th>within<th>gain<th>confidence</tr>{rows}</table>"
    )


def _frames(
    title: str,
    rollouts: Sequence[Rollout],
    count: int,
    diagnosis: Diagnosis,
    reference: Reference | None,
) -> list[str]:
    shown = "" if len(rollouts) == count else f", {len(rollouts)} shown"
    return [
        f"<h2>{title}: {count}{shown}</h2>",
        *(_figure(one, diagnosis.key_frames.get(one.name, ()), reference) for one in rollouts),
    ]


def _figure(rollout: Rollout, frames: Sequence[int], reference: Reference | None) -> str:
    camera = pictures.camera_of(rollout, reference)
    shots = rollout.shots[camera]
    times = [t for t in frames if t in shots] or [min(shots)]
    tiles = [_tile(shots[t].image()) for t in times]
    row = np.concatenate(
        [np.pad(tile, ((0, 0), (0, 4), (0, 0)), constant_values=255) for tile in tiles], 1
    )
    said = f"{rollout.name}, {camera}, frames {', '.join(map(str, times))}"
    said += f": “{rollout.instruction}”" if rollout.instruction else ""
    said += f" (perturbed: {rollout.factor})" if rollout.factor else ""
    source = pictures.embedded(row, side=max(row.shape))
    return (
        f"<figure><img alt='{html.escape(rollout.name, quote=True)}' src='{source}'>"
        f"<figcaption>{html.escape(said)}</figcaption></figure>"
    )


def _tile(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    width = max(1, round(image.shape[1] * TILE / image.shape[0]))
    return cv2.resize(image, (width, TILE), interpolation=cv2.INTER_NEAREST)
