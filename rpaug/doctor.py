"""Whether this machine can do what rpaug does, one finding a line."""

import importlib.metadata
import os
import platform
import subprocess
import sys
from dataclasses import dataclass

from rpaug import __version__, registry

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


@dataclass(frozen=True)
class Finding:
    """`level` is "ok", "note" (something optional is missing) or "bad" (rpaug cannot work)."""

    level: str
    topic: str
    message: str


def examine() -> list[Finding]:
    """All findings, without starting anything that could hang."""
    findings = [
        Finding(
            "ok",
            "rpaug",
            f"{__version__} on Python {platform.python_version()}, {os.cpu_count()} cores",
        )
    ]
    for package in REQUIRED:
        try:
            findings.append(Finding("ok", package, importlib.metadata.version(package)))
        except importlib.metadata.PackageNotFoundError:
            findings.append(Finding("bad", package, "not installed: pip install rpaug brings it"))
    for group, names in (
        ("operators", registry.operator_names()),
        ("adapters", registry.adapter_names()),
    ):
        level = "ok" if names else "bad"
        findings.append(
            Finding(
                level,
                group,
                ", ".join(names) or "none: reinstall rpaug, its entry points are missing",
            )
        )
    return [*findings, _gl(), _gpu(), _cache()]


def _gl() -> Finding:
    """Tried in a process of its own: a broken driver may end the one that asks."""
    program = "from rpaug.twin.renderer import open_gl; open_gl(8)"
    tried = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    if tried.returncode == 0:
        return Finding("ok", "OpenGL", "the twin can render")
    lines = tried.stderr.strip().splitlines() or ["no reason was given"]
    return Finding("note", "OpenGL", lines[-1])


def _gpu() -> Finding:
    import torch

    if torch.cuda.is_available():
        return Finding("ok", "GPU", torch.cuda.get_device_name(0))
    return Finding("note", "GPU", "none that torch can use; everything runs on the CPU")


def _cache() -> Finding:
    from rpaug.render.jit import cache_folder

    place = cache_folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
        writable = os.access(place, os.W_OK)
    except OSError:
        writable = False
    if writable:
        return Finding("ok", "kernel cache", str(place))
    return Finding(
        "note", "kernel cache", f"{place} is not writable: kernels compile anew in every process"
    )
