"""Images on parts: OpenGL draws exactly the mapping that the truth states, on the surface that was there."""

import json

import numpy as np
import pytest
from jaxtyping import Float, UInt8

from rpaug import RpaugError, twin
from rpaug.core import geometry
from rpaug.core.files import decode_png
from rpaug.twin import covers, textures
from rpaug.twin.covers import Cover
from rpaug.twin.world import Geom, Part


def look_up(
    image: UInt8[np.ndarray, "h w 3"], tiles: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 3"]:
    """The repeating image at those coordinates, 0..1, by linear interpolation between texel centres."""
    height, width = image.shape[:2]
    at = np.stack([tiles[:, 0] * width, -tiles[:, 1] * height], -1) - 0.5
    corner = np.floor(at).astype(int)
    out = np.zeros((len(tiles), 3))
    for right in (0, 1):
        for down in (0, 1):
            step = corner + np.array([right, down])
            weight = (1 - np.abs(at - step)).prod(1)
            out += weight[:, None] * image[step[:, 1] % height, step[:, 0] % width]
    return out / 255.0


def test_coordinates_by_hand():
    points = np.array([[0.1, 0.2, 0.3]] * 6)
    normals = np.array(
        [[-1, 0, 0], [0.1, 0.9, 0.2], [0, 0, 1], [0.5, 0.5, 0], [0, -1, 0], [0, 0, -1]]
    )
    expected = [[-2, 3], [-1, 3], [1, 2], [2, 3], [1, 3], [-1, 2]]
    np.testing.assert_allclose(covers.coordinates(points, normals, 0.1), expected)


def test_look_up_reads_texel_centres_from_the_lower_left():
    image = np.zeros((2, 4, 3), np.uint8)
    image[1, 0], image[0, 3] = 255, (0, 255, 0)
    at = np.array([[0.125, 0.25], [0.875, 0.75], [1.125, -0.75], [0.0, 0.25]])
    expected = [[1, 1, 1], [0, 1, 0], [1, 1, 1], [0.5, 0.5, 0.5]]
    np.testing.assert_allclose(look_up(image, at), expected)


@pytest.mark.parametrize(
    "geom",
    [
        Geom("box", (0.1, 0.2, 0.3), (0.4, 0.5, 0.6), yaw=0.3),
        Geom("cylinder", (0.1,), (0.0, 0.1, 0.0), (0.0, 0.1, 0.5)),
    ],
)
def test_meshes_face_outwards_and_are_closed(geom):
    mesh = covers.mesh(Part("thing", (geom,)), 0, 0.1)
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a) / 2
    assert ((area * mesh.normals[mesh.faces[:, 0]]).sum(-1) > 0).all()
    # The divergence theorem: a closed surface's area vectors cancel, and enclose the volume.
    np.testing.assert_allclose(area.sum(0), 0, atol=1e-12)
    volume = (area * a).sum() / 3
    ring = 14 * np.sin(2 * np.pi / 28) * 0.1**2 * 0.5
    assert volume == pytest.approx(8 * 0.006 if geom.shape == "box" else ring)


def test_round_shapes_and_unknown_images_are_refused():
    with pytest.raises(RpaugError, match="grip: a capsule cannot be covered"):
        covers.mesh(Part("grip", (Geom("capsule", (0.1,), (0, 0, 0), (0, 0, 1)),)), 0, 0.1)
    with pytest.raises(RpaugError, match="marble"):
        _ = Cover(kind="leopard", seed=0, side=0.1).image


@pytest.mark.parametrize("kind", textures.KINDS)
def test_pictures_are_drawn_from_their_seed(kind):
    first, again, other = (textures.picture.__wrapped__(kind, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert first.std() > 2


def test_fibres_run_along_a_row():
    wood = textures.grain(np.random.default_rng(0), (0.6, 0.4, 0.2), 12, 0.2).astype(float)
    down, along = (np.abs(np.diff(wood, axis=axis)).mean() for axis in (0, 1))
    assert down > 4 * along


# Tiles so large that a pixel is smaller than a texel: then no mipmap comes in between.
SIDES = {"table": 3.0, "block_textured": 0.6, "cabinet": 1.5, "cylinder": 1.2}


@pytest.fixture(scope="module")
def covered() -> twin.Take:
    laid = {name: Cover(kind="spots", seed=5, side=side) for name, side in SIDES.items()}
    return twin.perform("open_drawer", 2, frames=11, size=256, look=twin.Look(covers=laid))


@pytest.fixture(scope="module")
def grey() -> twin.Take:
    """The same parts, each of one known color."""
    laid = {name: _Plain(kind="plain", seed=0, side=1.0) for name in SIDES}
    look = twin.Look(covers=laid, tints=dict.fromkeys(SIDES, (0.8, 0.8, 0.8)))
    return twin.perform("open_drawer", 2, frames=11, size=256, look=look)


class _Plain(Cover):
    """White all over."""

    image = np.full((8, 8, 3), 255, np.uint8)


@pytest.mark.gl
@pytest.mark.parametrize("name", SIDES)
def test_opengl_draws_the_mapping(covered, grey, name):
    handle = covered.truth.handles[name]
    laid = covered.truth.covers[handle]
    view, plain = covered.episode.views["front"], grey.episode.views["front"]
    mine = view.ids(0) == handle
    points = geometry.world_points(plain.depth(0), plain.camera, 0)
    local = geometry.transform(geometry.inverse(np.array(laid.body_to_world)), points)
    normals = np.cross(np.gradient(local, axis=0), np.gradient(local, axis=1))
    # Flat pixels whose normal is not torn between two axes.
    size = np.sort(np.abs(normals), -1) / np.linalg.norm(normals, axis=-1, keepdims=True)
    sure = mine & (size[..., 2] > size[..., 1] + 0.05) & ~_outline(view.ids(0), local)
    assert sure.sum() > 100
    tiles = covers.coordinates(local[sure], normals[sure], laid.cover.side)
    expected = look_up(laid.cover.image, tiles)
    shading = plain.rgb(0)[sure] / 255 / 0.8
    off = np.abs(view.rgb(0)[sure] - 255 * expected * shading)
    assert np.quantile(off, 0.99) < 3
    assert off.mean() < 1


@pytest.mark.gl
def test_a_cover_leaves_the_surface_where_it_was(drawer):
    covered = twin.perform("open_drawer", 3, frames=16, factor="object_texture", target="drawer")
    handle = drawer.truth.handles["drawer"]
    assert covered.truth.changed == (handle,)
    for name, view in covered.episode.views.items():
        old = drawer.episode.views[name]
        for t in (0, 15):
            np.testing.assert_array_equal(view.ids(t), old.ids(t))
            np.testing.assert_allclose(view.depth(t), old.depth(t), atol=5e-6)
            mine = view.ids(t) == handle
            np.testing.assert_array_equal(view.rgb(t)[~mine], old.rgb(t)[~mine])


def _outline(ids: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Pixels next to another part, or to another face of the same one."""
    bend = np.abs(np.gradient(np.gradient(local, axis=1), axis=1)) + np.abs(
        np.gradient(np.gradient(local, axis=0), axis=0)
    )
    edge = (bend > 1e-4).any(-1)
    for axis in (0, 1):
        for step in (-2, -1, 1, 2):
            edge |= np.roll(ids, step, axis) != ids
    return edge


@pytest.mark.gl
def test_the_image_lies_beside_the_truth(tmp_path):
    (take,) = twin.record(
        "open_drawer", 1, tmp_path, frames=11, size=16, factor="background_texture"
    )
    folder = tmp_path / take.episode.key
    facts = json.loads((folder / "truth.json").read_text())
    names = ("wall_back", "wall_left", "wall_right", "wall_far", "floor")
    assert {facts["handles"][name] for name in names} == set(facts["changed"])
    (file,) = {laid["file"] for laid in facts["covers"].values()}
    laid = next(iter(facts["covers"].values()))
    cover = Cover(**laid["cover"])
    np.testing.assert_array_equal(decode_png(folder / file), cover.image)
    np.testing.assert_array_equal(laid["body_to_world"], np.eye(4))
