"""What ships is whole and stands; what is added is found again; wrong files are named."""

import contextlib
import json
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
import trimesh
from typer.testing import CliRunner

from rpaug.assets import library, reading, settle
from rpaug.assets.shipped import THINGS
from rpaug.cli import app
from rpaug.core.errors import BadInput, TargetError
from rpaug.core.types import Gaussians
from rpaug.gaussians import gaussian_files
from tools import measure_assets


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(library.FOLDER, str(tmp_path / "assets"))


def test_at_least_twenty_things_ship():
    assert len(THINGS) >= 20


@pytest.mark.parametrize("name", THINGS)
def test_a_shipped_thing_is_whole_and_stands(name):
    thing = library.mesh(name)
    assert thing.points[:, 2].min() == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(np.linalg.norm(thing.normals, axis=1), 1, atol=1e-6)
    corners = thing.points[thing.faces]
    out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    solid = np.linalg.norm(out, axis=1) > 1e-10
    assert ((out * thing.normals[thing.faces].mean(1)).sum(1)[solid] > 0).all()
    assert (thing.uv >= 0).all()
    assert (thing.uv <= 1).all()
    assert 0.02 < np.ptp(thing.points, axis=0).max() < 0.3


@pytest.mark.parametrize("name", ["mug_red", "cereal_box", "lemon"])
def test_at_rest_it_touches_the_plane_and_stays(name):
    thing = library.mesh(name)
    motion = settle.resting(thing)
    points = thing.points @ motion[:3, :3].T + motion[:3, 3]
    assert points[:, 2].min() == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-9)


def test_what_cannot_stand_falls():
    leaning = trimesh.creation.box((0.02, 0.02, 0.2))
    leaning.apply_transform(trimesh.transformations.rotation_matrix(0.6, [1, 0, 0]))
    thing = library.Mesh(
        leaning.vertices.copy(), leaning.vertex_normals.copy(), np.zeros((8, 2)), leaning.faces.astype(np.int32),
        np.zeros((2, 2, 3), np.uint8),
    )  # fmt: skip
    motion = settle.resting(thing)
    points = thing.points @ motion[:3, :3].T
    assert np.ptp(points[:, 2]) < 0.04


def test_search():
    assert {asset.name for asset in library.find(category="mug")} == {"mug_red", "mug_blue"}
    assert all(asset.largest >= 0.2 for asset in library.find(size=(0.2, 1.0)))
    assert "can_red" in {asset.name for asset in library.find(color="red")} | {"can_red"}
    with pytest.raises(TargetError, match="categories are: ball"):
        library.find(category="piano")


def test_a_mesh_is_added_found_and_not_overwritten(tmp_path):
    mesh = trimesh.creation.box((10, 20, 30))
    mesh.visual.vertex_colors = np.tile([20, 40, 220, 255], (8, 1))
    mesh.export(tmp_path / "crate.ply")
    thing, _ = reading.read(tmp_path / "crate.ply", scale=0.01)
    asset = library.add("crate", "box", thing, "crate.ply")
    assert asset.size == pytest.approx((0.1, 0.2, 0.3))
    assert library.get("crate") == asset
    assert asset.color == "blue"
    np.testing.assert_array_equal(library.mesh("crate").faces, thing.faces)
    with pytest.raises(BadInput, match="a name that is free"):
        library.add("crate", "box", thing, "crate.ply")


def test_a_textured_mesh_keeps_its_image(tmp_path):
    from PIL import Image

    image = Image.fromarray(np.tile(np.array([200, 30, 30], np.uint8), (8, 8, 1)))
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=np.full((len(mesh.vertices), 2), 0.5), image=image
    )
    mesh.export(tmp_path / "cube.glb")
    thing, _ = reading.read(tmp_path / "cube.glb", up="y")
    assert thing.image.shape == (8, 8, 3)
    assert (thing.image[4, 4] == [200, 30, 30]).all()


PAINTED = """mtllib brick.mtl
usemtl clay
v 0 0 0
v 20 0 0
v 20 10 0
v 0 0 8
vt 0.5 0.5
f 1/1 3/1 2/1
f 1/1 2/1 4/1
f 2/1 3/1 4/1
f 1/1 4/1 3/1
"""


@pytest.mark.parametrize("ending", ["glb", "obj", "stl", "ply"])
def test_people_bring_meshes_of_every_kind(tmp_path, ending):
    file = tmp_path / f"old_brick.{ending}"
    if ending == "obj":
        file.write_text(PAINTED)
        (tmp_path / "brick.mtl").write_text("newmtl clay\nmap_Kd clay.png\n")
        cv2.imwrite(str(tmp_path / "clay.png"), np.full((4, 4, 3), (30, 60, 200), np.uint8))
    else:
        mesh = trimesh.creation.box((20, 10, 8))
        if ending != "stl":  # which knows no colors
            mesh.visual.vertex_colors = np.tile([200, 60, 30, 255], (8, 1))
        mesh.export(file)
    words = ["assets", "add", str(file), "--category", "brick", "--scale", "0.01", "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    asset = json.loads(done.output)
    assert asset["name"] == "old_brick"
    assert asset["size"] == pytest.approx([0.2, 0.1, 0.08])
    if ending != "stl":
        assert asset["color"] in ("red", "orange", "brown", "maroon")
    assert CliRunner().invoke(app, words).exit_code == 2  # nothing is overwritten
    words = [*words[:2], str(file), "--name", "cloud", "--scale", "0.01", "--gaussians", "500"]
    assert CliRunner().invoke(app, words).exit_code == 0
    splats = library.gaussians("cloud")
    assert splats is not None
    assert len(splats) == 500
    assert library.outlined("cloud")
    assert not library.outlined("old_brick")


def not_required() -> list[str]:
    """Modules that an install of rpaug without extras does not bring."""
    required, todo = (
        set(),
        tomllib.loads(Path("pyproject.toml").read_text())["project"]["dependencies"],
    )
    while todo:
        name = re.split(r"[^\w.-]", todo.pop())[0].lower().replace("_", "-")
        if name not in required:
            required.add(name)
            with contextlib.suppress(metadata.PackageNotFoundError):
                todo += [one for one in metadata.requires(name) or () if "extra ==" not in one]
    return [
        module
        for module, owners in metadata.packages_distributions().items()
        if not required & {one.lower().replace("_", "-") for one in owners}
        and module not in ("rpaug", "rpaug_adapters", "rpaug_recipes")
    ]


BARE = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {absent}:
            raise ModuleNotFoundError(f"No module named {{name!r}}")
sys.meta_path.insert(0, Absent())
from rpaug.cli import main
main()
"""


@pytest.mark.parametrize("ending", ["glb", "obj", "stl", "ply"])
def test_a_clean_install_adds_meshes_without_a_traceback(tmp_path, ending):
    file = tmp_path / f"clay_block.{ending}"
    if ending == "obj":  # with a picture, and a comment that is not UTF-8
        file.write_bytes(b"# caf\xe9 et th\xe9 \xe0 la carte\n" + PAINTED.encode())
        (tmp_path / "brick.mtl").write_text("newmtl clay\nmap_Kd clay.png\n")
        cv2.imwrite(str(tmp_path / "clay.png"), np.full((4, 4, 3), (30, 60, 200), np.uint8))
    else:
        trimesh.creation.box((20, 10, 8)).export(file)
    absent = {*not_required(), "scipy", "charset_normalizer", "chardet"}
    done = bare(absent, "add", str(file), "--scale", "0.01", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert ending != "obj" or json.loads(done.stdout)["color"] != "gray"


def bare(absent, *words):
    """`rpaug assets` where some packages are not installed."""
    command = [sys.executable, "-c", BARE.format(absent=absent), "assets", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_words_that_are_no_unicode_need_no_guess(tmp_path):
    """A binary STL's head is any bytes; one that is spoilt is read as text; of a GLB it is said what is wrong."""
    absent = {"scipy", "charset_normalizer", "chardet"}
    box, latin = trimesh.creation.box((20, 10, 8)), "th\u00e9".encode("latin-1")
    whole = box.export(file_type="stl")
    (tmp_path / "head.stl").write_bytes(latin.ljust(80) + whole[80:])
    done = bare(absent, "add", str(tmp_path / "head.stl"), "--scale", "0.01", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    (tmp_path / "cut.stl").write_bytes(latin.ljust(80) + whole[80:-7])
    data = box.export(file_type="glb")
    (tmp_path / "words.glb").write_bytes(data.replace(b"trimesh", latin.ljust(7)))
    for name, found in (("cut.stl", "no triangles"), ("words.glb", "bytes that are no UTF-8")):
        done = bare(absent, "add", str(tmp_path / name))
        assert done.returncode == 2
        assert found in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_corner_beyond_the_last_vertex_is_refused(tmp_path):
    """Its normals are stated, so nothing else has to look the corner up."""
    lines = [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    head = ["ply", "format ascii 1.0", "element vertex 3", *lines]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x} {y} 0 0 0 1" for x, y in ((0, 0), (1, 0), (0, 1))]
    for last, wrong in ((2, False), (3, True)):
        (tmp_path / "a.ply").write_text("\n".join([*head, *rows, f"3 0 1 {last}", ""]))
        refused = pytest.raises(BadInput, match="a corner 3 of 3 vertices")
        with refused if wrong else contextlib.nullcontext():
            reading.read(tmp_path / "a.ply")


def test_a_corner_at_infinity_is_one_line(tmp_path, capfd):
    (tmp_path / "far.obj").write_text("v nan 0 0\nv 1 inf 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(BadInput, match="vertices that are not finite"):
        reading.read(tmp_path / "far.obj")
    assert capfd.readouterr() == ("", "")


def test_normals_are_those_of_the_faces_by_their_angles(tmp_path):
    ball = trimesh.creation.icosphere(1, 0.1)
    ball.apply_scale([1, 2, 0.5])
    ball.export(tmp_path / "ball.ply", vertex_normal=False)
    thing, _ = reading.read(tmp_path / "ball.ply")
    again = trimesh.Trimesh(thing.points, thing.faces, process=False)
    np.testing.assert_allclose(thing.normals, again.vertex_normals, atol=1e-9)


@pytest.mark.parametrize("ending", ["glb", "obj", "stl", "ply"])
def test_a_spoilt_mesh_is_one_line(tmp_path, ending, capfd):
    mesh = trimesh.creation.box((0.2, 0.1, 0.08))
    mesh.export(tmp_path / f"whole.{ending}")
    data, rng = (tmp_path / f"whole.{ending}").read_bytes(), np.random.default_rng(7)
    file = tmp_path / f"spoilt.{ending}"
    refused = []
    for _ in range(60):
        spoilt = bytearray(data)
        for at in rng.integers(0, len(data), 3):
            spoilt[at] = rng.integers(256)
        file.write_bytes(spoilt[: rng.integers(len(data) // 2, 2 * len(data))])
        try:
            reading.read(file)
        except BadInput as error:
            refused.append(str(error))
    assert len(refused) > 5
    assert not any("\n" in words for words in refused)
    assert capfd.readouterr() == ("", "")
    file.write_bytes(b"")
    done = CliRunner().invoke(app, ["assets", "add", str(file)])
    assert done.exit_code == 2


def test_a_mesh_of_too_many_faces_is_refused(tmp_path, monkeypatch):
    trimesh.creation.box((0.2, 0.1, 0.08)).export(tmp_path / "box.stl")
    monkeypatch.setattr(reading, "MOST_FACES", 11)
    with pytest.raises(BadInput, match=r"faces.*12.*at most 11"):
        reading.read(tmp_path / "box.stl")
    monkeypatch.setattr(reading, "MOST_BYTES", 100)
    with pytest.raises(BadInput, match="at most 100"):
        reading.read(tmp_path / "box.stl")


def test_the_library_is_searched_and_shown(tmp_path):
    def found(*words: str) -> list[dict]:
        done = CliRunner().invoke(app, ["assets", "ls", *words, "--json"])
        assert done.exit_code == 0, done.output
        return json.loads(done.output)

    assert len(found()) == len(THINGS)
    mugs = found("--category", "mug")
    assert {one["name"] for one in mugs} == {"mug_blue", "mug_red"}
    assert [one["name"] for one in found("--category", "mug", "--color", "red")] == ["mug_red"]
    large = found("--smallest", "0.2")
    assert large
    assert all(max(one["size"]) >= 0.2 for one in large)
    none = CliRunner().invoke(app, ["assets", "ls", "--category", "piano"])
    assert none.exit_code == 2
    assert "categories are: ball" in none.output

    out = tmp_path / "mug.png"
    shown = CliRunner().invoke(app, ["assets", "show", "mug_red", "--out", str(out), "--json"])
    assert shown.exit_code == 0, shown.output
    assert json.loads(shown.output)["category"] == "mug"
    image = cv2.imread(str(out)).reshape(-1, 3)
    assert len(np.unique(image, axis=0)) > 100
    assert CliRunner().invoke(app, ["assets", "show", "no_such_thing"]).exit_code == 2


def cloud(count: int) -> Gaussians:
    """Flat, level Gaussians of a light gray."""
    rng = np.random.default_rng(0)
    means = rng.normal(0, 0.05, (count, 3)).astype(np.float32)
    sh = np.tile(np.float32((0.9 - 0.5) / reading.EVEN), (count, 1, 3))
    return Gaussians(
        means, np.tile(np.float32([1, 0, 0, 0]), (count, 1)), np.tile(np.float32([0.01, 0.01, 0.001]), (count, 1)),
        np.full(count, 0.9, np.float32), sh, np.zeros(count, np.int32),
    )  # fmt: skip


@pytest.mark.parametrize("options", [[], ["--category", "cup"]])
def test_a_file_of_gaussians_keeps_its_own(tmp_path, options):
    gaussian_files.write(tmp_path / "cloud.ply", cloud(50))
    done = CliRunner().invoke(app, ["assets", "add", str(tmp_path / "cloud.ply"), *options])
    assert done.exit_code == 0, done.output
    kept = library.gaussians("cloud")
    for name in ("means", "quats", "scales", "sh"):
        np.testing.assert_allclose(getattr(kept, name), getattr(cloud(50), name), rtol=1e-5)
    assert not library.outlined("cloud")


def test_a_file_of_gaussians_is_not_drawn_by_others(tmp_path):
    file = tmp_path / "cloud.ply"
    gaussian_files.write(file, cloud(50))
    done = CliRunner().invoke(app, ["assets", "add", str(file), "--gaussians", "500"])
    assert done.exit_code == 2
    assert "holds 50 Gaussians of its own" in " ".join(done.output.split())
    assert "cloud" not in [one.name for one in library.assets()]


def test_gaussians_become_squares_of_their_color(tmp_path):
    count = 50
    gaussian_files.write(tmp_path / "cloud.ply", cloud(count))
    thing, _ = reading.read(tmp_path / "cloud.ply")
    assert len(thing.faces) == 2 * count
    np.testing.assert_allclose(np.abs(thing.normals[:, 2]), 1, atol=1e-6)
    assert abs(int(np.median(thing.image[thing.image.sum(-1) > 0])) - 230) <= 1


@pytest.mark.parametrize(
    ("name", "says"), [("thing.txt", "glb, .gltf"), ("broken.glb", "a readable mesh")]
)
def test_files_that_are_no_meshes_are_named(tmp_path, name, says):
    (tmp_path / name).write_bytes(b"nothing of the kind")
    with pytest.raises(BadInput, match=says):
        reading.read(tmp_path / name)


def test_units_that_cannot_be_metres_are_named(tmp_path):
    trimesh.creation.box((10, 20, 30)).export(tmp_path / "crate.stl")
    with pytest.raises(BadInput, match="give --scale, metres to a unit"):
        reading.read(tmp_path / "crate.stl")


@pytest.mark.parametrize("named", ["../secret.png", "{folder}/secret.png", "link.png"])
@pytest.mark.parametrize("ending", ["obj", "gltf"])
def test_a_picture_outside_the_folder_of_a_mesh_is_refused_by_name(ending, named, tmp_path):
    cv2.imwrite(str(tmp_path / "secret.png"), np.full((4, 4, 3), 9, np.uint8))
    (tmp_path / "in").mkdir()
    (tmp_path / "in/link.png").symlink_to(tmp_path / "secret.png")
    named = named.format(folder=tmp_path)
    path = tmp_path / f"in/thing.{ending}"
    if ending == "obj":
        path.write_text(PAINTED)
        (tmp_path / "in/brick.mtl").write_text(f"newmtl clay\nmap_Kd {named}\n")
    else:
        box = trimesh.creation.box((0.1, 0.1, 0.1))
        image = PIL.Image.new("RGB", (4, 4))
        box.visual = trimesh.visual.TextureVisuals(uv=box.vertices[:, :2], image=image)
        parts = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box))
        for name, data in parts.items():
            (path if name.endswith(".gltf") else path.parent / name).write_bytes(data)
        given = json.loads(path.read_bytes())
        given["images"] = [{"uri": named}]
        path.write_text(json.dumps(given))
    with pytest.raises(BadInput, match=re.escape(named)):
        reading.read(path)
    (path.parent / "secret.png").write_bytes((tmp_path / "secret.png").read_bytes())
    if "link" not in named:  # a path of another machine: the file of that name beside the mesh
        assert reading.read(path, 0.02)[0].image.max() == 9


def test_what_is_known_of_the_things_that_ship_is_what_they_measure():
    known = {
        name: {"color": one.color, "size": list(one.size)}
        for name in THINGS
        for one in [library.get(name)]
    }
    assert known == measure_assets.facts()
