"""Gaussians as an `.spz` file, Niantic's compressed layout, a quarter of a `.ply` or less; web viewers open it.

Version 3 (github.com/nianticlabs/spz, README): a gzip stream of a 16-byte header, then all positions, opacities,
colors, scales, rotations and higher harmonics. Axes are right, up, back where a `.ply` of 3DGS has right, down, front:
y and z change sign, so that a viewer shows both files alike. Instance ids have no place in it.
"""

import gzip
import struct
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from rpaug.core.errors import Unsupported
from rpaug.core.types import Gaussians

MAGIC, VERSION = 0x5053474E, 3  # "NGSP"
MOST_BITS, POSITION_BITS = 16, 23  # of the fraction: 15 µm; of a whole coordinate without its sign
COLOR_SCALE = 0.15
COARSE = (8, 16)  # steps of harmonics of band 1 and beyond, of 256
# Signs of the harmonics of bands 1 to 3 where y and z change sign.
TURNED = (-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1)
LARGEST = np.sqrt(0.5)  # a component that is not the largest is at most this
ORDER = (1, 2, 3, 0)  # (w, x, y, z) as (x, y, z, w)


def encoded(gaussians: Gaussians) -> bytes:
    """The bytes of the file. Raises Unsupported where a Gaussian lies farther off than its numbers reach."""
    degree = int(np.sqrt(gaussians.sh.shape[1])) - 1
    positions = gaussians.means.astype(np.float64) * (1, -1, -1)
    bits = _fraction(positions)
    header = struct.pack("<IIIBBBB", MAGIC, VERSION, len(gaussians), degree, bits, 0, 0)
    harmonics = gaussians.sh[:, 1:] * np.array(TURNED[: gaussians.sh.shape[1] - 1])[:, None]
    steps = np.where(np.arange(len(TURNED)) < 3, *COARSE)[: harmonics.shape[1], None]
    parts: Sequence[np.ndarray] = (
        np.round(positions * 2**bits).astype("<i4").view(np.uint8).reshape(-1, 4)[:, :3],
        _bytes(gaussians.opacities * 255.0),
        _bytes(gaussians.sh[:, 0] * (COLOR_SCALE * 255) + 127.5),
        _bytes((np.log(np.maximum(gaussians.scales, 1e-30)) + 10) * 16),
        _rotations(gaussians.quats.astype(np.float64)[:, ORDER]),
        _coarse(harmonics, steps),
    )
    return gzip.compress(header + b"".join(part.tobytes() for part in parts), mtime=0)


def _fraction(positions: Float[np.ndarray, "n 3"]) -> int:
    """How many bits of a coordinate are its fraction: as many as leave room for the farthest Gaussian."""
    far = float(np.abs(positions).max(initial=0))
    bits = min(MOST_BITS, POSITION_BITS - 1 - int(np.ceil(np.log2(max(far, 1e-9)))))
    if bits < 0:
        raise Unsupported(f".spz: a Gaussian lies {far:.3g} m off; the layout reaches 4194 km")
    return bits


def _bytes(values: np.ndarray) -> UInt8[np.ndarray, "..."]:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def _coarse(values: np.ndarray, step: np.ndarray) -> UInt8[np.ndarray, "..."]:
    """Harmonics in -1..1 as multiples of their steps, 128 for 0: fewer values pack smaller."""
    levels = np.round(values * 128) + 128
    return np.clip((levels + step // 2) // step * step, 0, 255).astype(np.uint8)


def _rotations(quats: Float[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 4"]:
    """Of (x, y, z, w) which is largest in 2 bits, and each of the others in 10: its sign and 9 bits."""
    quats = quats * (1, -1, -1, 1) / np.linalg.norm(quats, axis=1, keepdims=True)
    largest = np.abs(quats).argmax(1)
    quats = quats * np.where(np.take_along_axis(quats, largest[:, None], 1) < 0, -1, 1)
    levels = np.floor(np.abs(quats) / LARGEST * 511 + 0.5).astype(np.uint32)
    packed = largest.astype(np.uint32)
    for axis in range(4):
        one = (packed << 10) | ((quats[:, axis] < 0).astype(np.uint32) << 9) | levels[:, axis]
        packed = np.where(largest == axis, packed, one)
    return packed.astype("<u4").view(np.uint8).reshape(-1, 4)
