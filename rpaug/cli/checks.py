"""Whether this machine can do what rpaug does, one finding a line; and its kernels, compiled ahead."""

import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from rpaug.core import registry
from rpaug.core.version import __version__

REQUIRED = (
    "numpy",
    "numba",
    "torch",
    "opencv-contrib-python-headless",
    "mujoco",
    "zarr",
    "pydantic",
    "av",
)

FEATURES = (0, 16)
"""Blended beside the colors: none, and an identity encoding. Each count has kernels of its own."""

COLOR_AND_DEPTH = 4


@dataclass(frozen=True)
class Check:
    """`level` is "ok", "note" (something optional is missing) or "bad" (rpaug cannot work)."""

    level: str
    topic: str
    message: str


def examine() -> list[Check]:
    """All findings, without starting anything that could hang."""
    findings = [
        Check(
            "ok",
            "rpaug",
            f"{__version__} on Python {platform.python_version()}, {os.cpu_count()} cores",
        )
    ]
    for package in REQUIRED:
        try:
            findings.append(Check("ok", package, importlib.metadata.version(package)))
        except importlib.metadata.PackageNotFoundError:
            findings.append(Check("bad", package, "not installed: pip install rpaug brings it"))
    for group, names in (
        ("operators", registry.operator_names()),
        ("adapters", registry.adapter_names()),
    ):
        level = "ok" if names else "bad"
        findings.append(
            Check(
                level,
                group,
                ", ".join(names) or "none: reinstall rpaug, its entry points are missing",
            )
        )
    return [*findings, _gl(), _gpu(), _cache()]


def _gl() -> Check:
    """Tried in a process of its own: a broken driver may end the one that asks."""
    program = "from rpaug.twin.renderer import open_gl; open_gl(8)"
    tried = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    if tried.returncode == 0:
        return Check("ok", "OpenGL", "the twin can render")
    lines = tried.stderr.strip().splitlines() or ["no reason was given"]
    return Check("note", "OpenGL", lines[-1])


def _gpu() -> Check:
    import torch

    if torch.cuda.is_available():
        return Check("ok", "GPU", torch.cuda.get_device_name(0))
    return Check("note", "GPU", "none that torch can use; everything runs on the CPU")


def _cache() -> Check:
    from rpaug.core.jit import cache_folder

    place = cache_folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
        writable = os.access(place, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        return Check(
            "note",
            "kernel cache",
            f"{place} is not writable: kernels compile anew in every process",
        )
    sizes = [path.stat().st_size for path in (place / "kernels").rglob("*.nbc")]
    if not sizes:
        return Check("note", "kernel cache", f"{place}: empty; rpaug doctor --warm fills it")
    held = f"{len(sizes)} kernels, {sum(sizes) / 1e6:.0f} MB"
    return Check("ok", "kernel cache", f"{place}: {held}")


@dataclass(frozen=True)
class Warmed:
    """What was made ready, and how long that took: seconds on the wall, and of the processor.

    `channels` is the number of values that the Gaussians' kernels blend into a pixel, None for other kernels.
    """

    name: str
    channels: int | None
    seconds: float
    cpu_seconds: float


def warm(
    features: Sequence[int] = FEATURES,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[Warmed]:
    """Compile the kernels, or load them from the cache; a second call in another process finds them there.

    First those of recorded pixels and surfels, then those of Gaussians, once for each number of features. Raises
    Unsupported for more features than the rasteriser takes.
    """
    from rpaug.render.splat import warm as splat_kernels

    jobs: list[tuple[str, int | None, Callable[[], None]]] = [
        ("recorded pixels and surfels", None, _edit_the_sample)
    ]
    for count in features:
        name = f"Gaussians, {count} features" if count else "Gaussians, color and depth"
        jobs.append((name, COLOR_AND_DEPTH + count, partial(splat_kernels, count)))
    for number, (name, channels, job) in enumerate(jobs):
        progress(number, len(jobs))
        wall, cpu = time.perf_counter(), time.process_time()
        job()
        yield Warmed(name, channels, time.perf_counter() - wall, time.process_time() - cpu)
    progress(len(jobs), len(jobs))


def _edit_the_sample() -> None:
    """One frame of the sample through every kernel of the main job: recolored, and seen from a moved camera."""
    from rpaug.pipeline import plan, prepare, recipe
    from rpaug.pipeline.copies import PreparedEpisode, draw_copy

    episode = registry.read(registry.SAMPLE, None)
    for edit in (
        {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"},
        {"op": "camera_pose", "camera": "front"},
    ):
        asked = recipe.build({"version": 1, "edits": [edit]})
        made = plan.make(prepare.operators(asked), episode)
        prepared = PreparedEpisode(prepare.prepare(episode, made), made, asked)
        for view in draw_copy(prepared, 1).episode.views.values():
            view.rgb(0)
