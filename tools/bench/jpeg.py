"""What encoding a decoded JPEG again costs, by quality and chroma sampling.

    RPAUG_TEST_DATA=... python tools/bench/jpeg.py [--images 36] [--json FILE]

Takes images of the RLDS sample (`rlds_bridge`) and encodes them unedited: the share of pixels that stay the same, PSNR,
the largest difference in levels, and the size relative to the recorded file.
"""

import argparse
import json
import os
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from rpaug.core.metrics import psnr
from rpaug.core.registry import adapter

SAMPLINGS = {
    "4:2:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
    "4:4:4": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
}


def recorded(root: Path, count: int) -> list[bytes]:
    """The encoded images of the first episodes, a few a camera, none of them blank."""
    reader, found = adapter("rlds"), []
    for key in reader.episodes(root):
        source = reader.read(root, key).source
        for leaf in source.images.values():
            blobs = source.example.blobs(leaf.key)
            found += [data for data in islice(blobs, 3) if decoded(data).max() > 32]
    return found[:count]


def decoded(data: bytes) -> np.ndarray:
    """The image, channels as OpenCV has them."""
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def measure(images: list[bytes], quality: int, sampling: int) -> dict[str, float]:
    """Figures of one way to encode, over all images."""
    same, error, most, size = [], [], 0, []
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    for data in images:
        before = decoded(data)
        again = cv2.imencode(".jpg", before, options)[1].tobytes()
        off = decoded(again).astype(int) - before
        same.append((off == 0).all(-1).mean())
        error.append((off.astype(float) ** 2).mean())
        most = max(most, int(np.abs(off).max()))
        size.append(len(again) / len(data))
    return {
        "same": float(np.mean(same)),
        "psnr": psnr(float(np.mean(error))),
        "most": most,
        "size": float(np.mean(size)),
    }


def main() -> None:
    """Measure every combination and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--images", type=int, default=36)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    images = recorded(Path(os.environ["RPAUG_TEST_DATA"]) / "rlds_bridge", given.images)
    rows = []
    for name, sampling in SAMPLINGS.items():
        for quality in (90, 95, 98, 99, 100):
            rows.append({"chroma": name, "quality": quality, **measure(images, quality, sampling)})
            print(
                "{quality:4d} {chroma}  same {same:.2f}  {psnr:.1f} dB  most {most:2d}  size {size:.2f}".format(
                    **rows[-1]
                )
            )
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
