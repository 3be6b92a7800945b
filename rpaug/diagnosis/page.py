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
from rpaug.pages import document

MOST_FAILURES, MOST_SUCCESSES, MOST_RECORDINGS = 12, 4, 3
TILE = 160  # pixels, of one picture's height


def page(diagnosis: Diagnosis, evaluation: Evaluation, reference: Reference | None = None) -> bytes:
    """The page. Everything that came out of a file is escaped; what cannot be seen is spelled out."""
    given = html.escape
    parts = [
        f"<h1>{given(diagnosis.verdict.capitalize())}: "
        f"{diagnosis.failures} of {diagnosis.rollouts} rollouts failed</h1>",
        f"<p class=soft>Judged by: {given(diagnosis.analyst)}</p>",
        *(f"<p>{given(note)}</p>" for note in diagnosis.notes),
    ]
    if diagnosis.causes:
        parts += ["<h2>Causes</h2>", _causes(diagnosis.causes)]
    if diagnosis.measured:
        parts += ["<h2>Measured</h2>", _measured(diagnosis)]
    if diagnosis.recipe is not None:
        parts += ["<h2>Recipe</h2>", f"<pre tabindex=0>{given(recipe_file(diagnosis))}</pre>"]
    failures = [one for one in evaluation.rollouts if not one.success]
    if failures and reference is not None:
        parts += _recorded(failures, reference)
    parts += _frames("Failed", failures[:MOST_FAILURES], len(failures), diagnosis, reference)
    others = [one for one in evaluation.rollouts if one.success]
    if failures:
        parts += _frames("Succeeded", others[:MOST_SUCCESSES], len(others), diagnosis, reference)
    if diagnosis.usage:
        used = "; ".join(
            f"{given(who)}: {given(str(cost))}" for who, cost in diagnosis.usage.items()
        )
        parts.append(f"<h2>Cost</h2><p>{used}</p>")
    return document.document("rpaug diagnosis", "\n".join(parts))


def recipe_file(diagnosis: Diagnosis) -> str:
    """The recipe as a file, with its causes on top."""
    lines = [f"# {diagnosis.failures} of {diagnosis.rollouts} rollouts failed: {diagnosis.analyst}"]
    lines += [f"# {one.factor}: {one.detail}" for one in diagnosis.causes]
    head = "\n".join(" ".join(line.split()) for line in lines)
    text = yaml.safe_dump(diagnosis.recipe, sort_keys=False, width=110, default_flow_style=None)
    return f"{head}\n{text}"


def _causes(causes: Sequence[Cause]) -> str:
    given = html.escape
    named = any(one.named for one in causes)  # only models say in how many failures they saw it
    rows = "".join(
        f"<tr><td>{given(one.factor)}<td class=n>{one.confidence:.2f}<td class=n>{100 * one.rate:.0f} %"
        f"<td class=side>{given(one.detail)}<td class=side>{given(one.remedy or one.note)}"
        + (f"<td>{given(one.named)}" if named else "")
        for one in causes
    )
    head = "<tr><th>factor<th class=n>confidence<th class=n>fails<th>what<th>remedy"
    return f"<div class=scroll tabindex=0><table>{head}{'<th>named in' if named else ''}{rows}</table></div>"


def _measured(diagnosis: Diagnosis) -> str:
    most = max((abs(one.effect) for one in diagnosis.measured), default=1) or 1
    rows = "".join(
        f"<tr><td>{one.factor}<td class=n>{one.failed:.1f}<td class=n>{one.succeeded:.1f}"
        f"<td class=n>{one.effect:+.2f} <span class=scale><span class=level "
        f"style='width:{60 * max(0, one.effect) / most:.0f}px'></span></span>"
        f"<td class=n>{one.threshold:.1f}<td class=n>{100 * one.exposed:.0f} %<td class=n>{100 * one.spared:.0f} %"
        f"<td class=n>{one.gain:.1f}<td class=n>{one.confidence:.2f}"
        for one in diagnosis.measured
    )
    names = ("failed", "succeeded", "effect", "threshold", "beyond", "within", "gain", "confidence")
    head = "".join(f"<th class=n>{name}" for name in names)
    return (
        "<p>Distance from the training recordings, in their standard deviations (medians); the effect is Cliff's "
        "delta; rates are of failures beyond and within the threshold.</p>"
        f"<div class=scroll tabindex=0><table><tr><th>factor{head}{rows}</table></div>"
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
        f"<h2>{title}: {count}{shown}</h2><div class=views>",
        *(_figure(one, diagnosis.key_frames.get(one.name, ()), reference) for one in rollouts),
        "</div>",
    ]


def _recorded(rollouts: Sequence[Rollout], reference: Reference) -> list[str]:
    """How recordings begin in the camera that the first rollout is shown in, if they have it."""
    camera = pictures.camera_of(rollouts[0], reference)
    if camera not in reference.plates:
        return []
    firsts = [one.image for one in reference.plates[camera].firsts[:MOST_RECORDINGS]]
    stated = f"{camera}, first frames of {len(firsts)} recordings"
    return ["<h2>Recorded</h2><div class=views>", _strip("recordings", stated, firsts), "</div>"]


def _figure(rollout: Rollout, frames: Sequence[int], reference: Reference | None) -> str:
    camera = pictures.camera_of(rollout, reference)
    shots = rollout.shots[camera]
    times = [t for t in frames if t in shots] or [min(shots)]
    stated = f"{rollout.name}, {camera}, frames {', '.join(map(str, times))}"
    stated += f": “{rollout.instruction}”" if rollout.instruction else ""
    stated += f" (perturbed: {rollout.factor})" if rollout.factor else ""
    return _strip(rollout.name, stated, [shots[t].image() for t in times])


def _strip(name: str, stated: str, images: Sequence[UInt8[np.ndarray, "h w 3"]]) -> str:
    """Images side by side, and what they are."""
    row = np.concatenate(
        [np.pad(_tile(one), ((0, 0), (0, 4), (0, 0)), constant_values=255) for one in images], 1
    )
    return document.figure(document.png(row), name, stated)


def _tile(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    width = max(1, round(image.shape[1] * TILE / image.shape[0]))
    return cv2.resize(image, (width, TILE), interpolation=cv2.INTER_NEAREST)
