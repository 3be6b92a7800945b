"""Whether this machine can do what rpaug does, one finding a line; and its kernels, compiled ahead."""

import importlib.metadata
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from rpaug.core import devices, registry
from rpaug.core.version import __version__

EXTRAS = {
    "fast": "PNG files packed and read in half the time",
    "models": "models of your own that segment, detect, estimate depth",
    "lerobot": "reading and writing LeRobot datasets",
    "words": "synonyms in targets and wishes, sentence vectors made anew",
    "cuda": "Gaussians on a CUDA GPU by gsplat",
}
"""What the optional packages are for."""

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
    findings += _packages()
    for group, names in (
        ("operators", registry.operator_names()),
        ("adapters", registry.adapter_names()),
    ):
        level = "ok" if names else "bad"
        findings.append(
            Check(
                level,
                group,
                ", ".join(names)
                or "none: its entry points are missing; mend it: pip install --force-reinstall --no-deps rpaug",
            )
        )
    return [*findings, _gl(), *_gpu(), _cache()]


def _packages() -> list[Check]:
    """The packages that rpaug requires, and those of its extras, each with the line that brings what is missing."""
    needed: dict[str | None, list[str]] = {None: [], **{extra: [] for extra in EXTRAS}}
    for stated in importlib.metadata.requires("rpaug") or ():
        line, _, marker = stated.partition(";")
        found = re.search(r"extra == ['\"](\w+)['\"]", marker)
        group = found[1] if found else None
        if group in needed:
            needed[group].append(line.strip())
    lacking = {
        group: [one for one in lines if _version(one) is None] for group, lines in needed.items()
    }
    missing = lacking.pop(None)
    held = [f"{_name(one)} {_version(one)}" for one in needed[None] if one not in missing]
    findings = [Check("ok", "packages", ", ".join(held))]
    if missing:
        listed = " ".join(f"'{one}'" for one in missing)
        names = ", ".join(map(_name, missing))
        findings.append(
            Check("bad", "packages", f"missing: {names}; mend it: pip install {listed}")
        )
    for extra, lines in lacking.items():
        if lines:
            words = f"{EXTRAS[str(extra)]}: missing {', '.join(map(_name, lines))}"
            findings.append(
                Check("note", f"extra {extra}", f"{words}; pip install 'rpaug[{extra}]' brings it")
            )
        else:
            findings.append(Check("ok", f"extra {extra}", EXTRAS[str(extra)]))
    return findings


def _name(requirement: str) -> str:
    """`numpy` of `numpy>=2.0`."""
    return re.split(r"[<>=!~ \[]", requirement, maxsplit=1)[0]


def _version(requirement: str) -> str | None:
    """The version that is installed, None if none is."""
    try:
        return importlib.metadata.version(_name(requirement))
    except importlib.metadata.PackageNotFoundError:
        return None


def _gl() -> Check:
    """Tried in a process of its own: a broken driver may end the one that asks."""
    program = "from rpaug.twin.renderer import open_gl; open_gl(8)"
    tried = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    if tried.returncode == 0:
        return Check("ok", "OpenGL", "the twin can render")
    lines = tried.stderr.strip().splitlines() or ["no reason was given"]
    return Check(
        "note", "OpenGL", f"only the twin needs it: {lines[-1].partition(': ')[2] or lines[-1]}"
    )


def _gpu() -> Iterator[Check]:
    """All that fits on a GPU take, one a line; none is needed."""
    parts = list(devices.parts())
    for part in parts:
        yield Check("ok" if part.found else "note", part.name, str(part))
    whole = all(part.found for part in parts)
    fits = "Gaussians are fitted on the GPU" if whole else "none is needed: the CPU fits Gaussians"
    yield Check("ok", "GPU", fits)


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
            f"{place} is not writable: kernels compile anew in every process; mend it: export RPAUG_CACHE=FOLDER",
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
