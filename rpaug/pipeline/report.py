"""What was done to an episode: enough to judge it, and to do exactly that again."""

import io
import json
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Int32, UInt8

from rpaug.core.pixels import differing
from rpaug.core.version import __version__

NAME = "rpaug.json"
HOLES = "rpaug_holes.npz"
SUMMARY = "rpaug.summary.json"
CONTACT_SHEET = "rpaug.contact.html"


@dataclass
class Tally:
    """Counts what changes while frames are rendered; safe to use from several threads.

    `moving` are, by moved camera and frame, the pixels that show what moves: those that nobody recorded, and all.

    `added` are instance ids that edits brought in; of each `shown` keeps, by camera, the frame whose mask has most of
    it and how many pixels those are.
    """

    cameras: list[str]
    added: frozenset[int] = frozenset()
    shown: dict[tuple[int, str], tuple[int, int]] = field(default_factory=dict)
    changed: dict[tuple[str, int], int] = field(default_factory=dict)
    total: dict[tuple[str, int], int] = field(default_factory=dict)
    levels: dict[tuple[str, int], float] = field(default_factory=dict)
    outside: dict[tuple[str, int], int] = field(default_factory=dict)
    areas: dict[tuple[str, frozenset[int]], dict[int, int]] = field(default_factory=dict)
    holes: dict[str, Bool[np.ndarray, "h w"]] = field(default_factory=dict)
    moving: dict[tuple[str, int], tuple[int, int]] = field(default_factory=dict)
    seconds: float = 0.0
    lock: Any = field(default_factory=Lock)

    def frame(
        self,
        camera: str,
        t: int,
        before: UInt8[np.ndarray, "h w 3"],
        after: UInt8[np.ndarray, "h w 3"],
        seconds: float,
    ) -> None:
        """Count the pixels of one frame whose color changed and by how many grey levels, once however often it is
        rendered, and add up the thread seconds."""
        differs = int(np.count_nonzero(differing(before, after)))
        levels = float(sum(cv2.sumElems(cv2.absdiff(before, after)))) / 3 if differs else 0.0
        with self.lock:
            self.seconds += seconds
            self.changed[camera, t] = differs
            self.levels[camera, t] = levels
            self.total[camera, t] = before.shape[0] * before.shape[1]

    def hole(self, camera: str, t: int, mask: Bool[np.ndarray, "h w"]) -> None:
        """Keep one frame's mask of pixels nobody ever saw."""
        with self.lock:
            self.holes[f"{camera}/{t}"] = mask

    def mask(self, camera: str, t: int, ids: Int32[np.ndarray, "h w"]) -> None:
        """Count what the mask of one frame shows of the added instances."""
        for instance_id in self.added:
            pixels = int((ids == instance_id).sum())
            with self.lock:
                frame, most = self.shown.get((instance_id, camera), (0, 0))
                if (pixels, -t) > (most, -frame):
                    self.shown[instance_id, camera] = t, pixels

    def summary(self) -> dict[str, Any]:
        """Changed and invented pixels per camera, and of each added instance where it shows most."""
        changed = {name: _sum(self.changed, name) for name in self.cameras}
        total = {name: max(_sum(self.total, name), 1) for name in self.cameras}
        out: dict[str, Any] = {
            "changed_pixels": changed,
            "changed_share": {name: round(n / total[name], 6) for name, n in changed.items()},
            "mean_change": {
                name: round(_sum(self.levels, name) / total[name], 3) for name in self.cameras
            },
        }
        if self.holes:
            per_camera: dict[str, list[float]] = {}
            for key, mask in self.holes.items():
                per_camera.setdefault(key.rsplit("/", 1)[0], []).append(float(mask.mean()))
            out["hole_share"] = {
                k: round(float(np.mean(v)), 6) for k, v in sorted(per_camera.items())
            }
        if self.added:
            out["added"] = {
                str(instance_id): {
                    camera: list(self.shown[instance_id, camera])
                    for camera in self.cameras
                    if (instance_id, camera) in self.shown
                }
                for instance_id in sorted(self.added)
            }
        return out

    def area(self, camera: str, t: int, instance_ids: frozenset[int], pixels: int) -> None:
        """Keep how many pixels of one frame show what one edit paints."""
        with self.lock:
            self.areas.setdefault((camera, instance_ids), {})[t] = pixels

    def hole_file(self) -> bytes:
        """All hole masks as a compressed `.npz` with fixed dates, so that the same masks give the same bytes."""
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for key in sorted(self.holes):
                data = io.BytesIO()
                np.save(data, np.packbits(self.holes[key], axis=1), allow_pickle=False)
                archive.writestr(
                    zipfile.ZipInfo(f"{key}.npy"), data.getvalue(), zipfile.ZIP_DEFLATED
                )
        return buffer.getvalue()


def _sum(counts: Mapping[tuple[str, int], int | float], camera: str) -> float:
    """Over all frames of one camera, in their order: threads end in any."""
    return sum(counts[one] for one in sorted(counts) if one[0] == camera)


def change(given: Mapping[str, Any], camera: str) -> str:
    """How much of one camera's images changed, in words; earlier reports say no mean."""
    share = f"{100 * given['changed_share'].get(camera, 0.0):.1f} % of pixels changed"
    mean = given.get("mean_change", {}).get(camera)
    return share if mean is None else f"{share}, by {mean:.1f} of 255 levels over all"


class Stopwatch:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


def side_files(
    *,
    source: str,
    copy: int,
    synthetic: bool,
    recipe: dict[str, Any],
    draws: Sequence[dict[str, Any]],
    repainted: Mapping[int, str],
    plan: dict[str, Any],
    tally: Tally,
    surfels: int,
    gaussians: int,
    gates: dict[str, Any] | None,
    words: dict[str, Any] | None,
    roles: dict[str, Any],
    physics: dict[str, Any],
    seconds: dict[str, float],
) -> dict[str, bytes]:
    """The report, and the hole masks where a camera moved. All but `seconds` is the same for the same seed.

    `physics` says whether the recorded actions still hold, where things were simulated.

    `seconds` are wall seconds, but for `render`: the seconds threads spent on decoding and rendering frames, which
    is part of `write`.
    """
    described = {
        "rpaug": __version__,
        "synthetic": synthetic,
        "source": source,
        "copy": copy,
        "seed": recipe.get("seed", 0),
        "recipe": recipe,
        "draws": list(draws),
        **({"repainted": {str(one): word for one, word in repainted.items()}} if repainted else {}),
        "plan": plan,
        "surfels": surfels,
        "gaussians": gaussians,
        **tally.summary(),
        **({"words": words} if words else {}),
        **({"roles": roles} if roles else {}),
        **physics,
        **({"gates": gates} if gates else {}),
        "seconds": {stage: round(value, 4) for stage, value in seconds.items()},
    }
    files = {NAME: encode(described)}
    if tally.holes:
        files[HOLES] = tally.hole_file()
    return files


def encode(described: dict[str, Any]) -> bytes:
    """UTF-8 JSON, indented, keys in the order given."""
    return (json.dumps(described, indent=1, ensure_ascii=False) + "\n").encode()


def of(folder: Path) -> dict[str, Any] | None:
    """The report in an episode's folder; None where there is none that can be read."""
    try:
        given = json.loads((folder / NAME).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return given if isinstance(given, dict) else None


def summary(root: Path) -> dict[str, Any] | None:
    """The summary of an output; None where there is none that can be read."""
    try:
        given = json.loads((root / SUMMARY).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return given if isinstance(given, dict) else None


def synthetic(root: Path, key: str) -> bool:
    """Whether an episode of a dataset is one that rpaug made."""
    return bool((of(root / key) or {}).get("synthetic"))
