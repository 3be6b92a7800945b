"""Gaussians as a file that other programs open: `.ply` of 3DGS, or `.spz`, by the file's ending."""

from pathlib import Path

from rpaug.core.errors import BadInput
from rpaug.core.files import write_atomic
from rpaug.core.types import Gaussians
from rpaug.gaussians import ply, spz

LAYOUTS = {".ply": ply.encoded, ".spz": spz.encoded}


def check(path: Path) -> None:
    """Raises BadInput if the file exists, or has another ending."""
    if path.suffix.lower() not in LAYOUTS:
        raise BadInput(
            path, "output", found=path.suffix or "no ending", expected=" or ".join(LAYOUTS)
        )
    if path.exists():
        raise BadInput(path, "output", found="something there already", expected="a new file")


def write(path: Path, gaussians: Gaussians) -> None:
    """Write Gaussians as they are: place them in the world first (`gaussians.placed`). Atomic. Raises BadInput."""
    check(path)
    write_atomic(path, LAYOUTS[path.suffix.lower()](gaussians))
