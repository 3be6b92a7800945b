"""Pixels and Gaussians lie where the analytic scene says they do, in the frame of their own body."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, BALL_RADIUS, BOX, TABLE, ball_at, scene

from rpaug import Body, Gaussians, Scene, Unsupported
from rpaug.core.geometry import rigid, transform
from rpaug.core.types import Surface
from rpaug.scene.recorded import pooled, surface

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}
LENGTH = 5


def tracked() -> Scene:
    """The scene with the ball's true track, its own frame being where it starts."""
    poses = np.tile(np.eye(4), (LENGTH, 1, 1))
    poses[:, :3, 3] = np.array([ball_at(t, LENGTH) - ball_at(0, LENGTH) for t in range(LENGTH)])
    still = np.tile(np.eye(4), (LENGTH, 1, 1))
    bodies = (
        Body(frozenset({TABLE, BOX}), still, "static"),
        Body(frozenset({BALL}), poses, "aligned"),
    )
    return replace(scene(EYES, length=LENGTH), bodies=bodies)


def seen(recorded: Scene, name: str, t: int, instance_id: int) -> surface.PixelSurface:
    view = recorded.episode.views[name]
    ids = view.ids(t)
    rows = np.flatnonzero(ids == instance_id)
    return surface.of_view(view, t, recorded.bodies, ids)(rows)


@pytest.mark.parametrize("name", list(EYES))
@pytest.mark.parametrize("t", [0, LENGTH - 1])
def test_the_ball_stays_in_its_own_frame_in_every_camera_and_frame(name: str, t: int) -> None:
    here = seen(tracked(), name, t, BALL)
    offset = here.points - ball_at(0, LENGTH)
    assert np.abs(np.linalg.norm(offset, axis=1) - BALL_RADIUS).max() < 1e-5
    likeness = (here.normals * offset).sum(1) / BALL_RADIUS
    assert np.median(likeness) > 0.99  # a plane through neighbours, on a curved surface
    assert likeness.min() > 0.8


@pytest.mark.parametrize("name", list(EYES))
def test_planes_have_their_exact_normal_and_footprint(name: str) -> None:
    recorded = tracked()
    table = seen(recorded, name, 2, TABLE)
    assert np.abs(table.points[:, 2]).max() < 1e-5
    assert np.quantile(table.normals[:, 2], 0.01) > 0.9999
    assert np.array_equal(table.normals, table.facing)
    camera = recorded.cameras[name]
    ray = table.points - camera.cam_to_world[2, :3, 3]
    distance = np.linalg.norm(ray, axis=1)
    z = ray @ camera.cam_to_world[2, :3, 2]
    focal = np.sqrt(camera.K[0, 0] * camera.K[1, 1])
    wanted = z / focal / np.sqrt(-ray[:, 2] / distance)
    assert np.quantile(np.abs(table.footprint / wanted - 1), 0.99) < 1e-3


def test_facing_turns_with_the_body_and_normals_do_not() -> None:
    recorded = tracked()
    turned = rigid(np.array([0.0, 0.0, 0.7]), np.array([0.3, 0.0, 0.0]))
    poses = np.tile(turned, (LENGTH, 1, 1))
    box = replace(recorded.bodies[0], instance_ids=frozenset({BOX}), to_world=poses)
    here = seen(replace(recorded, bodies=(box,)), "front", 0, BOX)
    assert np.allclose(here.normals @ turned[:3, :3].T, here.facing, atol=1e-6)
    axis = np.abs(here.facing).max(1)
    assert (axis > 0.9999).mean() > 0.95  # strips one pixel wide along a crease cannot tell


def test_depth_is_decoded_only_for_who_asks() -> None:
    recorded = tracked()
    view = replace(recorded.episode.views["front"], depth=lambda t: 1 / 0)
    here = surface.of_view(view, 0, recorded.bodies, view.ids(0))(np.arange(10))
    assert here.ids.shape == (10,)
    with pytest.raises(ZeroDivisionError):
        _ = here.points
    blind = surface.of_view(replace(view, depth=None), 0, (), None)(np.arange(10))
    with pytest.raises(Unsupported, match="depth"):
        _ = blind.facing


def test_thin_things_and_missing_depth_give_finite_unit_normals() -> None:
    depth = np.zeros((3, 3), np.float32)
    depth[1, 1] = 2.0
    K = np.array([[50.0, 0, 1], [0, 50, 1], [0, 0, 1]])
    points, normals, footprint = surface.lift(
        depth,
        np.arange(9, dtype=np.int32).reshape(3, 3),
        K,
        np.eye(4),
        np.arange(9),
        pooled.nothing(3, 3),
    )
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    assert np.allclose(normals[4], [0, 0, -1])
    assert np.allclose(points[4], [0, 0, 2])
    assert np.isfinite(footprint).all()


def test_gaussians_face_the_camera_and_keep_their_frame() -> None:
    recorded = tracked()
    rng = np.random.default_rng(0)
    count = 40
    scales = np.tile(np.float32([0.02, 0.001, 0.03]), (count, 1))
    gaussians = Gaussians(
        means=(ball_at(0, LENGTH) + rng.normal(size=(count, 3)) * 0.05).astype(np.float32),
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        scales=scales, opacities=np.ones(count, np.float32),
        sh=np.zeros((count, 1, 3), np.float32), ids=np.full(count, BALL, np.int32),
    )  # fmt: skip
    camera, t = recorded.cameras["front"], LENGTH - 1
    rows = np.arange(0, count, 2)
    here = surface.of_gaussians(gaussians, camera, t, recorded.bodies)(rows)
    assert np.array_equal(here.points, gaussians.means[rows])
    world = transform(recorded.bodies[1].to_world[t], here.points)
    assert (((world - camera.cam_to_world[t, :3, 3]) * here.facing).sum(1) <= 0).all()
    assert np.allclose(np.linalg.norm(here.normals, axis=1), 1, atol=1e-5)
    assert np.allclose(here.footprint, 0.04)


def test_depth_and_light_of_a_frame_are_asked_for_once_for_all_edits() -> None:
    recorded, asked = tracked(), []
    view = recorded.episode.views["front"]
    ids = view.ids(0)

    def depth(t: int) -> np.ndarray:
        asked.append("depth")
        return np.where(ids == TABLE, np.inf, view.depth(t))

    def light() -> np.ndarray:
        asked.append("light")
        return np.full(ids.shape, 0.5, np.float32)

    at = surface.of_view(replace(view, depth=depth), 0, recorded.bodies, ids, light=light)
    for instance_id in (TABLE, BOX, BALL):
        here = at(np.flatnonzero(ids == instance_id))
        assert (here.lit == 0.5).all()
        assert np.isfinite(here.points).all()  # where depth is none, at the camera
    assert sorted(asked) == ["depth", "light"]


def test_places_that_rest_before_a_fixed_camera_are_asked_about_once() -> None:
    recorded, name, asked = tracked(), "front", []
    view, pool = recorded.episode.views[name], pooled.of_camera(recorded.episode, name)

    def find(here: Surface) -> np.ndarray:
        asked.append(len(here.ids))
        return np.column_stack([here.points, here.facing, here.footprint, here.ids])

    known = surface.KnownPlaces()
    for t in range(LENGTH):
        ids = view.ids(t)
        rows = np.flatnonzero((view.depth(t) > 0) & np.isfinite(view.depth(t)))
        told = [
            surface.of_places(
                surface.of_view(view, t, recorded.bodies, ids, lambda: pool, known=each)(rows),
                recorded,
                find,
            )
            for each in (known, None)
        ]
        assert np.array_equal(*told)
    assert asked[0] == asked[1]  # nothing is known at first
    assert max(asked[2::2]) < 0.3 * asked[0]  # what moves, and what it uncovers


def test_pixels_of_what_moved_show_no_known_place():
    """Also of instance id 0, and where ids change within a row."""
    depth, ids = np.ones((4, 6), np.float32), np.array([[0, 0, 1, 2, 2, 1]] * 4, np.int32)
    held = np.ones((4, 6, 1, 9), np.float32)
    for away in ([], [0], [2], [0, 1]):
        found = surface._slots(
            depth, ids, np.arange(24), ids[..., None], held, 0.01, np.array(away, np.int32)
        )
        np.testing.assert_array_equal(found > 0, ~np.isin(ids, away).ravel())
