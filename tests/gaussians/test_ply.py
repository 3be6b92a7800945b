"""The 3DGS file against a reader of its own, against trimesh, and against damaged files."""

import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from clouds import some

from rpaug.core.errors import BadInput
from rpaug.gaussians import gaussian_files, ply


@pytest.mark.parametrize("bands", [1, 4, 9, 16])
def test_there_and_back(tmp_path: Path, bands: int) -> None:
    before = some(50, bands)
    gaussian_files.write(tmp_path / "a.ply", before)
    after = ply.read(tmp_path / "a.ply")
    for name in ("means", "quats", "sh", "ids"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    for name in ("scales", "opacities"):  # through a logarithm or a logit in float32
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=1e-5)


def test_a_reader_made_of_struct_finds_the_3dgs_layout(tmp_path: Path) -> None:
    gaussians = some(3, 4)
    gaussian_files.write(tmp_path / "a.ply", gaussians)
    header, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n", 1)
    names = [
        line.split()[-1] for line in header.decode().splitlines() if line.startswith("property")
    ]
    order = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    order += [f"f_rest_{i}" for i in range(9)]
    order += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "id"]
    assert names == order
    row = struct.unpack_from("<26fi", body, struct.calcsize("<26fi"))
    values = dict(zip(names, row, strict=True))
    assert values["y"] == gaussians.means[1, 1]
    assert values["f_dc_2"] == gaussians.sh[1, 0, 2]
    assert values["f_rest_3"] == gaussians.sh[1, 1, 1]  # the first of green
    assert values["scale_0"] == pytest.approx(np.log(gaussians.scales[1, 0]), rel=1e-6)
    opacity = gaussians.opacities[1]
    assert values["opacity"] == pytest.approx(np.log(opacity / (1 - opacity)), rel=1e-4)
    assert values["rot_0"] == gaussians.quats[1, 0]


def test_trimesh_opens_it(tmp_path: Path) -> None:
    gaussians = some(40)
    gaussian_files.write(tmp_path / "a.ply", gaussians)
    cloud = trimesh.load(tmp_path / "a.ply")
    assert len(cloud.vertices) == 40
    np.testing.assert_allclose(cloud.bounds[0], gaussians.means.min(0), rtol=1e-6)
    np.testing.assert_allclose(cloud.bounds[1], gaussians.means.max(0), rtol=1e-6)


def test_nothing_is_a_file_too(tmp_path: Path) -> None:
    gaussian_files.write(tmp_path / "a.ply", some(0))
    assert len(ply.read(tmp_path / "a.ply")) == 0


def test_files_in_the_way_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("mine")
    with pytest.raises(BadInput, match="already"):
        gaussian_files.write(tmp_path / "a.ply", some(2))
    assert (tmp_path / "a.ply").read_text() == "mine"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data[:-5], "length"),
        (lambda data: b"plx" + data[3:], "expected a .ply file"),
        (lambda data: data.replace(b"binary_little_endian", b"ascii"), "found ascii"),
        (
            lambda data: data.replace(b"property float opacity", b"property float opaqueness"),
            "opacity",
        ),
        (lambda data: data.replace(b"vertex 9", b"face 9"), "element"),
        (lambda data: data.replace(b"property float x", b"property list uchar int x"), "list"),
        (lambda data: data.replace(b"float nx", b"float f_rest_0"), "f_rest: found 1 of them"),
        (
            lambda data: data[:-8] + struct.pack("<fi", np.inf, 0),
            "quats: found 1 Gaussians .*row 8",
        ),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, spoil, message: str) -> None:
    (tmp_path / "a.ply").write_bytes(spoil(ply.encoded(some(9))))
    with pytest.raises(BadInput, match=message):
        ply.read(tmp_path / "a.ply")
