"""The recorded episode that ships with the package, and how it is made."""

from pathlib import Path

from rpaug.twin.record import Take, record

FOLDER = Path(__file__).parents[1] / "sample"
"""A dataset in RLBench's format with one episode of `open_drawer`: five cameras, 128 x 128, 17 frames."""


def rebuild(out: Path | str) -> Take:
    """Record the sample again, under `out`, which must not hold it yet. Needs OpenGL."""
    (take,) = record("open_drawer", 0, Path(out), frames=17)
    return take
