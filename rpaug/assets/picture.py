"""One thing drawn by itself, to see what it looks like."""

import numpy as np
from jaxtyping import UInt8

from rpaug.core.types import Mesh
from rpaug.render import mesh as triangles

BACKDROP = 235
LIGHT = np.array([0.35, -0.5, 0.79])


def portrait(thing: Mesh, side: int = 256) -> UInt8[np.ndarray, "side side 3"]:
    """The thing from the front on a light ground, `side` pixels wide and high."""
    seen = drawn(thing, side)
    shade = 0.45 + 0.55 * np.maximum(seen.normals @ LIGHT, 0)
    image = np.full((side, side, 3), BACKDROP, np.uint8)
    color = np.clip(seen.albedo * shade[..., None], 0, 1)
    image[seen.hit] = np.rint(255 * color[seen.hit]).astype(np.uint8)
    return image


def drawn(thing: Mesh, side: int, towards: float = 1.0) -> triangles.MeshView:
    """The thing seen a little from above, from the front and the right, or (`towards` -1) from the opposite side."""
    middle = (thing.points.min(0) + thing.points.max(0)) / 2
    reach = float(np.linalg.norm(np.ptp(thing.points, axis=0)))
    eye = middle + 2.2 * reach * np.array([0.45 * towards, -0.75 * towards, 0.48])
    ahead = (middle - eye) / np.linalg.norm(middle - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([right, np.cross(ahead, right), ahead], 1), eye
    K = np.array([[1.9 * side, 0, (side - 1) / 2], [0, 1.9 * side, (side - 1) / 2], [0, 0, 1.0]])
    return triangles.draw(thing, np.eye(4), K, pose, (side, side))
