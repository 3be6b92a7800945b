"""Make docs/images/strip.webp: one recorded episode beside three copies of it, running, as README shows it.

    python tools/strip.py [--out docs/images/strip.webp]

The twin records the episode (256 pixels a side, shadows, anti-aliased), the shipped recipe `demo` makes the copies.
"""

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image

import rpaug
from rpaug import twin

CAMERAS = ("front", "left_shoulder")
COPIES = (1, 2, 3)
FRAMES, SIDE, SHOWN, GAP, BAND = 30, 256, 236, 4, 24
MILLISECONDS, REST = 110, 900  # of a frame, and of the last one
MOST_BYTES = 2_000_000


def panels(episodes: list[tuple[str, rpaug.Episode]], t: int) -> UInt8[np.ndarray, "h w 3"]:
    """One moment: a column an episode with its name on top, a row a camera."""
    width = len(episodes) * (SHOWN + GAP) - GAP
    whole = np.full((BAND + len(CAMERAS) * (SHOWN + GAP) - GAP, width, 3), 255, np.uint8)
    for column, (name, episode) in enumerate(episodes):
        left = column * (SHOWN + GAP)
        cv2.putText(
            whole,
            name,
            (left + 2, 17),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.55,
            (40, 48, 58),
            1,
            cv2.LINE_AA,
        )
        for row, camera in enumerate(CAMERAS):
            top = BAND + row * (SHOWN + GAP)
            image = cv2.resize(
                episode.views[camera].rgb(t), (SHOWN, SHOWN), interpolation=cv2.INTER_AREA
            )
            whole[top : top + SHOWN, left : left + SHOWN] = image
    return whole


def main() -> None:
    """Raises SystemExit where the picture is too large for a README."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--out", type=Path, default=Path("docs/images/strip.webp"))
    out = asked.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        look = twin.Look(antialias=True, shadows=True)
        twin.record("open_drawer", 5, Path(folder) / "twin", look=look, size=SIDE, frames=FRAMES)
        recorded = rpaug.read(Path(folder) / "twin")
        copies = [(f"copy {n}", rpaug.augment(recorded, "demo", copy=n, seed=12)) for n in COPIES]
        shown = [("recorded", recorded), *copies]
        images = [Image.fromarray(panels(shown, t)) for t in range(recorded.length)]
    times = [MILLISECONDS] * (len(images) - 1) + [REST]
    images[0].save(
        out, save_all=True, append_images=images[1:], duration=times, loop=0, quality=72, method=4
    )
    size = out.stat().st_size
    print(
        f"{out}: {len(images)} frames, {images[0].width} x {images[0].height}, {size / 1e6:.2f} MB"
    )
    if size > MOST_BYTES:
        raise SystemExit(f"{out}: more than {MOST_BYTES / 1e6:g} MB")


if __name__ == "__main__":
    main()
