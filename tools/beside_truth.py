"""Make docs/images/beside_truth.webp: recorded, truly changed, rpaug's edit, the best edit of single images, 2D jitter.

    python -m tools.beside_truth [--out docs/images/beside_truth.webp]

A row a factor; decibels are of the changed region over all cameras and frames of this one recording of the twin.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from tools.bench.harness import edits
from tools.bench.harness.edits import EditRow, EditSetting, EditTrial

FACTORS = ("object_color", "table_texture", "light_color")
SETTING = EditSetting(
    factors=FACTORS, tasks=("open_drawer",), seeds=1, frames=11, size=256, antialias=True
)
OURS = "rpaug, estimated"
TWO_D = edits.SINGLE | {edits.LAB, edits.LAB_ESTIMATED}
CAMERA, FRAME = "front", 7
SIDE, GAP, BAND = 212, 4, 22
QUALITY = 85


def chosen(rows: Sequence[EditRow]) -> dict[str, EditRow]:
    """By column: what rpaug makes without being told anything, the best of the single images' edits, and jitter."""
    by_method = {row.method: row for row in rows}
    single = [row for method, row in by_method.items() if method in TWO_D]
    return {
        "rpaug": by_method[OURS],
        "best 2D edit": max(single, key=lambda row: row.scores.psnr),
        "2D jitter": by_method[edits.JITTER],
    }


def strip(trial: EditTrial, rows: Sequence[EditRow]) -> UInt8[np.ndarray, "h w 3"]:
    """A factor's row of tiles, each with its name and decibels on top."""
    tiles = [
        _tile("recorded", trial.recorded.episode.views[CAMERA].rgb(FRAME)),
        _tile("truly changed", trial.true.episode.views[CAMERA].rgb(FRAME)),
    ]
    for name, row in chosen(rows).items():
        image = trial.made[row.method].views[CAMERA].rgb(FRAME)
        tiles.append(_tile(f"{name}: {row.scores.psnr:.1f} dB", image))
    return np.concatenate(tiles, 1)[:, :-GAP]


def _tile(name: str, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    whole = np.full((BAND + SIDE + GAP, SIDE + GAP, 3), 255, np.uint8)
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(whole, name, (2, 15), font, 0.45, (40, 48, 58), 1, cv2.LINE_AA)
    whole[BAND : BAND + SIDE, :SIDE] = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
    return whole


def main() -> None:
    """Writes the picture and prints its figures."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--out", type=Path, default=Path("docs/images/beside_truth.webp"))
    out = asked.parse_args().out
    trials: dict[str, EditTrial] = {}
    rows = edits.run(SETTING, keep=lambda trial: trials.update({trial.factor: trial}))
    strips = []
    for factor in FACTORS:
        own = [row for row in rows if row.factor == factor]
        strips.append(strip(trials[factor], own))
        print(factor, {name: round(row.scores.psnr, 1) for name, row in chosen(own).items()})
    Image.fromarray(np.concatenate(strips)).save(out, quality=QUALITY, method=6)


if __name__ == "__main__":
    main()
