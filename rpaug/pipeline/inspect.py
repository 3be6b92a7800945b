"""What an episode holds: cameras, frames, words, and every instance with its role, color, size and motion."""

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from rpaug.core import keyframes, registry
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png
from rpaug.core.pixels import grown
from rpaug.core.progress import told
from rpaug.core.types import CameraView, Episode
from rpaug.pipeline import prepare, role_facts
from rpaug.pipeline.run import group_of
from rpaug.scene.instances import rgb_episode
from rpaug.scene.targets.settled import SettledRole, settle
from rpaug.scene.targets.survey import InstanceSummary, survey
from rpaug.scene.tracking import arms, calibration
from rpaug.scene.video.video_scene import VideoScene

MARGIN = 4  # pixels around an instance's thumbnail
OUTLINES = {  # display sRGB, apart to the color-blind too (Okabe and Ito 2008)
    "manipulated": (230, 159, 0),
    "receiver": (0, 114, 178),
    "robot": (204, 121, 167),
    "table": (0, 158, 115),
    "background": (86, 180, 233),
}


def inspect(
    episode: Episode, files: Sequence[Path] = (), roles: Mapping[str, SettledRole] | None = None
) -> tuple[dict[str, Any], tuple[InstanceSummary, ...], Episode]:
    """Plain values about the episode, one summary per instance, and the episode with instance ids where they were
    found.

    `files` are URDF or MJCF files of arms whose links are looked for first, `roles` what a person settled. Of a video
    whose camera can be worked out they are those of its registered frames, with the instance ids that edits go by.
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
    described["assumed"], described["unread"] = [], list(episode.unread)
    told(episode.key, "finding what is in the scene")
    found = prepare.found_instances(episode, files)
    scene, wrong = settle(found.scene(), roles or {})
    if isinstance(scene.back, VideoScene):
        described["film"] = scene.back.describe()
    if not scene.bodies:
        return described | {"instances": []}, (), episode
    described["assumed"] = [*found.notes, *wrong, *rgb_episode.assumptions(scene.episode)]
    told(episode.key, "measuring instances")
    rows = survey(scene.episode, scene.bodies, scene.roles)
    described["roles"] = role_facts.describe(scene)
    described["antialiased"] = scene.antialiased
    described["instances"] = [_described(row) for row in rows]
    return described, rows, scene.episode


def roles_of_all(
    dataset: Path, files: Sequence[Path] = (), roles: Mapping[str, SettledRole] | None = None
) -> dict[str, dict[str, Any]]:
    """What is believed of the roles of each episode of a dataset that can be read, by its key."""
    adapter = registry.adapter_for(dataset)
    found, keys = {}, adapter.episodes(dataset)
    for number, key in enumerate(keys):
        told(key, "finding roles, episode", number, len(keys))
        try:
            scene = prepare.found_instances(adapter.read(dataset, key), files).scene()
        except RpaugError:
            continue  # `augment` names it
        found[key] = role_facts.describe(settle(scene, roles or {})[0])
    return found


def disagreement(dataset: Path, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """In which roles episodes of one group differ, in sentences."""
    adapter, groups = registry.adapter_for(dataset), dict[str, dict[str, Any]]()
    for key, one in found.items():
        groups.setdefault(group_of(adapter, key), {})[key] = one
    return [words for group in groups.values() for words in role_facts.disagreement(group)]


def roles_file(rows: Sequence[InstanceSummary], every: Sequence[Mapping[str, Any]]) -> str:
    """A `roles.yaml` of one episode's roles: by mask id where all episodes believe the same ids, else by a color that
    nothing else has; a role that neither tells is a comment."""
    lines = []
    for role in dict.fromkeys(row.role for row in rows if row.role):
        own = [row for row in rows if row.role == role]
        ids, colors = [row.instance_id for row in own], sorted({row.color_name for row in own})
        alone = {row.instance_id for row in rows if row.color_name in colors} == {*ids}
        if all(one.get(role, {}).get("handles") == ids for one in every):
            lines.append(f"  {role}: {{handle: {ids}}}")
        elif alone and len(colors) == 1:
            lines.append(f"  {role}: {{color: {colors[0]}, all: true}}")
        else:
            lines.append(
                f"  # {role}: {ids} in this episode; other ids elsewhere, and no color of its own"
            )
    empty = all(line.startswith("  #") for line in lines)
    return "\n".join(["version: 1", "roles: {}" if empty else "roles:", *lines]) + "\n"


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
    unread = "".join(
        f"<li><strong>not understood: {html.escape(words)}</strong>"
        for words in described["unread"]
    )
    assumed = "".join(f"<li>{html.escape(given)}" for given in described["assumed"])
    return (
        "<!doctype html><html lang=en><meta charset=utf-8><title>rpaug inspect</title><style>"
        "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1100px;padding:0 1rem;color:#1d232b}"
        "table{border-collapse:collapse}td,th{padding:4px 14px 4px 0;text-align:left;border-bottom:1px solid #d7dce2}"
        "th{color:#5a6673;font-weight:400}img{image-rendering:pixelated;max-height:96px}"
        "img.whole{max-height:none;width:320px}.views{display:flex;flex-wrap:wrap;gap:8px}figure{margin:0}"
        "td span,.roles span{display:inline-block;width:1em;height:1em;border:1px solid #889}</style>"
        f"<h1>{html.escape(described['episode'])}</h1><p>“{html.escape(described['instruction'])}”, "
        f"{described['frames']} frames, key frames {', '.join(map(str, described['key_frames']))}</p>"
        f"<ul>{cameras}{unread}{assumed}</ul>{_outlined(episode, described)}"
        "<table><tr><th><th>handle<th>role<th>color<th>size, cm<th>motion"
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


def _outlined(episode: Episode, described: dict[str, Any]) -> str:
    """One frame a camera with the roles' outlines in their colors, and why each is believed."""
    believed = described.get("roles", {})
    lines = "".join(
        f"<li><span style='background:rgb{OUTLINES[role]}'></span> {role}: "
        f"{', '.join(map(str, one['handles'])) or 'none'}{role_facts.sure(one)}"
        + "".join(f"<br>{html.escape(reason)}" for reason in one["reasons"])
        for role, one in believed.items()
    )
    pictures = []
    for name, view in episode.views.items():
        if view.ids is None:
            continue
        t = episode.length // 2
        image, ids = view.rgb(t).copy(), view.ids(t)
        for role, one in believed.items():
            if one["believed"]:
                inside = np.isin(ids, one["handles"])
                image[inside & grown(~inside, 1)] = OUTLINES[role]
        data = base64.b64encode(encode_png(image)).decode()
        pictures.append(
            f"<figure><img class=whole alt='{html.escape(name)}' src='data:image/png;base64,{data}'>"
            f"<figcaption>{html.escape(name)}, frame {t}</figcaption></figure>"
        )
    return f"<ul class=roles>{lines}</ul><div class=views>{''.join(pictures)}</div>"


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
