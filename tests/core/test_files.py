"""Files that are whole or absent, and images checked before decoding."""

import os
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug import BadInput
from rpaug.core.files import (
    atomic_folder,
    check_png,
    decode_png,
    encode_png,
    natural,
    read_bytes,
    write_atomic,
)

IMAGE = np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def test_an_image_survives_encoding(tmp_path: Path) -> None:
    for image in (IMAGE, IMAGE[..., 0]):
        path = tmp_path / "image.png"
        path.write_bytes(encode_png(image))
        assert np.array_equal(decode_png(path), image)
        assert encode_png(image) == encode_png(image)


@given(st.integers(0, len(encode_png(IMAGE)) - 1))
def test_a_cut_off_image_is_refused_wherever_it_ends(length: int) -> None:
    with pytest.raises(BadInput, match=r"image\.png"):
        check_png(Path("image.png"), encode_png(IMAGE)[:length])


@given(st.integers(8, len(encode_png(IMAGE)) - 1), st.integers(1, 255))
def test_a_changed_byte_is_noticed(place: int, change: int) -> None:
    data = bytearray(encode_png(IMAGE))
    data[place] ^= change
    with pytest.raises(BadInput):
        check_png(Path("image.png"), bytes(data))


def test_a_huge_size_is_refused_before_anything_is_allocated() -> None:
    header = struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IEND", b"")
    with pytest.raises(BadInput, match="2147483647x2147483647"):
        check_png(Path("image.png"), data)


def test_valid_chunks_with_wrong_pixels_inside_are_refused(tmp_path: Path) -> None:
    header = struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)
    path = tmp_path / "image.png"
    for body in (b"not zlib", zlib.compress(b"too short")):
        data = chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + data)
        with pytest.raises(BadInput, match=r"image\.png"):
            decode_png(path)


def test_sixteen_bit_images_are_refused_by_name(tmp_path: Path) -> None:
    import cv2

    path = tmp_path / "image.png"
    path.write_bytes(cv2.imencode(".png", np.zeros((3, 3), np.uint16))[1].tobytes())
    with pytest.raises(BadInput, match="16 bits"):
        decode_png(path)


def test_a_folder_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b"

    def fail() -> None:
        with atomic_folder(target) as work:
            (work / "half").write_text("x")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not list((tmp_path / "a").iterdir())
    with atomic_folder(target) as work:
        (work / "whole").write_text("x")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["whole"]
    with pytest.raises(BadInput, match="does not exist"), atomic_folder(target):
        pass


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    write_atomic(tmp_path / "x", b"1")
    write_atomic(tmp_path / "x", b"2")
    assert (tmp_path / "x").read_bytes() == b"2"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_pipe_or_a_folder_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "3.png")
    with pytest.raises(BadInput, match=r"3\.png.*a pipe, a socket or a device.*a regular file"):
        read_bytes(tmp_path / "3.png")
    with pytest.raises(BadInput, match="a folder"):
        read_bytes(tmp_path)


@pytest.mark.parametrize("durable", [False, True])
def test_what_is_written_is_whole(tmp_path: Path, durable: bool) -> None:
    for data in (b"one", b"other"):
        write_atomic(tmp_path / "report.json", data, durable)
        assert (tmp_path / "report.json").read_bytes() == data
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


def test_an_image_of_too_many_pixels_is_refused_before_it_is_decoded() -> None:
    header = struct.pack(">IIBBBBB", 16384, 16384, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IEND", b"")
    with pytest.raises(BadInput, match=r"size: found 16384x16384; .* at most 67108864 in all"):
        check_png("large.png", data)


def test_a_file_is_never_half_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who reads meanwhile reads the old one to its end, and what fails leaves the old one."""
    path = tmp_path / "a.json"
    write_atomic(path, b"old" * 50_000)
    with path.open("rb") as reading:
        assert reading.read(3) == b"old"
        write_atomic(path, b"new")
        assert reading.read() == b"old" * 49_999
    assert path.read_bytes() == b"new"

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write_atomic(path, b"newer")
    assert [(one.name, one.read_bytes()) for one in tmp_path.iterdir()] == [("a.json", b"new")]


@given(st.lists(st.text("ab/._-9081\u0663", max_size=8), max_size=12))
def test_numbers_in_keys_count_as_numbers(keys: list[str]) -> None:
    def parts(key: str) -> list[tuple[int, str]]:
        found = re.split(r"(\d+)", key)
        return [(int(part), "") if part.isdecimal() else (-1, part) for part in found]

    assert sorted(keys, key=natural) == sorted(keys, key=parts)
