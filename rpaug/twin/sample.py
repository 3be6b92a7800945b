"""The recorded episode that ships with the package, and how it is made."""

from pathlib import Path

from rpaug.twin.record import record
from rpaug.twin.truth import Truth

FOLDER = Path(__file__).parents[1] / "sample"
"""A dataset in RLBench's format with one episode of `open_drawer`: five cameras, 128 x 128, 17 frames."""


def rebuild(out: Path) -> list[Truth]:
    """Record the sample again, under `out`, which must not hold it yet. Needs OpenGL."""
    return record("open_drawer", 0, out, frames=17)
