"""Gaussians as a `.ply` file in the layout of 3DGS (Kerbl et al. 2023), which viewers and trimesh open.

One vertex a Gaussian, binary little-endian float32: x y z nx ny nz, f_dc_0..2, f_rest_* (all of red, then
green, then blue), opacity as a logit, scale_0..2 as natural logarithms of metres, rot_0..3 as (w, x, y, z).
One integer property more, `id`, holds the instance id; viewers skip it.
"""

from pathlib import Path

import numpy as np

from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes
from rpaug.core.types import Gaussians

NEARLY_ONE = 1e-6  # opacities are kept this far from 0 and 1, where a logit is infinite
MOST_HEADER = 1 << 16  # bytes
DEGREES = (0, 9, 24, 45)  # f_rest properties of SH degree 0 to 3
SIZES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4",
    "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip


def _layout(bands: int) -> np.dtype:
    floats = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    floats += [f"f_rest_{i}" for i in range(3 * (bands - 1))]
    floats += ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    return np.dtype([(name, "<f4") for name in floats] + [("id", "<i4")])


def encoded(gaussians: Gaussians) -> bytes:
    """The bytes of the file."""
    bands = gaussians.sh.shape[1]
    rows = np.zeros(len(gaussians), _layout(bands))
    for i, axis in enumerate("xyz"):
        rows[axis] = gaussians.means[:, i]
        rows[f"f_dc_{i}"] = gaussians.sh[:, 0, i]
        rows[f"scale_{i}"] = np.log(np.maximum(gaussians.scales[:, i], 1e-30))
        for k in range(bands - 1):
            rows[f"f_rest_{i * (bands - 1) + k}"] = gaussians.sh[:, 1 + k, i]
    for i in range(4):
        rows[f"rot_{i}"] = gaussians.quats[:, i]
    inside = np.clip(gaussians.opacities.astype(np.float64), NEARLY_ONE, 1 - NEARLY_ONE)
    rows["opacity"] = np.log(inside / (1 - inside))
    rows["id"] = gaussians.ids
    kinds = {"f": "float", "i": "int"}
    properties = "".join(
        f"property {kinds[rows.dtype[name].kind]} {name}\n" for name in rows.dtype.names or ()
    )
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{properties}end_header\n"
    return header.encode() + rows.tobytes()


def read(path: Path) -> Gaussians:
    """Gaussians of a 3DGS file, as they are in it; instance ids are 0 where it has no `id`. Raises BadInput."""
    data = read_bytes(path)
    end = data[:MOST_HEADER].find(b"end_header\n")
    if not data.startswith(b"ply\n") or end < 0:
        raise BadInput(path, "header", found=repr(data[:16]), expected="a .ply file")
    count, layout = _header(path, data[:end].decode("ascii", "replace").splitlines())
    body = data[end + len(b"end_header\n") :]
    if len(body) != count * layout.itemsize:
        raise BadInput(
            path, "length", found=f"{len(body)} bytes", expected=f"{count * layout.itemsize} bytes"
        )
    rows = np.frombuffer(body, layout)
    names = set(layout.names or ())
    missing = set(_layout(1).names or ()) - names - {"id", "nx", "ny", "nz"}
    if missing:
        raise BadInput(
            path, "properties", found=f"no {', '.join(sorted(missing))}", expected="the 3DGS layout"
        )
    rest = sum(name.startswith("f_rest_") for name in names)
    if rest not in DEGREES:
        raise BadInput(
            path, "f_rest", found=f"{rest} of them", expected="0, 9, 24 or 45: SH degree 0 to 3"
        )
    rest //= 3

    def columns(*wanted: str) -> np.ndarray:
        return np.stack([rows[name].astype(np.float32) for name in wanted], -1)

    sh = columns(*(f"f_dc_{i}" for i in range(3)))[:, None]
    if rest:
        more = columns(*(f"f_rest_{i}" for i in range(3 * rest)))
        sh = np.concatenate([sh, more.reshape(count, 3, rest).swapaxes(1, 2)], 1)
    with np.errstate(over="ignore"):  # exp(-logit) of a closed one is infinite, and its opacity 0
        found = Gaussians(
            means=columns("x", "y", "z"),
            quats=columns(*(f"rot_{i}" for i in range(4))),
            scales=np.exp(columns(*(f"scale_{i}" for i in range(3)))),
            opacities=1 / (1 + np.exp(-rows["opacity"].astype(np.float32))),
            sh=np.ascontiguousarray(sh),
            ids=rows["id"].astype(np.int32) if "id" in names else np.zeros(count, np.int32),
        )
    for name in ("means", "quats", "scales", "opacities", "sh"):
        values = getattr(found, name)
        broken = ~np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
        if broken.any():
            what = (
                f"{broken.sum()} Gaussians that are not finite, the first in row {broken.argmax()}"
            )
            raise BadInput(path, name, found=what, expected="finite numbers")
    return found


def _header(path: Path, lines: list[str]) -> tuple[int, np.dtype]:
    """Vertex count and row layout. Raises BadInput for anything but one element of plain numbers."""
    count, fields = -1, []
    for line in lines[1:]:
        words = line.split()
        match words:
            case ["format", kind, _] if kind != "binary_little_endian":
                raise BadInput(path, "format", found=kind, expected="binary_little_endian")
            case ["element", "vertex", number] if number.isdigit() and count < 0:
                count = int(number)
            case ["element", *_]:
                raise BadInput(path, "elements", found=line, expected="one element, vertex")
            case ["property", kind, name] if kind in SIZES:
                fields.append((name, "<" + SIZES[kind]))
            case ["property", *_]:
                raise BadInput(path, "property", found=line, expected="a plain number")
    if count < 0 or not fields:
        raise BadInput(
            path, "header", found="no vertices", expected="element vertex with properties"
        )
    return count, np.dtype(fields)
