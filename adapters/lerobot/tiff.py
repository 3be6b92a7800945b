"""The size of a TIFF image by its first directory (TIFF 6.0, section 2), before a decoder allocates for it."""

import struct

from rpaug import BadInput, files

ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
WIDTH, HEIGHT = 256, 257
MOST = 256  # entries of a directory


def is_one(data: bytes) -> bool:
    """Whether the bytes begin as a TIFF file does."""
    return data[:4] in ORDERS


def size(where: str, data: bytes) -> tuple[int, int]:
    """Width and height. Raises BadInput."""
    order = ORDERS[data[:4]]
    found: dict[int, int] = {}
    try:
        (at,) = struct.unpack_from(order + "I", data, 4)
        (count,) = struct.unpack_from(order + "H", data, at)
        for i in range(min(count, MOST)):
            tag, kind, _ = struct.unpack_from(order + "HHI", data, at + 2 + 12 * i)
            value = struct.unpack_from(order + ("H" if kind == 3 else "I"), data, at + 10 + 12 * i)
            found.setdefault(tag, value[0])
    except struct.error:
        raise BadInput(where, "directory", found="a cut-off one", expected="a TIFF") from None
    width, height = found.get(WIDTH, 0), found.get(HEIGHT, 0)
    if not (0 < width <= files.MAX_SIDE and 0 < height <= files.MAX_SIDE):
        expected = f"1 to {files.MAX_SIDE} pixels a side"
        raise BadInput(where, "size", found=f"{width}x{height}", expected=expected)
    return width, height
