"""Arrays that users hand over, held to the shapes, kinds and values that an episode has."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from rpaug.core.errors import BadInput

CAMERA = "front"
"""The name of the camera where images come without one."""

FOCAL = 1.2  # longest sides: what COLMAP assumes of an unknown camera
RIGID = 1e-3  # by which a rotation's columns may miss length 1 and right angles: recorders round


def by_camera(given: Any) -> Mapping[str, Any]:
    """Values by the camera's name; one alone, or a pair, belongs to `front`."""
    if given is None:
        return {}
    return given if isinstance(given, Mapping) else {CAMERA: given}


def colors(where: str, field: str, given: Any) -> UInt8[np.ndarray, "t h w 3"]:
    """Color images, display sRGB 0..255. Raises BadInput."""
    array = np.asarray(given)
    if array.dtype != np.uint8 or array.ndim != 4 or array.shape[3] != 3 or not array.size:
        raise BadInput(where, field, found=_kind(array), expected="uint8 of shape (t, h, w, 3)")
    return array


def depths(
    where: str, field: str, given: Any, shape: tuple[int, ...]
) -> Float32[np.ndarray, "t h w"]:
    """Depth images, metres along the camera's axis, 0 for nothing. Raises BadInput."""
    array = np.asarray(given)
    if array.dtype.kind != "f" or array.shape != shape:
        expected = f"metres, floats of shape {shape}"
        raise BadInput(where, field, found=_kind(array), expected=expected)
    if not np.isfinite(array).all() or (array < 0).any():
        raise BadInput(where, field, found="values below 0 or not finite", expected="metres from 0")
    return array.astype(np.float32)


def masks(where: str, field: str, given: Any, shape: tuple[int, ...]) -> Int32[np.ndarray, "t h w"]:
    """Instance ids, 0 for nothing. Raises BadInput."""
    array = np.asarray(given)
    if array.dtype.kind not in "iu" or array.shape != shape:
        expected = f"instance ids, integers of shape {shape}"
        raise BadInput(where, field, found=_kind(array), expected=expected)
    if (array < 0).any() or (array > np.iinfo(np.int32).max).any():
        raise BadInput(where, field, found="ids out of range", expected="ids from 0, below 2^31")
    return array.astype(np.int32)


def intrinsics(where: str, field: str, given: Any) -> Float64[np.ndarray, "3 3"]:
    """A pinhole camera's matrix in pixels, (0, 0) the centre of the first. Raises BadInput."""
    K = numbers(where, field, given, (3, 3))
    if K[0, 0] <= 0 or K[1, 1] <= 0 or (K[2] != [0, 0, 1]).any():
        expected = "[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with focal lengths above 0"
        raise BadInput(where, field, found=K.tolist(), expected=expected)
    return K


def assumed_intrinsics(width: int, height: int) -> Float64[np.ndarray, "3 3"]:
    """What stands in for an unknown camera's matrix."""
    focal = FOCAL * max(width, height)
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def poses(where: str, field: str, given: Any, length: int) -> Float64[np.ndarray, "t 4 4"]:
    """Rigid motions, one a frame; a single one holds throughout. Raises BadInput."""
    array = np.asarray(given)
    single = array.ndim == 2
    array = numbers(where, field, array, (4, 4) if single else (length, 4, 4))
    array = np.tile(array, (length, 1, 1)) if single else array
    turn = array[:, :3, :3]
    apart = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(initial=0)
    if apart > RIGID or (np.linalg.det(turn) < 0).any() or (array[:, 3] != [0, 0, 0, 1]).any():
        expected = "rigid 4x4 motions: rotations, and [0, 0, 0, 1] as last rows"
        raise BadInput(where, field, found="other matrices", expected=expected)
    return array


def numbers(
    where: str, field: str, given: Any, shape: tuple[int | None, ...]
) -> Float64[np.ndarray, "..."]:
    """Finite numbers of that shape, None for any extent. Raises BadInput."""
    array = np.asarray(given)
    fits = len(array.shape) == len(shape) and all(
        want in (None, size) for want, size in zip(shape, array.shape, strict=False)
    )
    if array.dtype.kind not in "fiub" or not fits:
        listed = ", ".join("any" if want is None else str(want) for want in shape)
        expected = f"numbers of shape ({listed})"
        raise BadInput(where, field, found=_kind(array), expected=expected)
    if not np.isfinite(array).all():
        raise BadInput(where, field, found="values that are not finite", expected="numbers")
    return array.astype(np.float64)


def _kind(array: np.ndarray) -> str:
    return f"{array.dtype} of shape {array.shape}"
