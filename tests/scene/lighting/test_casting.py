"""What a lamp reaches of a floor under a small plate."""

from dataclasses import replace

import numpy as np
from analytic import BALL, EYES, scene

from rpaug.core.types import Mesh
from rpaug.scene.lighting import casting, rig


def plate(height, side, step=0.005):
    across = np.arange(-side / 2, side / 2, step)
    x, y = (one.ravel() for one in np.meshgrid(across, across))
    points = np.stack([x, y, np.full(len(x), height)], -1).astype(np.float32)
    normals = np.tile(np.array([0, 0, 1], np.float32), (len(x), 1))
    return casting.Discs(points, normals, np.full(len(x), step, np.float32))


def test_a_plate_casts_its_outline_along_the_light():
    floor, lid = plate(0.0, 0.6), plate(0.1, 0.1)
    towards = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    lit = casting.light_map(casting.joined([floor, lid]), towards).reached(floor)
    moved = floor.points[:, 0] + 0.1  # the shadow lies as far from the lamp as the plate is high
    inside = (np.abs(moved) < 0.04) & (np.abs(floor.points[:, 1]) < 0.04)
    edge = 0.05 + casting.LIFT + 1.5 * casting.CELL  # places are looked up a little above, in cells
    outside = (np.abs(moved) > edge) | (np.abs(floor.points[:, 1]) > edge)
    assert (lit[inside] == 0).all()
    assert (lit[outside] == 1).all()


def test_a_surface_does_not_shade_itself_in_grazing_light():
    floor = plate(0.0, 0.6)
    towards = np.array([np.cos(0.3), 0.0, np.sin(0.3)])
    assert (casting.light_map(floor, towards).reached(floor) == 1).all()


def test_of_near_discs_the_narrowest_is_kept():
    fine, coarse = plate(0.0, 0.02), plate(0.0, 0.02, 0.01)
    kept = casting.thinned(casting.joined([coarse, fine]), 0.005)
    assert (kept.width == np.float32(0.005)).all()


def test_nothing_casts_no_shadow():
    none, floor = casting.joined([]), plate(0.0, 0.1)
    assert (casting.light_map(none, np.array([0.0, 0, 1])).reached(floor) == 1).all()


def test_maps_of_one_time_are_drawn_once_and_are_those_drawn_anew():
    still = np.broadcast_to(np.eye(4), (300, 4, 4))
    them = casting.Casters({1: (still, plate(0.1, 0.1))})
    lamps = ((0.0, 0.6, 0.8), (0.6, 0.0, 0.8))
    found = them.maps(3, lamps)
    assert all(a is b for a, b in zip(them.maps(3, lamps), found, strict=True))
    for one, direction in zip(found, lamps, strict=True):
        anew = casting.light_map(them.resting, np.array(direction))
        assert one.height.tobytes() == anew.height.tobytes()
    assert them.maps(3, lamps[1:]) == found[1:]  # one lamp's does not hang on the others


def test_what_moves_is_drawn_over_what_rests():
    still = np.broadcast_to(np.eye(4), (4, 4, 4))
    moving = still.copy()
    moving[:, 0, 3] = 0.05 * np.arange(4)
    lid = plate(0.1, 0.1)
    them = casting.Casters({1: (still, plate(0.0, 0.6)), 2: (moving, lid)})
    direction = (0.6, 0.0, 0.8)
    for t in range(4):
        there = casting.Discs(lid.points + np.float32([0.05 * t, 0, 0]), lid.normals, lid.width)
        both = casting.joined([them.resting, there])
        (made,) = them.maps(t, (direction,))
        anew = casting.light_map(both, np.array(direction))
        np.testing.assert_allclose(made.height, anew.height, atol=1e-6)
        np.testing.assert_array_equal(made.origin, anew.origin)
    beyond = casting.light_map(
        there, np.array(direction), over=casting.light_map(lid, np.array(direction))
    )
    assert beyond.height.shape[1] > casting.light_map(lid, np.array(direction)).height.shape[1]


def test_only_the_last_maps_are_kept():
    still = np.broadcast_to(np.eye(4), (300, 4, 4))
    them = casting.Casters({1: (still, plate(0.1, 0.02))})
    (first,) = them.maps(0, ((0.0, 0.0, 1.0),))
    for t in range(1, casting.KEPT + 1):
        them.maps(t, ((0.0, 0.0, 1.0),))
    assert them.maps(0, ((0.0, 0.0, 1.0),))[0] is not first


def test_a_mesh_casts_what_its_surface_hides():
    corners = np.array([[-1, -1, 0.1], [1, -1, 0.1], [1, 1, 0.1], [-1, 1, 0.1]]) * [0.05, 0.05, 1]
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    lid = casting.of_mesh(Mesh(corners, up, up[:, :2], faces, np.zeros((1, 1, 3), np.uint8)))
    assert (lid.normals == np.array([0, 0, 1], np.float32)).all()
    floor = plate(0.0, 0.6)
    lit = casting.light_map(lid, np.array([0.0, 0.0, 1.0])).reached(floor)
    far = np.abs(floor.points[:, :2]).max(1)
    assert (lit[far < 0.045] == 0).all()
    assert (lit[far > 0.05 + 1.5 * casting.CELL] == 1).all()


def test_the_cross_product_is_numpys():
    rng = np.random.default_rng(0)
    for one, other in rng.normal(size=(20, 2, 3)):
        assert casting.crossed(one, other).tobytes() == np.cross(one, other).tobytes()


def test_what_casts_is_found_once_whatever_colors_images_have() -> None:
    """Under cast shadows and highlights it was found anew for each image: scenes with and without highlights ask by
    turns."""
    recorded = rig.recorded(scene(EYES, length=2))
    views = {
        name: replace(view, rgb=lambda t, view=view: view.rgb(t) // 2)
        for name, view in recorded.episode.views.items()
    }
    dim = replace(recorded, episode=replace(recorded.episode, views=views))
    first = casting.casters(recorded)
    assert casting.casters(dim) is first
    assert casting.casters(recorded) is first
    moved = replace(recorded, roles={"background": frozenset([BALL])})
    assert casting.casters(moved) is not first
