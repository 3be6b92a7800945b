"""What an episode holds: cameras, frames, words, and every instance with its role, color, size and motion."""

import base64
import html
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from rpaug.core import keyframes
from rpaug.core.files import encode_png
from rpaug.core.types import CameraView, Episode
from rpaug.pipeline import prepare
from rpaug.scene.instances import rgb_episode
from rpaug.scene.targets.survey import InstanceSummary, survey
from rpaug.scene.tracking import arms, calibration
from rpaug.scene.video.video_scene import VideoScene

MARGIN = 4  # pixels around an instance's thumbnail


def inspect(
    episode: Episode, files: Sequence[Path] = ()
) -> tuple[dict[str, Any], tuple[InstanceSummary, ...], Episode]:
    """Plain values about the episode, one summary per instance, and the episode with instance ids where they were
    found.

    `files` are URDF or MJCF files of arms whose links are looked for first. Of a video whose camera can be worked out
    they are those of its registered frames, with the instance ids that edits of it go by.
    """
    described: dict[str, Any] = {
        "episode": episode.key,
        "instruction": episode.instruction,
        "descriptions": list(episode.descriptions),
        "frames": episode.length,
        "key_frames": keyframes.find(episode.robot),
        "cameras": {name: _camera(view) for name, view in episode.views.items()},
    }
    described["misplaced"] = {m.camera: str(m) for m in calibration.check(episode)}
    described["arms"] = list(arms.misfits(files, episode.robot))
    described["assumed"] = []
    found = prepare.found_instances(episode, files)
    scene = found.scene()
    if isinstance(scene.back, VideoScene):
        described["film"] = scene.back.describe()
    if not scene.bodies:
        return described | {"instances": []}, (), episode
    described["assumed"] = [*found.notes, *rgb_episode.assumptions(scene.episode)]
    rows = survey(scene.episode, scene.bodies, scene.roles)
    described["antialiased"] = scene.antialiased
    described["instances"] = [_described(row) for row in rows]
    return described, rows, scene.episode


def _described(row: InstanceSummary) -> dict[str, Any]:
    """Plain values; the instance id goes by the key that recipes use."""
    facts = asdict(row) | {
        "body": sorted(row.body),
        "pixels": dict(row.pixels),
        "moving": row.moving,
    }
    return {"handle": facts.pop("instance_id"), **facts}


def page(episode: Episode, described: dict[str, Any], rows: tuple[InstanceSummary, ...]) -> bytes:
    """The same as an HTML page with a thumbnail of every instance."""
    lines = "".join(
        f"<tr><td>{_thumbnail(episode, row)}<td>{row.instance_id}<td>{row.role or '–'}"
        f"<td><span style='background:rgb({','.join(str(round(255 * c)) for c in row.color)})'></span> "
        f"{row.color_name}<td>{' × '.join(f'{side:.1f}' for side in row.size_cm) if any(row.size_cm) else 'unknown'}"
        f"<td>{row.motion}{' (ambiguous)' if row.ambiguous else ''}<td>{row.residual_mm:.2f}"
        f"<td>{row.frames} ({row.first_frame}–{row.last_frame})"
        for row in rows
    )
    off = described["misplaced"]
    cameras = "".join(
        f"<li>{html.escape(name)}: {c['width']}×{c['height']}, focal {c['focal']:.1f} px, "
        f"{'fixed' if c['fixed'] else 'moving'}, {', '.join(c['images'])}"
        + (f"<br><strong>{html.escape(off[name])}</strong>" if name in off else "")
        for name, c in described["cameras"].items()
    )
    assumed = "".join(f"<li>{html.escape(given)}" for given in described["assumed"])
    return (
        "<!doctype html><html lang=en><meta charset=utf-8><title>rpaug inspect</title><style>"
        "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1100px;padding:0 1rem;color:#1d232b}"
        "table{border-collapse:collapse}td,th{padding:4px 14px 4px 0;text-align:left;border-bottom:1px solid #d7dce2}"
        "th{color:#5a6673;font-weight:400}img{image-rendering:pixelated;max-height:96px}"
        "td span{display:inline-block;width:1em;height:1em;border:1px solid #889;vertical-align:-.15em}</style>"
        f"<h1>{html.escape(described['episode'])}</h1><p>“{html.escape(described['instruction'])}”, "
        f"{described['frames']} frames, key frames {', '.join(map(str, described['key_frames']))}</p>"
        f"<ul>{cameras}{assumed}</ul><table><tr><th><th>handle<th>role<th>color<th>size, cm<th>motion"
        f"<th>residual, mm<th>seen in frames</tr>{lines}</table></html>"
    ).encode()


def _camera(view: CameraView) -> dict[str, Any]:
    images = ["rgb", *(["depth"] if view.depth else []), *(["mask"] if view.ids else [])]
    camera = view.camera
    return {
        "width": camera.width,
        "height": camera.height,
        "focal": float(camera.K[0, 0]),
        "fixed": camera.fixed,
        "assumed": camera.assumed,
        "placed": camera.placed,
        "images": images,
    }


def _thumbnail(episode: Episode, row: InstanceSummary) -> str:
    """The instance where most of it is seen, cut out of its camera's image."""
    best: tuple[int, UInt8[np.ndarray, "h w 3"] | None] = (0, None)
    name = max(row.pixels, key=lambda camera: row.pixels[camera], default=None)
    if name is None:
        return ""
    view = episode.views[name]
    assert view.ids is not None
    for t in sorted({row.first_frame, (row.first_frame + row.last_frame) // 2, row.last_frame}):
        mask = view.ids(t) == row.instance_id
        if mask.sum() > best[0]:
            down, right = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
            top, left = max(0, down[0] - MARGIN), max(0, right[0] - MARGIN)
            best = int(mask.sum()), view.rgb(t)[top : down[-1] + MARGIN, left : right[-1] + MARGIN]
    if best[1] is None:
        return ""
    data = base64.b64encode(encode_png(best[1])).decode()
    height = min(96, 3 * len(best[1]))
    return (
        f"<img alt='instance {row.instance_id}' src='data:image/png;base64,{data}' height={height}>"
    )
