"""PNG files are held against OpenCV's own decoder, and damaged ones are refused."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug import BadInput
from rpaug.core import png
from rpaug.core.files import decode_png

IMAGE = np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3)
FILTERS = [
    cv2.IMWRITE_PNG_FILTER_NONE, cv2.IMWRITE_PNG_FILTER_SUB, cv2.IMWRITE_PNG_FILTER_UP,
    cv2.IMWRITE_PNG_FILTER_AVG, cv2.IMWRITE_PNG_FILTER_PAETH, cv2.IMWRITE_PNG_ALL_FILTERS,
]  # fmt: skip


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def file_of(color: int, bits: int, size: tuple[int, int], packed: bytes, *others: bytes) -> bytes:
    """A PNG of (width, height) with such image data, other chunks before it."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", *size, bits, color, 0, 0, 0))
    return png.SIGNATURE + header + b"".join(others) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def test_an_image_survives_encoding() -> None:
    for image in (IMAGE, IMAGE[..., 0]):
        for level in (0, 1):
            assert np.array_equal(png.decode("", png.encode(image, level)), image)
            assert png.encode(image, level) == png.encode(image, level)


@given(
    st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3, 4]), st.sampled_from(FILTERS),
    st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_every_filter_is_undone(
    height: int, width: int, channels: int, kind: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    image = rng.choice([0, 1, 7, 128, 255], (height, width, channels)).astype(np.uint8)
    data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_FILTER, kind])[1].tobytes()
    wanted = image[..., 0] if channels == 1 else image[..., 2::-1]
    assert np.array_equal(png.decode("", data), wanted)


@pytest.mark.parametrize("kind", range(5))
@given(rows=st.binary(min_size=2 * 4 * 3, max_size=2 * 4 * 3))
def test_rows_come_out_as_opencv_has_them(kind: int, rows: bytes) -> None:
    """Arbitrary filtered bytes, RGB, so that sums pass 255."""
    filtered = b"".join(bytes([kind]) + rows[n : n + 12] for n in (0, 12))
    data = file_of(2, 8, (4, 2), zlib.compress(filtered))
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(png.decode("", data), decoded[..., ::-1])


def test_other_kinds_of_images_are_decoded() -> None:
    grey_alpha = zlib.compress(bytes([0, 10, 255, 20, 0]))
    assert png.decode("", file_of(4, 8, (2, 1), grey_alpha)).tolist() == [[10, 20]]
    palette = chunk(b"PLTE", bytes([1, 2, 3, 4, 5, 6]))
    indexed = file_of(3, 8, (2, 1), zlib.compress(bytes([0, 1, 0])), palette)
    assert png.decode("", indexed).tolist() == [[[4, 5, 6], [1, 2, 3]]]
    bilevel = file_of(0, 1, (8, 1), zlib.compress(bytes([0, 0b10100000])))
    assert png.decode("", bilevel).tolist() == [[255, 0, 255, 0, 0, 0, 0, 0]]


def test_a_row_of_no_known_filter_is_refused() -> None:
    data = file_of(0, 8, (2, 2), zlib.compress(bytes([0, 1, 2, 5, 1, 2])))
    with pytest.raises(BadInput, match="undecodable data; expected rows of filters 0 to 4"):
        png.decode("a.png", data)


@given(st.integers(0, len(png.encode(IMAGE)) - 1))
def test_a_cut_off_image_is_refused_wherever_it_ends(length: int) -> None:
    with pytest.raises(BadInput, match=r"image\.png"):
        png.check(Path("image.png"), png.encode(IMAGE)[:length])


@given(st.integers(8, len(png.encode(IMAGE)) - 1), st.integers(1, 255))
def test_a_changed_byte_is_noticed(place: int, change: int) -> None:
    data = bytearray(png.encode(IMAGE))
    data[place] ^= change
    with pytest.raises(BadInput):
        png.check(Path("image.png"), bytes(data))


def test_a_huge_size_is_refused_before_anything_is_allocated() -> None:
    with pytest.raises(BadInput, match="2147483647x2147483647"):
        png.check(Path("image.png"), file_of(2, 8, (2**31 - 1, 2**31 - 1), b""))
    with pytest.raises(BadInput, match=r"size: found 16384x16384; .* at most 67108864 in all"):
        png.check("large.png", file_of(2, 8, (16384, 16384), b""))


def test_valid_chunks_with_wrong_pixels_inside_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.png"
    for body in (b"not zlib", zlib.compress(b"too short"), zlib.compress(bytes(53))):
        path.write_bytes(file_of(2, 8, (4, 4), body))
        with pytest.raises(BadInput, match=r"image\.png"):
            decode_png(path)


def test_sixteen_bit_images_are_refused_by_name() -> None:
    data = cv2.imencode(".png", np.zeros((3, 3), np.uint16))[1].tobytes()
    with pytest.raises(BadInput, match="16 bits"):
        png.decode("image.png", data)


@given(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3]), st.integers(0, 2**32 - 1))
def test_opencv_reads_what_is_encoded(height: int, width: int, channels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.choice([0, 1, 7, 128, 255], (height, width, channels)).astype(np.uint8)
    image = image[..., 0] if channels == 1 else image
    for level in (0, 1):
        data = np.frombuffer(png.encode(image, level), np.uint8)
        decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        assert np.array_equal(decoded if channels == 1 else decoded[..., ::-1], image)


def test_zlib_and_zlib_ng_pack_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    other = pytest.importorskip("zlib_ng.zlib_ng", reason="of the extra `fast`")
    rng = np.random.default_rng(0)
    smooth = np.add.outer(np.arange(60), np.arange(80)).astype(np.uint8)
    images = [
        IMAGE,
        smooth,
        rng.integers(0, 256, (40, 50, 3), np.uint8),
        np.zeros((30, 30), np.uint8),
    ]
    packed = []
    for module in (other, zlib):
        monkeypatch.setattr(png, "zlib", module)
        packed.append([png.encode(image) for image in images])
        assert all(np.array_equal(png.decode("", png.encode(one)), one) for one in images)
        with pytest.raises(BadInput, match="damaged pixels"):
            png.decode("", file_of(2, 8, (4, 4), b"not zlib"))
    assert packed[0] == packed[1]


@pytest.mark.parametrize(
    "image", [IMAGE.astype(np.float32), np.zeros((2, 2, 2), np.uint8), IMAGE[:0]]
)
def test_what_no_png_here_holds_is_refused(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="cannot encode"):
        png.encode(image)


def test_pixels_are_checked_as_decoding_would() -> None:
    png.check_pixels("", png.encode(IMAGE))
    png.check_pixels(
        "",
        cv2.imencode(".png", np.zeros((3, 3), np.uint8), [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes(),
    )
    for size, body in (
        ((4, 4), b"not zlib"),
        ((4, 4), zlib.compress(b"short")),
        ((1, 1), zlib.compress(bytes([5, 1, 2, 3]))),
    ):
        with pytest.raises(BadInput):
            png.check_pixels("", file_of(2, 8, size, body))


def test_sixteen_bits_are_written_as_opencv_reads_them() -> None:
    depth = np.random.default_rng(0).integers(0, 2**16, (9, 7)).astype(np.uint16)
    for image in (depth, np.dstack([depth, depth + 1, depth + 2])):
        data = np.frombuffer(png.encode(image), np.uint8)
        decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        assert np.array_equal(decoded if image.ndim == 2 else decoded[..., ::-1], image)
