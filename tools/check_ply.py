"""Does an independent reader agree with our .ply and .spz files? Needs node; run by hand, not in CI.

    npm install --prefix FOLDER @playcanvas/splat-transform
    python tools/check_ply.py FOLDER/node_modules/.bin/splat-transform

SuperSplat's own converter reads Gaussians of SH degree 0 to 3 that we wrote, turns and shifts them (which mixes the
harmonics within each band), and writes them again. What our rasteriser draws of its file, from a camera moved along,
must be what it draws of ours. Of an .spz it must read what we wrote, to half a step of its coarse numbers.
"""

import argparse
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpaug.core.types import Gaussians
from rpaug.gaussians import gaussian_files, ply
from rpaug.render.splat import render

HALF_STEP = 8.5 / 128  # of a harmonic beyond band 1 in an .spz
AGREE = 1e-4  # of full color: float32 through logarithms and logits


def some(bands: int, count: int = 200) -> Gaussians:
    rng = np.random.default_rng(bands)
    return Gaussians(
        rng.uniform(-0.3, 0.3, (count, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        rng.uniform(5e-3, 5e-2, (count, 3)).astype(np.float32),
        rng.uniform(0.05, 0.95, count).astype(np.float32),
        rng.normal(0, 0.5, (count, bands, 3)).astype(np.float32),
        rng.integers(0, 200, count).astype(np.int32),
    )


def check(tool: Path, bands: int, folder: Path) -> tuple[float, float]:
    """The largest difference of any color, and how much the higher harmonics matter in this picture."""
    ours, theirs = folder / f"ours{bands}.ply", folder / f"theirs{bands}.ply"
    given = some(bands)
    gaussian_files.write(ours, given)
    subprocess.run(
        [tool.absolute(), "-q", ours, "-r", "30,-20,50", "-t", "0.1,0.2,0.3", theirs], check=True
    )
    back = ply.read(theirs)
    np.testing.assert_array_equal(back.ids, given.ids)
    moved = np.eye(4)
    moved[:3] = np.linalg.lstsq(np.c_[given.means, np.ones(len(given))], back.means, rcond=None)[
        0
    ].T
    K, eye = np.array([[120, 0, 63.5], [0, 120, 63.5], [0, 0, 1.0]]), np.eye(4)
    eye[2, 3] = 1.5
    first = render(given, K, eye, 128, 128, background=0.5).color
    second = render(back, K, eye @ np.linalg.inv(moved), 128, 128, background=0.5).color
    plain = render(replace(given, sh=given.sh[:, :1]), K, eye, 128, 128, background=0.5).color
    return float(np.abs(first - second).max()), float(np.abs(first - plain).max())


def check_spz(tool: Path, bands: int, folder: Path) -> float:
    """The largest difference of any position, in metres, and of any harmonic from half of its step."""
    ours, theirs = folder / f"ours{bands}.spz", folder / f"from_spz{bands}.ply"
    given = some(bands)
    given.sh[:] = given.sh.clip(-0.9, 0.9)
    gaussian_files.write(ours, given)
    subprocess.run([tool.absolute(), "-q", ours, theirs], check=True)
    back = ply.read(theirs)
    coarse = np.abs(back.sh - given.sh).max() - HALF_STEP
    return float(max(np.abs(back.means - given.means).max(), coarse))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tool", type=Path, help="the splat-transform command")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for degree in range(4):
            off, matter = check(given.tool, (degree + 1) ** 2, Path(folder))
            print(
                f"SH degree {degree}: colors differ by {off:.1e}; without higher bands by {matter:.2f}"
            )
            apart = check_spz(given.tool, (degree + 1) ** 2, Path(folder))
            print(f"  .spz: {apart:.1e} apart")
            if off > AGREE or apart > AGREE:
                raise SystemExit("they disagree")


if __name__ == "__main__":
    main()
