"""Every instance in one row: what it does, how it looks, how large it is, how it moves, where it is seen."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from jaxtyping import Float64, Int64

from rpaug.core import color_space, sampling, white
from rpaug.core.memo import of_episode, once
from rpaug.core.progress import told
from rpaug.core.types import Body, Episode
from rpaug.scene.sampled_frames import MOST_PIXELS, look
from rpaug.scene.targets.observed import surface
from rpaug.scene.targets.roles import NAMES

COLOR_FRAMES = 6  # looked at for color: it hardly changes
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class InstanceSummary:
    """One instance id. `role` is "" where none is known; `motion` and `ambiguous` are its body's.

    `color` is display sRGB in 0..1, `size_cm` length, width (the tightest upright box) and height of what
    was seen, `residual_mm` the track's median distance, `body` the instance ids that move with it. `pixels` counts
    pixels per camera over all frames, `first_frame` to `last_frame` with `frames` of them showing it.
    """

    instance_id: int
    role: str
    color: Rgb
    color_name: str
    size_cm: tuple[float, float, float]
    motion: str
    ambiguous: bool
    residual_mm: float
    body: frozenset[int]
    frames: int
    first_frame: int
    last_frame: int
    pixels: Mapping[str, int]

    @property
    def moving(self) -> bool:
        return self.motion != "static"

    def __str__(self) -> str:
        length, width, height = self.size_cm
        role = f", {self.role}" if self.role else ""
        if not any(self.size_cm):
            return f"{self.instance_id} ({self.color_name}{role})"
        return f"{self.instance_id} ({self.color_name}{role}, {length:.0f} x {width:.0f} x {height:.0f} cm)"


@once
def survey(
    episode: Episode,
    bodies: Sequence[Body],
    roles: Mapping[str, frozenset[int]],
) -> tuple[InstanceSummary, ...]:
    """One row for each instance id of `bodies`, ascending."""
    sampled = look(episode)
    body_of = {instance_id: body for body in bodies for instance_id in body.instance_ids}
    role_of = {instance_id: role for role in reversed(NAMES) for instance_id in roles.get(role, ())}
    role_of |= dict.fromkeys(roles.get("table", ()), "table")
    instance_ids = sorted(body_of)
    seen = counts(episode, tuple(instance_ids))
    tints = _colors(episode, tuple(instance_ids))
    rows = []
    for i, instance_id in enumerate(instance_ids):
        body, tint = body_of[instance_id], tints.get(instance_id, (0.0, 0.0, 0.0))
        when = np.flatnonzero(seen[:, i].any(-1))
        rows.append(
            InstanceSummary(
                instance_id,
                role_of.get(instance_id, ""),
                tint,
                _name(episode, tint),
                size_cm(surface(sampled, instance_id, body)[0]),
                body.motion,
                body.ambiguous,
                body.residual * 1e3,
                body.instance_ids,
                len(when),
                int(when[0]) if len(when) else 0,
                int(when[-1]) if len(when) else 0,
                {name: int(seen[:, i, c].sum()) for c, name in enumerate(_with_ids(episode))},
            )
        )
    return tuple(rows)


def color_names(episode: Episode, instance_ids: Iterable[int]) -> dict[int, str]:
    """The word for the recorded color of each of these instances that an image shows."""
    found = _colors(episode, tuple(sorted(instance_ids)))
    return {one: _name(episode, tint) for one, tint in found.items()}


def _name(episode: Episode, tint: Rgb) -> str:
    """The word for a recorded color; in photographs, which masks are not recorded of, in their own light."""
    if any(view.inferred for view in episode.views.values()):
        tint = white.in_white_light(episode, tint)
    return color_space.nearest(np.array(tint))


def size_cm(points: Float64[np.ndarray, "n 3"]) -> tuple[float, float, float]:
    """Length, width and height of the tightest upright box around all but the outermost percent."""
    if not len(points):
        return (0.0, 0.0, 0.0)
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    inner = points[((points >= low) & (points <= high)).all(-1)]
    inner = inner if len(inner) else points
    box = cv2.minAreaRect(inner[:, :2].astype(np.float32))[1]
    return (100 * max(box), 100 * min(box), 100 * float(np.ptp(inner[:, 2])))


def _with_ids(episode: Episode) -> list[str]:
    return [name for name, view in episode.views.items() if view.ids is not None]


@of_episode
def counts(episode: Episode, instance_ids: tuple[int, ...]) -> Int64[np.ndarray, "t n c"]:
    """How many pixels show each of these ascending instance ids, by frame and camera that has ids."""
    names, asked = _with_ids(episode), np.array(instance_ids, np.int32)
    out = np.zeros((episode.length, len(instance_ids), len(names)), np.int64)
    for c, name in enumerate(names):
        read = episode.views[name].ids
        assert read is not None
        for t in range(episode.length):
            done = c * episode.length + t
            told(episode.key, "measuring instances", done, episode.length * len(names))
            found, count = np.unique(read(t), return_counts=True)
            at = np.searchsorted(asked, found)
            known = at < len(instance_ids)
            known[known] = asked[at[known]] == found[known]
            out[t, at[known], c] = count[known]
    return out


@of_episode
def _colors(episode: Episode, instance_ids: tuple[int, ...]) -> dict[int, Rgb]:
    """Typical colors over a few frames and all cameras, of the instances that are seen."""
    found: dict[int, list[np.ndarray]] = {instance_id: [] for instance_id in instance_ids}
    if any(episode.views[name].depth is not None for name in _with_ids(episode)):
        _thinned(episode, found)
    else:
        _alone(episode, found)
    tints = {one: color_space.typical(np.concatenate(seen)) for one, seen in found.items() if seen}
    return {one: (float(tint[0]), float(tint[1]), float(tint[2])) for one, tint in tints.items()}


def _alone(episode: Episode, found: Mapping[int, list[np.ndarray]]) -> None:
    """Adds pixels of a few frames of all cameras, where no depth is looked at."""
    for _, _, rgb, ids in sampling.images(episode, COLOR_FRAMES):
        if ids is None:
            continue
        flat, image = ids.reshape(-1), rgb.reshape(-1, 3)
        order = np.argsort(flat, kind="stable")
        names, starts = np.unique(flat[order], return_index=True)
        for instance_id, rows in zip(names.tolist(), np.split(order, starts[1:]), strict=True):
            if instance_id in found:
                found[instance_id].append(image[rows])


def _thinned(episode: Episode, found: Mapping[int, list[np.ndarray]]) -> None:
    """Adds pixels of a few of the sampled frames, thinned as those are; of more for what these do not show."""
    sampled = look(episode)
    spread = np.unique(np.linspace(0, len(sampled.frames) - 1, COLOR_FRAMES).round().astype(int))
    for chosen in (spread, np.setdiff1d(np.arange(len(sampled.frames)), spread)):
        missing = [instance_id for instance_id, pixels in found.items() if not pixels]
        for s, (c, name) in product(chosen.tolist() if missing else (), enumerate(sampled.cameras)):
            view, ids = episode.views[name], sampled.ids[s, c]
            shown = [instance_id for instance_id in missing if (ids == instance_id).any()]
            if shown:
                step = max(1, round(view.camera.width / MOST_PIXELS))
                image = view.rgb(int(sampled.frames[s]))[::step, ::step]
                ids = ids[: image.shape[0], : image.shape[1]]
                for instance_id in shown:
                    found[instance_id].append(image[ids == instance_id])
