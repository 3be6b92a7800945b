"""What shape a thing has, told from recorded surface points: block, box, cylinder, cup, bowl, ball or pad.

Thresholds hold for points within about a millimetre of things of some centimetres, seen from two sides or more.
"""

import numpy as np
from jaxtyping import Float64

from rpaug.scene.targets.survey import size_cm

# Words that people use for a measured shape. A "box" may be solid or open.
WORDS: dict[str, frozenset[str]] = {
    **dict.fromkeys(("block", "cube", "brick", "cuboid"), frozenset({"block"})),
    **dict.fromkeys(("box",), frozenset({"box", "block"})),
    **dict.fromkeys(("container", "bin", "crate", "tray", "basket"), frozenset({"box", "bowl"})),
    **dict.fromkeys(("cylinder", "can", "tin", "bottle", "roll"), frozenset({"cylinder"})),
    **dict.fromkeys(("cup", "mug", "glass", "beaker", "tumbler"), frozenset({"cup"})),
    **dict.fromkeys(("bowl", "dish"), frozenset({"bowl"})),
    **dict.fromkeys(("pot", "pan"), frozenset({"cup", "bowl"})),
    **dict.fromkeys(("ball", "sphere", "orange", "marble"), frozenset({"ball"})),
    **dict.fromkeys(
        ("pad", "plate", "mat", "patch", "coaster", "sheet", "tile", "slab"), frozenset({"pad"})
    ),
}
FEWEST = 40  # points from which a shape is told
LARGEST = 0.25  # metres: what is longer is furniture, of no shape
THIN = 0.035  # metres: what is lower, and four times as wide, is a pad
SIDE = 0.5  # |z| of a normal, at most, on a side face
NEAR = np.deg2rad(12.0)  # of an axis of a box
SHALLOW = 2.2  # diameters over height, from which a cup is a bowl


def shape(points: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"]) -> str:
    """One of the shapes above, or "" where none is told. z points up; normals towards whoever looked."""
    known = np.linalg.norm(normals, axis=-1) > 0.5
    points, normals = points[known], normals[known]
    if len(points) < FEWEST:
        return ""
    low, high = np.percentile(points, [1, 99], axis=0)
    length, width, height = (side / 100 for side in size_cm(points))
    if max(length, height) > LARGEST:
        return ""
    if height < THIN and width > 4 * height:
        return "pad"
    if _is_ball(points, normals):
        return "ball"
    sides = np.abs(normals[:, 2]) < SIDE
    if sides.sum() < FEWEST // 2:
        return ""
    at, out = points[sides, :2], normals[sides, :2]
    out = out / np.linalg.norm(out, axis=-1, keepdims=True)
    open_top = _is_open(points, normals, low, high)
    if _boxlike(out) > 0.75:
        return "box" if open_top else "block"
    if not _is_round(at, out):
        return ""
    if not open_top:
        return "cylinder"
    return "bowl" if length > SHALLOW * height else "cup"


def _boxlike(out: Float64[np.ndarray, "n 2"]) -> float:
    """The share of horizontal normals along two axes at a right angle, for the best such axes."""
    turn = np.arctan2(out[:, 1], out[:, 0])
    tries = np.deg2rad(np.arange(0, 90, 3.0))
    off = np.abs((turn[:, None] - tries + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    return float((off < NEAR).mean(0).max())


def _is_round(at: Float64[np.ndarray, "n 2"], out: Float64[np.ndarray, "n 2"]) -> bool:
    """Do the normals meet in one axis, at which all points are about as far?"""
    away = at - _meeting(at, out)
    radius = np.linalg.norm(away, axis=-1)
    along = np.abs((away * out).sum(-1)) / np.maximum(radius, 1e-9)
    return bool(np.median(along) > 0.95 and radius.std() < 0.25 * radius.mean())


def _is_ball(points: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"]) -> bool:
    """Do the normals meet in one point, at which all points are equally far, and point up as well as aside?"""
    away = points - _meeting(points, normals)
    radius = np.linalg.norm(away, axis=-1)
    along = np.abs((away * normals).sum(-1)) / np.maximum(radius, 1e-9)
    slanted = (np.abs(normals[:, 2]) > 0.3) & (np.abs(normals[:, 2]) < 0.85)
    return bool(
        radius.std() < 0.08 * radius.mean() and np.median(along) > 0.95 and slanted.mean() > 0.25
    )


def _meeting(
    points: Float64[np.ndarray, "n d"], directions: Float64[np.ndarray, "n d"]
) -> Float64[np.ndarray, "d"]:
    """The point nearest to all lines through `points`, least squares."""
    across = np.eye(points.shape[1]) - directions[:, :, None] * directions[:, None]
    system = across.sum(0) + 1e-9 * np.eye(points.shape[1])
    return np.linalg.solve(system, np.einsum("nij,nj->i", across, points))


def _is_open(
    points: Float64[np.ndarray, "n 3"],
    normals: Float64[np.ndarray, "n 3"],
    low: Float64[np.ndarray, "3"],
    high: Float64[np.ndarray, "3"],
) -> bool:
    """Is the inner half of the top, seen from above, lower than the rim by a fifth of the height or more?"""
    middle, half = (low + high)[:2] / 2, (high - low)[:2] / 2
    inner = (np.abs(points[:, :2] - middle) < 0.5 * half).all(-1) & (normals[:, 2] > SIDE)
    if inner.sum() < 3:
        return False
    return bool(np.median(points[inner, 2]) < high[2] - 0.2 * (high[2] - low[2]))
