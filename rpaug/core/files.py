"""Files that are either whole or absent, and images that are checked before they are decoded.

`rpaug.files` to whoever writes an adapter, who may rely on the names in `__all__`: `see_inside` for paths of a dataset
before they are read, `read_bytes` and `write_atomic` for whole files, `atomic_folder` for an episode that appears by
one rename, `pass_on` for files that stay as they are, `natural` for the order of keys, `check_*` for the size of an
image before anything is allocated for it, `decode_*` and `encode_*` for its pixels. What cannot be read raises
`BadInput`.
"""

import errno
import os
import re
import shutil
import stat
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core import png
from rpaug.core.cache import PART
from rpaug.core.errors import BadInput
from rpaug.core.png import MAX_SIDE, Png
from rpaug.core.png import check as check_png
from rpaug.core.png import check_pixels as check_png_pixels
from rpaug.core.png import encode as encode_png
from rpaug.core.untouched import BINARY, CHUNK, pass_on

__all__ = [
    "MAX_SIDE",
    "PART",
    "REJECTED",
    "Png",
    "atomic_folder",
    "check_image",
    "check_jpeg",
    "check_png",
    "check_png_pixels",
    "decode_image",
    "decode_png",
    "encode_jpeg",
    "encode_png",
    "flush",
    "natural",
    "pass_on",
    "read_bytes",
    "see_inside",
    "write_atomic",
]

FOLLOW = "RPAUG_FOLLOW_LINKS"  # environment variable: 1 follows links out of a dataset
REPOSITORIES = ("datasets--", "models--", "spaces--")  # how folders of Hugging Face's cache begin
REJECTED = "rejected"  # folder beside the episodes: copies that failed their gates
OPEN = 128  # files that are flushed together: of 1,024 a process may have open, others hold some
UNSYNCED = {
    errno.EINVAL,
    errno.ENOTSUP,
}  # what network and FUSE file systems answer to fsync of a folder
SEGMENT = struct.Struct(">BBH")  # of a JPEG: 0xFF, its kind, its length


def read_bytes(path: Path | str) -> bytes:
    """The whole file. Raises BadInput if it cannot be read, or is none (a pipe would never end)."""
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            found = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, a socket or a device"
            raise BadInput(path, "file", found=found, expected="a regular file")
        descriptor = os.open(path, os.O_RDONLY | BINARY)
        try:
            return _up_to_end(descriptor, status.st_size)
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        raise BadInput(path, "file", found="nothing", expected="a file") from None
    except OSError as error:
        raise BadInput(
            path, "file", found=error.strerror or "an I/O error", expected="a readable file"
        ) from None


def _up_to_end(descriptor: int, size: int) -> bytes:
    # By a descriptor, as `pass_on`: open() asks the system for more.
    data = os.read(descriptor, size + 1)
    if len(data) == size:
        return data
    more = [data]
    while data := os.read(descriptor, CHUNK):
        more.append(data)
    return b"".join(more)


def decode_png(path: Path | str) -> UInt8[np.ndarray, "h w ..."]:
    """The checked image as stored: (h, w, 3) RGB or (h, w) grey, uint8; transparency is dropped. Raises BadInput."""
    return png.decode(path, read_bytes(path))


def check_jpeg(path: Path | str, data: bytes) -> tuple[int, int]:
    """Width and height of a JPEG that runs from its start to its end marker (ITU T.81, annex B). Raises BadInput."""
    if data[:2] != b"\xff\xd8":
        raise BadInput(path, "signature", found=repr(data[:2]), expected="a JPEG file")
    if data.rfind(b"\xff\xd9", -64) < 0:  # some writers pad the end
        raise BadInput(path, "end", found="no end marker", expected="a whole JPEG")
    at = 2
    while at + 9 <= len(data):
        mark, kind, length = SEGMENT.unpack_from(data, at)
        if mark != 0xFF:
            break
        if kind == 0xFF:  # a fill byte
            at += 1
            continue
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            png.check_size(path, width, height)
            return width, height
        at += 2 + length
    raise BadInput(path, "frame header", found="none", expected="a JPEG with a size")


def decode_image(where: Path | str, data: bytes | None = None) -> UInt8[np.ndarray, "h w ..."]:
    """A checked PNG or JPEG: (h, w, 3) RGB or (h, w) single-channel, uint8. Raises BadInput.

    `where` is the file, or, with `data` given, what to call the place that the bytes came from.
    """
    data = read_bytes(Path(where)) if data is None else data
    if data[:2] != b"\xff\xd8":
        return png.decode(where, data)
    check_jpeg(where, data)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise BadInput(where, "image data", found="undecodable data", expected="a JPEG image")
    return np.ascontiguousarray(image[..., ::-1])


def check_image(where: Path | str, data: bytes) -> tuple[int, int]:
    """Width and height of a whole PNG or JPEG. Raises BadInput."""
    if data[:2] == b"\xff\xd8":
        return check_jpeg(where, data)
    if data[: len(png.SIGNATURE)] != png.SIGNATURE:
        raise BadInput(where, "signature", found=repr(data[:8]), expected="a PNG or a JPEG")
    header = check_png(where, data)
    return header.width, header.height


def encode_jpeg(image: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """JPEG bytes of an RGB image at the best quality with full chroma: what was not edited comes back nearly as it was
    (docs/why/files.md#jpeg)."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY, 100,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]  # fmt: skip
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), options)
    if not done:
        raise ValueError(f"cannot encode an image of shape {image.shape}, {image.dtype}")
    return data.tobytes()


def apart(target: Path, source: Path) -> None:
    """See that an output does not lie in the dataset that it is made from. Raises BadInput."""
    if target.resolve().is_relative_to(source.resolve()):
        expected = "a path outside it: what lies in it is read as part of it"
        raise BadInput(target, "--out", found="a path inside the dataset", expected=expected)


def see_inside(root: Path, *paths: Path) -> None:
    """See that no link takes paths of a dataset out of it, unless the user follows such links. Raises BadInput."""
    for path in paths:
        if (real := leads_out(root, path)) is not None:
            expected = f"a file within {root} ({FOLLOW}=1 follows links)"
            raise BadInput(path, "link", found=f"a link to {real}", expected=expected)


def leads_out(root: Path, path: Path) -> str | None:
    """Where a path of a dataset leads if links take it out of it; None if it stays, or if the user follows such links.

    The dataset's root may be a link itself. Where that lies in a snapshot in Hugging Face's cache, whose files are
    links, the files of the same repository are inside.
    """
    if os.environ.get(FOLLOW) == "1":
        return None
    real, home = os.path.realpath(path), Path(os.path.realpath(root))
    inside = any(Path(real).is_relative_to(one) for one in (home, *_blobs(home)))
    return None if inside else real


def _blobs(home: Path) -> Iterator[Path]:
    """`<repository>/blobs` of a folder at or below `<repository>/snapshots/<revision>`."""
    for snapshots in (above.parent for above in (home, *home.parents)):
        if snapshots.name == "snapshots" and snapshots.parent.name.startswith(REPOSITORIES):
            yield snapshots.parent / "blobs"


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """A temporary folder beside `target` that becomes `target` in one rename if the block succeeds, after what it holds
    is on the disk: a power cut leaves it whole or absent.

    On any failure (a full disk among them) the temporary folder is removed and `target` never appears. Raises
    BadInput if `target` exists already.
    """
    if target.exists():
        raise BadInput(
            target, "output", found="something there already", expected="a path that does not exist"
        )
    made = partial(tempfile.mkdtemp, PART, f".{target.name}-", target.parent)
    try:
        work = Path(made())
    except FileNotFoundError:  # the first there
        target.parent.mkdir(parents=True, exist_ok=True)
        work = Path(made())
    try:
        work.chmod(0o755)
        yield work
        flush_folder(work)
        os.replace(work, target)
        flush(target.parent)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        raise


def natural(key: str) -> str:
    """For sorting: numbers in a key count as numbers. One string a key, since a run sorts hundred thousands of them."""
    return "\0".join(
        part if not part.isdecimal() else f"{len(str(int(part))):04d}{int(part)}"
        for part in re.split(r"(\d+)", key)
    )


def flush_folder(folder: Path) -> None:
    """See all that a folder holds onto the disk. Hundreds are asked for before the first is waited for: a twentieth of
    the time."""
    inside = (os.path.join(root, name) for root, _, names in os.walk(folder) for name in names)
    while some := list(islice(inside, OPEN)):
        descriptors = list[int]()
        try:
            for path in some:
                descriptors.append(os.open(path, os.O_RDONLY))
                if hasattr(os, "posix_fadvise"):  # not everywhere
                    os.posix_fadvise(descriptors[-1], 0, 0, os.POSIX_FADV_DONTNEED)
            for descriptor in descriptors:
                os.fsync(descriptor)
        finally:
            for descriptor in descriptors:
                os.close(descriptor)
    for root, _, _ in os.walk(folder, topdown=False):
        flush(root)


def flush(path: Path | str) -> None:
    """See a file's bytes, or a folder's entries, onto the disk; the latter where the file system can do that."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in UNSYNCED or not stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise
    finally:
        os.close(descriptor)


def write_atomic(target: Path, data: bytes, durable: bool = False) -> None:
    """Write a file so that it is either the old one or the whole new one; a `durable` one after a power cut as well."""
    target.parent.mkdir(parents=True, exist_ok=True)
    descriptor, work = tempfile.mkstemp(prefix=f".{target.name}-", suffix=PART, dir=target.parent)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            if durable:
                stream.flush()
                os.fsync(stream.fileno())
        os.chmod(work, 0o644)
        os.replace(work, target)
    except BaseException:
        Path(work).unlink(missing_ok=True)
        raise


def write_changed(target: Path, data: bytes) -> None:
    """Write a file as `write_atomic` does, durable; one that holds just that stays untouched."""
    if not (target.is_file() and target.stat().st_size == len(data) and read_bytes(target) == data):
        write_atomic(target, data, durable=True)
