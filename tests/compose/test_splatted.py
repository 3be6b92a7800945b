"""Inserted Gaussians: harmonics that turn with the thing, one surface's depth, occlusion, and the scene's light."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import scene

from rpaug.assets import library, sampled
from rpaug.compose import inserted, splatted, tuned
from rpaug.core import geometry
from rpaug.core.types import Ambience, Body
from rpaug.gaussians import harmonics
from rpaug.gaussians.gaussian_view import view_of
from rpaug.render import mesh as triangles
from rpaug.render.splat import Rasteriser, Splats
from rpaug.scene.lighting import irradiance

SIZE = 96


def body(name="mug_red", pose=None, count=20_000):
    thing = library.mesh(name)
    pose = np.eye(4) if pose is None else pose
    return Body(
        frozenset([900]), pose[None].repeat(2, 0), "static", mesh=thing,
        splats=sampled.gaussians(thing, count),
    )  # fmt: skip


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_colors_turn_with_the_thing(degree):
    rng = np.random.default_rng(degree)
    turn = geometry.rotation(rng.normal(size=3))
    sh = rng.normal(size=(5, (degree + 1) ** 2, 3)).astype(np.float32)
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    count = sh.shape[1]
    before = np.einsum("vk,nkc->nvc", harmonics.basis(ways, count), sh)
    turned = harmonics.turned(sh, turn)
    after = np.einsum("vk,nkc->nvc", harmonics.basis(ways @ turn.T, count), turned)
    np.testing.assert_allclose(after, before, atol=1e-5)


@pytest.mark.parametrize("name", ["mug_red", "cereal_box", "bowl_wood"])
def test_a_mesh_as_gaussians_looks_like_the_mesh(name):
    one = body(name, count=sampled.COUNT)
    overlap, decibels, off = [], [], []
    for camera in tuned.ring(one.splats, SIZE)[::6]:
        true = triangles.draw(one.mesh, np.eye(4), camera.K, camera.cam_to_world[0], (SIZE, SIZE))
        seen = splatted.draw(one, camera, 0)
        height, width = seen.alpha.shape
        at = np.s_[seen.row : seen.row + height, seen.column : seen.column + width]
        shown = np.zeros((SIZE, SIZE), bool)
        shown[at] = seen.depth > 0
        both = (shown & true.hit)[at]
        color = seen.color / np.maximum(seen.alpha, 1e-3)[..., None]
        overlap.append(both.sum() / (shown | true.hit).sum())
        decibels.append(-10 * np.log10(((color - true.albedo[at])[both] ** 2).mean()))
        off.append(np.median(np.abs(seen.depth - true.depth[at])[both]))
    assert np.mean(overlap) > 0.97
    assert np.mean(decibels) > 23
    assert np.max(off) < 5e-4


def test_what_is_nearer_hides_it_and_the_rest_stays():
    recorded = scene({"front": (0.0, -0.8, 0.7)}, length=2, ball=False)
    camera, view = recorded.cameras["front"], recorded.episode.views["front"]
    pose = geometry.rigid(np.zeros(3), np.array([0.3, 0.0, 0.0]))
    before = view.rgb(0), view.depth(0), view.ids(0)
    for antialiased in (False, True):
        one = replace(recorded, bodies=(*recorded.bodies, body(pose=pose)), antialiased=antialiased)
        rgb, depth, ids = inserted.draw(one, camera, 0, before)
        new = ids == 900
        assert new.sum() > 30
        assert (depth[new] < before[1][new]).all()
        changed = (rgb != before[0]).any(-1)
        assert (changed & ~new).any() == antialiased
        np.testing.assert_array_equal(depth[~new], before[1][~new])
        wall = np.full_like(depth, 0.2)
        hidden = inserted.draw(one, camera, 0, (before[0], wall, before[2]))
        np.testing.assert_array_equal(hidden[0], before[0])


def test_where_its_mesh_is_known_that_is_its_surface():
    recorded = scene({"front": (0.0, -0.8, 0.7)}, length=2, ball=False)
    camera, view = recorded.cameras["front"], recorded.episode.views["front"]
    one = body(pose=geometry.rigid(np.zeros(3), np.array([0.3, 0.0, 0.0])))
    before = view.rgb(0), view.depth(0), view.ids(0)

    def drawn(**changed):
        bodies = (*recorded.bodies, replace(one, **changed))
        return inserted.draw(replace(recorded, bodies=bodies, antialiased=False), camera, 0, before)

    solid, splats, known = drawn(splats=None), drawn(), drawn(outlined=True)
    np.testing.assert_array_equal(known[2], solid[2])
    np.testing.assert_allclose(known[1], solid[1], atol=1e-6)
    both = (splats[2] == 900) & (solid[2] == 900)
    np.testing.assert_array_equal(known[0][both], splats[0][both])  # the colors are the Gaussians'


def test_harmonics_are_tuned_to_the_light_of_the_scene():
    light = irradiance.even()
    light[:4] = 0.7, 0.0, 0.25, 0.05
    ambience = Ambience(tuple(light.tolist()), (1.0, 0.8, 0.6))
    one = body("soap", geometry.rigid(np.array([0.0, 0.0, 1.0]), np.zeros(3)), 5_000)
    after = tuned.tuned(one.splats, one.to_world[0], ambience)
    there, lit = (splatted.standing(each, one.to_world[0]) for each in (one.splats, after))
    worst = []
    for camera in tuned.ring(there, 64)[1::5]:
        goal = tuned.refined(there, camera, ambience)
        splats = Splats.of(lit)
        made = Rasteriser(splatted.small(splats)).forward(splats, view_of(camera, 0)).color
        worst.append(-10 * np.log10(((goal - made) ** 2).mean()))
    assert min(worst) > 28
    for part in ("means", "quats", "scales", "opacities"):
        np.testing.assert_array_equal(getattr(after, part), getattr(one.splats, part))
