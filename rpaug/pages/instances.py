"""What an episode holds as a page: each camera with outlines and names, roles with why, a table of all instances."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core.types import Episode
from rpaug.core.visible import quoted
from rpaug.pages.document import color_of, document, facts, figure, jpeg, outlined, png
from rpaug.pipeline import role_facts
from rpaug.pipeline.inspect import measured, recorded_frames
from rpaug.scene.targets.survey import InstanceSummary

MARGIN, THUMBNAIL = 4, 96  # pixels around an instance's thumbnail, and of its height on the page
SPREAD = 0.1, 0.35, 0.6, 0.85  # of a video: where its frames are shown
HEIGHT, TALLEST = 480, 640  # pixels of an outlined image: at least, by whole factors, and at most


def page(episode: Episode, described: Mapping[str, Any], rows: Sequence[InstanceSummary]) -> bytes:
    """The page of what `inspect` found: `described` its plain values, `rows` one summary per instance."""
    given = html.escape
    names, recorded = labels(rows), recorded_frames(described)
    notes = [*(f"not understood: {words}" for words in described["unread"]), *described["assumed"]]
    notes += [f"{name}: {words}" for name, words in described["misplaced"].items()]
    body = (
        f"<h1>{given(quoted(described['instruction']))}</h1>"
        f"{facts(_facts(described, rows))}"
        f"{''.join(f'<p class=bad>{given(words)}</p>' for words in notes)}"
        f"<div class='views large'>{''.join(_views(episode, names, recorded))}</div>"
        f"{_roles(described)}<h2>Instances</h2><div class=scroll tabindex=0><table><tr><th><th>handle<th>role<th>color"
        f"<th>size, {'cm' if measured(described) else 'relative'}<th>motion<th>residual, mm<th>seen in frames</tr>"
        f"{''.join(_row(episode, row, names[row.instance_id][1], recorded) for row in rows)}</table></div>"
        f"<h2>Cameras</h2><ul class=told>{''.join(_cameras(described))}</ul>"
    )
    return document(f"rpaug inspect: {described['episode']}", body)


def labels(rows: Sequence[InstanceSummary]) -> dict[int, tuple[str, tuple[int, int, int]]]:
    """The name that an image shows of each instance, and the color of its outline. Of an arm's links the one that most
    is seen of is named."""
    links = [row for row in rows if row.role == "robot"]
    named = max(links, key=lambda row: sum(row.pixels.values()), default=None)
    return {
        row.instance_id: (
            ""
            if row in links and row is not named
            else f"{row.role or row.color_name} {row.instance_id}",
            color_of(n, row.role),
        )
        for n, row in enumerate(rows)
    }


def _facts(
    described: Mapping[str, Any], rows: Sequence[InstanceSummary]
) -> list[tuple[str, object]]:
    kinds = sorted({kind for one in described["cameras"].values() for kind in one["images"]})
    return [
        ("episode", described["episode"]),
        ("frames", described["frames"]),
        ("key frames", ", ".join(map(str, described["key_frames"])) or "none"),
        ("cameras", len(described["cameras"])),
        ("images", ", ".join(kinds)),
        ("instances", len(rows)),
    ]


def _cameras(described: Mapping[str, Any]) -> list[str]:
    return [
        f"<li>{html.escape(name)}: {c['width']}×{c['height']}, focal length {c['focal']:.0f} px, "
        f"{'fixed' if c['fixed'] else 'moving'}, {', '.join(c['images'])}"
        for name, c in described["cameras"].items()
    ]


def _roles(described: Mapping[str, Any]) -> str:
    """Which instances have which role, and why that is believed."""
    lines = "".join(
        f"<li><span class=dot style='background:rgb{color_of(0, role)}'></span><b>{role}</b>: "
        f"{', '.join(map(str, one['handles'])) or 'none'}{role_facts.sure(one)}"
        + "".join(f"<br><span class=soft>{html.escape(reason)}</span>" for reason in one["reasons"])
        for role, one in described.get("roles", {}).items()
    )
    return f"<h2>Roles</h2><ul class=told>{lines}</ul>" if lines else ""


def _views(
    episode: Episode,
    names: Mapping[int, tuple[str, tuple[int, int, int]]],
    recorded: Sequence[int],
) -> list[str]:
    """One frame a camera, every instance outlined and named; the frame alone where there are no ids. Of a video, which
    shows other things at other times, a few."""
    found, last = [], episode.length - 1
    for name, view in episode.views.items():
        of_a_video = view.inferred and not view.camera.fixed
        pack = jpeg if of_a_video else png
        for share in SPREAD if of_a_video else (0.5,):
            t = round(share * last)
            image = _reduced(view.rgb(t), TALLEST)
            if view.ids is not None:
                scale = max(1, -(-HEIGHT // image.shape[0]))
                image = outlined(
                    image, _reduced(view.ids(t), TALLEST, cv2.INTER_NEAREST), names, scale
                )
            found.append(figure(pack(image), name, f"{name}, frame {recorded[t]}"))
    return found


def _reduced(image: np.ndarray, most: int, how: int = cv2.INTER_AREA) -> np.ndarray:
    """At most so many pixels high: names on it can be read, and a page of a video's images is sent."""
    size = max(1, round(most * image.shape[1] / image.shape[0])), most
    return cv2.resize(image, size, interpolation=how) if image.shape[0] > most else image


def _row(
    episode: Episode,
    row: InstanceSummary,
    color: tuple[int, int, int],
    recorded: Sequence[int],
) -> str:
    size = " × ".join(f"{side:.1f}" for side in row.size_cm) if any(row.size_cm) else "unknown"
    shown = ",".join(str(round(255 * channel)) for channel in row.color)
    return (
        f"<tr><td>{_thumbnail(episode, row)}<td><span class=dot style='background:rgb{color}'></span>"
        f"{row.instance_id}<td>{row.role or '–'}"
        f"<td><span class=dot style='background:rgb({shown})'></span>{row.color_name}<td>{size}"
        f"<td>{row.motion}{' (ambiguous)' if row.ambiguous else ''}<td>{row.residual_mm:.2f}"
        f"<td>{row.frames} ({recorded[row.first_frame]}–{recorded[row.last_frame]})"
    )


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
    height = min(THUMBNAIL, 3 * len(best[1]))
    shown = png(_reduced(best[1], 2 * THUMBNAIL))  # screens show two pixels for one
    return f"<img alt='instance {row.instance_id}' src='{shown}' height={height}>"
