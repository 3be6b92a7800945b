"""Processor seconds against the size of what is augmented: a model fitted to small runs and held against others.

    python -m tools.bench.cost_size [--repeats 3] [--record]

Recordings of one camera with depth and masks are made in many sizes (frames, pixels) and augmented with one to three
edits and one or three copies. The model is linear:

    start + episodes * (frame_read * F + megapixel_read * M + copies * (frame * F + megapixel * M + edit * E * M))

with F images of an episode, M their megapixels and E edits. It is fitted by least squares of relative errors, no term
below 0, and held against runs of `CHECKED`, which the fit never saw. What 10^6 episodes take is extrapolated with the
spread of fits to resampled runs (95 % of 1000).
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from tools.bench.harness import filmed, pages

EDITS = (
    {"op": "recolor", "target": {"handle": 2}, "color": "blue"},
    {"op": "retexture", "target": {"handle": 1}, "texture": "oak"},
    {"op": "recolor", "target": {"handle": 3}, "color": "green"},
)
TERMS = ("a start", "an image read", "a megapixel read", "an image of a copy",
         "a megapixel of a copy", "an edit of a megapixel")  # fmt: skip
RESAMPLED, MILLION = 1000, 1_000_000


@dataclass(frozen=True)
class Size:
    """What a run is given: images of one episode, their width and height, edits of each, copies."""

    frames: int
    width: int
    height: int
    edits: int = 1
    copies: int = 1

    def counts(self, episodes: int = 1) -> Float64[np.ndarray, "6"]:
        """How many of each term a run of so many episodes takes."""
        megapixels = self.frames * self.width * self.height / 1e6
        copied = np.array([self.frames, megapixels, self.edits * megapixels]) * self.copies
        return np.array([1.0, *(episodes * np.array([self.frames, megapixels, *copied]))])

    def __str__(self) -> str:
        return (
            f"{self.frames} x {self.width}x{self.height}, {self.edits} edits, {self.copies} copies"
        )


FITTED = tuple(
    Size(frames, width, width * 3 // 4, edits, copies)
    for (frames, width), edits, copies in product(
        ((20, 64), (120, 64), (20, 320), (60, 320)), (1, 3), (1, 3)
    )
)
CHECKED = (Size(40, 128, 128, 2, 2), Size(100, 256, 256, 1, 4), Size(30, 640, 480, 3, 2))
ROBOTS = Size(625, 128, 128, 3, 4)  # an RLBench episode of 125 frames and five cameras


@cache
def dataset(folder: Path, frames: int, width: int, height: int) -> Path:
    """A recording of that size, made once."""
    return filmed.written(folder / f"{frames}_{width}_{height}", frames, width, height)


def spent(folder: Path, size: Size, repeats: int) -> float:
    """Processor seconds of `rpaug augment`, the least of several runs."""
    source = dataset(folder, size.frames, size.width, size.height)
    recipe = folder / "recipe.yaml"
    edits = list(EDITS[: size.edits])
    recipe.write_text(json.dumps({"version": 1, "copies": size.copies, "edits": edits}))
    found = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory(dir=folder) as out:
            command = [
                sys.executable,
                "-m",
                "rpaug",
                "augment",
                str(source),
                "--recipe",
                str(recipe),
            ]
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(
                [*command, "--out", str(Path(out, "out")), "--json"],
                check=True,
                stdout=subprocess.DEVNULL,
                env=os.environ | {"OMP_NUM_THREADS": "1"},
            )
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(found)


def fit(
    counts: Float64[np.ndarray, "n 6"], seconds: Float64[np.ndarray, "n"]
) -> Float64[np.ndarray, "6"]:
    """The terms whose relative errors are least, none below 0: those that would be are left out one by one."""
    scaled, kept = counts / seconds[:, None], np.ones(counts.shape[1], bool)
    terms = np.zeros(counts.shape[1])
    while True:
        terms[:] = 0
        terms[kept] = np.linalg.lstsq(scaled[:, kept], np.ones(len(seconds)), rcond=None)[0]
        if (terms >= 0).all():
            return terms
        kept[int(np.argmin(terms))] = False


def spread(
    counts: Float64[np.ndarray, "n 6"],
    seconds: Float64[np.ndarray, "n"],
    asked: Float64[np.ndarray, "6"],
) -> tuple[float, float]:
    """Where 95 % of the fits to resampled runs put what is asked."""
    rng = np.random.default_rng(0)
    rows = (rng.integers(len(seconds), size=len(seconds)) for _ in range(RESAMPLED))
    said = [asked @ fit(counts[one], seconds[one]) for one in rows]
    low, high = np.percentile(said, [2.5, 97.5])
    return float(low), float(high)


def main() -> None:
    """Measure, fit, check, print or record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="into docs/benchmarks/cost.md")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spent(folder, Size(4, 64, 48, 3), 1)  # kernels are compiled and kept
        found = {size: spent(folder, size, given.repeats) for size in (*FITTED, *CHECKED)}
    counts = np.array([size.counts() for size in FITTED])
    seconds = np.array([found[size] for size in FITTED])
    terms = fit(counts, seconds)
    model = [[name, round(float(value), 4)] for name, value in zip(TERMS, terms, strict=True)]
    checked = []
    for size in CHECKED:
        said = float(size.counts() @ terms)
        off = f"{100 * (said / found[size] - 1):+.0f} %"
        checked.append([str(size), round(found[size], 1), round(said, 1), off])
    many = ROBOTS.counts(MILLION)
    low, high = (one / 3600 for one in spread(counts, seconds, many))
    hours = [[str(ROBOTS), round(float(many @ terms) / 3600), f"{low:.0f} to {high:.0f}"]]
    tables = (
        ("size_terms", "The terms, fitted to 16 runs", ["term", "processor s"], model),
        ("size_check", "Runs that the fit never saw", ["run", "processor s", "said", "off by"], checked),
        ("million", "10^6 episodes, extrapolated", ["each", "core hours", "95 %"], hours),
    )  # fmt: skip
    for key, title, columns, rows in tables:
        sys.stdout.write(f"{title}\n" + "".join(f"  {row}\n" for row in rows))
        if given.record:
            table = pages.Table(
                id=key,
                title=title,
                command="python -m tools.bench.cost_size",
                seeds=f"least of {given.repeats} runs each",
                columns=columns,
                rows=rows,
                **pages.stamp(),
            )
            pages.record("cost_size", table)


if __name__ == "__main__":
    main()
