"""Error of sampling each shipped texture on a level board, against the mean of 256 rays a pixel.

    python tools/bench/textures.py [--scale 0.6] [--size 128] [--json]

A camera stands like RLBench's front camera, 1.3 m from the board's middle and 0.8 m above it. Rows are ways to choose
the width that a pixel is averaged over: `point` none; `geometric` depth / focal / sqrt(cosine), the geometric mean of
the footprint's two axes, which the operators use; `longest` depth / focal / cosine; `whole`
like `geometric`, but without the factor by which the sampler narrows every width. Figures are PSNR in dB over the
pixels that see the board: mean over the textures, and the worst one.
"""

import argparse
import json
import sys

import numpy as np

from rpaug.assets.textures import shipped
from rpaug.assets.textures.mapping import WIDTH, Texture
from rpaug.core.metrics import decibels

RAYS = 16  # a pixel's side
EYE, AHEAD = np.array([-1.3, 0.0, 0.8]), np.array([1.3, 0.0, -0.8])
FIELD_OF_VIEW = np.radians(40)
HALF = 0.6  # metres from the middle to the board's sides


def board(size: int, rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Points met on the board's plane, their depth and cosine, one per ray of a square image, and the focal length."""
    focal = size / 2 / np.tan(FIELD_OF_VIEW / 2)
    axis = (np.arange(size * rays) + 0.5) / rays - size / 2
    forward = AHEAD / np.linalg.norm(AHEAD)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    across = axis[None, :, None] / focal * right
    along = axis[:, None, None] / focal * down
    ray = forward + across + along
    depth = -EYE[2] / ray[..., 2]
    cosine = -ray[..., 2] / np.linalg.norm(ray, axis=-1)
    return EYE + depth[..., None] * ray, depth, cosine, float(focal)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scale", type=float, default=0.6)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    size, scale = arguments.size, arguments.scale
    points, depth, cosine, focal = board(size, 1)
    fine = board(size, RAYS)[0]
    seen = (np.abs(points[..., :2]) < HALF).all(-1)
    spots = points[seen].astype(np.float32)
    up = np.broadcast_to(np.float32([0, 0, 1]), spots.shape)
    pixel = (depth / focal)[seen]
    widths = {
        "point": 0 * pixel,
        "geometric": pixel / np.sqrt(cosine[seen]),
        "whole": pixel / np.sqrt(cosine[seen]) / WIDTH,
        "longest": pixel / cosine[seen],
    }
    errors: dict[str, dict[str, float]] = {way: {} for way in widths}
    for name in shipped.NAMES:
        image = shipped.image(name)
        texels = np.floor(fine[..., :2] / scale * [1, -1] * len(image)).astype(int) % len(image)
        rays = image[texels[..., 1], texels[..., 0]].astype(float)
        truth = rays.reshape(size, RAYS, size, RAYS, 3).mean((1, 3))[seen]
        for way, width in widths.items():
            out = Texture.of(image).on(spots, up, width.astype(np.float32), scale, "planar")
            errors[way][name] = decibels(float(((out - truth / 255) ** 2).mean()))
    table = {
        way: {
            "mean": round(float(np.mean(list(found.values()))), 1),
            "worst": round(min(found.values()), 1),
            "worst_texture": min(found, key=lambda name, found=found: found[name]),
        }
        for way, found in errors.items()
    }
    if arguments.json:
        sys.stdout.write(json.dumps(table) + "\n")
        return
    sys.stdout.write(f"{'':12}{'mean dB':>10}{'worst dB':>10}\n")
    for way, row in table.items():
        sys.stdout.write(f"{way:12}{row['mean']:>10}{row['worst']:>10}  {row['worst_texture']}\n")


if __name__ == "__main__":
    main()
