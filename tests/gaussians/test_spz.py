"""An `.spz` file against a reader made of the published layout alone, and against what the Gaussians look like."""

import gzip
import math
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clouds import some

from rpaug.core.errors import BadInput, Unsupported
from rpaug.core.types import Gaussians
from rpaug.gaussians import gaussian_files, spz
from rpaug.render.splat import render

FLIP = np.diag([1.0, -1, -1, 1])  # right, up, back to right, down, front


def read(data: bytes) -> Gaussians:
    """The file's Gaussians in its own axes, number by number as its README lays them out."""
    raw = gzip.decompress(data)
    magic, version, count, degree, bits, flags, reserved = struct.unpack_from("<IIIBBBB", raw)
    assert (magic, version, flags, reserved) == (0x5053474E, 3, 0, 0)
    rest, at = (degree + 1) ** 2 - 1, 16

    def take(width: int) -> list[bytes]:
        nonlocal at
        rows = [raw[at + width * i : at + width * (i + 1)] for i in range(count)]
        at += width * count
        return rows

    means = [
        [int.from_bytes(row[3 * k : 3 * k + 3], "little", signed=True) / 2**bits for k in range(3)]
        for row in take(9)
    ]
    opacities = [row[0] / 255 for row in take(1)]
    colors = [[(value / 255 - 0.5) / 0.15 for value in row] for row in take(3)]
    scales = [[math.exp(value / 16 - 10) for value in row] for row in take(3)]
    quats = [rotation(int.from_bytes(row, "little")) for row in take(4)]
    higher = [[(value - 128) / 128 for value in row] for row in take(3 * rest)]
    assert at == len(raw)
    sh = np.concatenate(
        [np.reshape(colors, (count, 1, 3)), np.reshape(higher, (count, rest, 3))], 1
    )
    as_floats = [np.array(one, np.float32) for one in (means, quats, scales, opacities, sh)]
    return Gaussians(*as_floats, ids=np.zeros(count, np.int32))


def rotation(packed: int) -> list[float]:
    """(w, x, y, z): two bits say which of (x, y, z, w) is largest, ten a component say the others, the last first."""
    found, largest = [0.0] * 4, packed >> 30
    for axis in (3, 2, 1, 0):
        if axis != largest:
            size = (packed & 511) / 511 * math.sqrt(0.5)
            found[axis] = -size if packed & 512 else size
            packed >>= 10
    found[largest] = math.sqrt(max(0, 1 - sum(one * one for one in found)))
    return [found[3], *found[:3]]


@pytest.mark.parametrize("bands", [1, 4, 9, 16])
def test_another_reader_finds_the_same_to_the_last_bit_that_is_kept(bands: int) -> None:
    given = some(60, bands)
    back = read(spz.encoded(given))
    np.testing.assert_allclose(back.means, given.means * (1, -1, -1), atol=2**-17)
    np.testing.assert_allclose(back.opacities, given.opacities, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(np.log(back.scales), np.log(given.scales), atol=1 / 32 + 1e-5)
    turned = given.quats * (1, 1, -1, -1)
    np.testing.assert_allclose(np.abs((back.quats * turned).sum(1)), 1, atol=1e-5)
    inside = np.abs(given.sh[:, 0]) < 3.3  # beyond, colors are cut off
    np.testing.assert_allclose(
        back.sh[:, 0][inside], given.sh[:, 0][inside], atol=0.5 / (0.15 * 255) + 1e-5
    )


@pytest.mark.parametrize("bands", [1, 4, 9, 16])
def test_what_it_holds_looks_the_same_from_a_turned_camera(bands: int) -> None:
    given = some(200, bands)
    given.sh[:] = np.clip(given.sh * 0.2, -0.9, 0.9)
    back = read(spz.encoded(given))
    K, eye = np.array([[120, 0, 63.5], [0, 120, 63.5], [0, 0, 1.0]]), np.eye(4)
    eye[2, 3] = 3  # world to camera: all of them in front of it
    first = render(given, K, eye, 128, 128, background=0.5).color
    unturned = {"camera": (back, eye)}
    if bands > 1:
        unturned["harmonics"] = (replace(back, sh=given.sh), eye @ FLIP)
    off = np.abs(first - render(back, K, eye @ FLIP, 128, 128, background=0.5).color).mean()
    assert off < 0.01
    for one, pose in unturned.values():
        assert np.abs(first - render(one, K, pose, 128, 128, background=0.5).color).mean() > 4 * off


def test_far_ones_have_room_and_farther_ones_are_refused() -> None:
    given = some(20)
    given.means[3, 0] = -900
    back = read(spz.encoded(given))
    np.testing.assert_allclose(back.means, given.means * (1, -1, -1), atol=2**-13)
    given.means[3, 0] = 1e7
    with pytest.raises(Unsupported, match="reaches"):
        spz.encoded(given)


def test_the_ending_says_which_and_nothing_is_overwritten(tmp_path: Path) -> None:
    gaussian_files.write(tmp_path / "a.spz", some(2000, 4))
    gaussian_files.write(tmp_path / "a.ply", some(2000, 4))
    assert (tmp_path / "a.spz").stat().st_size < (tmp_path / "a.ply").stat().st_size / 4
    assert len(read((tmp_path / "a.spz").read_bytes())) == 2000
    with pytest.raises(BadInput, match="already"):
        gaussian_files.write(tmp_path / "a.spz", some(2))
    with pytest.raises(BadInput, match=r"\.ply or \.spz"):
        gaussian_files.write(tmp_path / "a.splat", some(2))


def test_none_and_the_same_bytes_each_time() -> None:
    assert len(read(spz.encoded(some(0, 4)))) == 0
    assert spz.encoded(some(30, 9)) == spz.encoded(some(30, 9))
