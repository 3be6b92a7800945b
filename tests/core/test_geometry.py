"""Rigid motions and the integer-centred pinhole."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpaug import Camera
from rpaug.core import geometry

SMALL = st.floats(-3, 3, allow_nan=False)
TURN = arrays(float, 3, elements=SMALL)


@given(TURN, TURN)
def test_inverse_undoes_a_motion(turn: np.ndarray, shift: np.ndarray) -> None:
    motion = geometry.rigid(turn, shift)
    assert np.allclose(geometry.inverse(motion) @ motion, np.eye(4), atol=1e-12)
    assert np.allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-12)


@given(TURN, TURN)
def test_the_origin_goes_where_it_is_shifted(turn: np.ndarray, shift: np.ndarray) -> None:
    assert np.array_equal(geometry.transform(geometry.rigid(turn, shift), np.zeros(3)), shift)


@given(st.floats(0, 1e-6), TURN)
def test_tiny_rotations_are_exact(angle: float, axis: np.ndarray) -> None:
    length = np.linalg.norm(axis)
    if length < 1e-3:
        return
    turn = axis / length * angle
    x, y, z = turn
    first_order = np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert np.abs(geometry.rotation(turn) - first_order).max() < 1e-11


@given(TURN)
def test_quaternions_go_there_and_back(turn: np.ndarray) -> None:
    pose = geometry.rigid(turn, np.array([1.0, 2.0, 3.0]))
    quaternion = geometry.quaternion_of(pose)
    assert quaternion[3] >= 0
    assert np.allclose(geometry.pose_of(pose[:3, 3], quaternion * 5.0), pose, atol=1e-9)


def test_half_turns_have_quaternions() -> None:
    for axis in np.eye(3):
        pose = geometry.rigid(np.pi * axis, np.zeros(3))
        assert np.allclose(
            geometry.pose_of(np.zeros(3), geometry.quaternion_of(pose)), pose, atol=1e-9
        )


@given(TURN, TURN)
def test_a_pixel_lifted_and_projected_comes_back(turn: np.ndarray, shift: np.ndarray) -> None:
    K = np.array([[100.0, 0, 3.2], [0, 110.0, 2.7], [0, 0, 1]])
    camera = Camera(K, geometry.rigid(turn, shift)[None], 7, 5)
    depth = np.linspace(0.5, 2.0, 35).reshape(5, 7)
    pixels, z = geometry.project(geometry.world_points(depth, camera, 0), camera, 0)
    rows, columns = np.mgrid[:5, :7]
    assert np.allclose(pixels, np.stack([columns, rows], -1), atol=1e-9)
    assert np.allclose(z, depth)


def test_a_point_on_the_axis_falls_on_the_principal_point() -> None:
    camera = Camera(np.array([[50.0, 0, 64], [0, 50, 64], [0, 0, 1]]), np.eye(4)[None], 128, 128)
    pixel, depth = geometry.project(np.array([0.0, 0.0, 2.0]), camera, 0)
    assert np.array_equal(pixel, [64, 64])
    assert depth == 2


K = np.array([[60.0, 0, 21.5], [0, 70, 14], [0, 0, 1]])


def test_rays_lift_to_points_that_fall_back_on_their_pixels() -> None:
    depth = np.random.default_rng(2).uniform(0.5, 3, (30, 40))
    rows, columns = np.mgrid[:30, :40]
    local = geometry.unproject(depth, K)
    np.testing.assert_allclose(geometry.rays(columns, rows, K) * depth[..., None], local)
    np.testing.assert_array_equal(geometry.lifted(columns, rows, depth, K), local)
    column, row = geometry.to_image(local, depth, K)
    np.testing.assert_allclose(column, columns, atol=1e-9)
    np.testing.assert_allclose(row, rows, atol=1e-9)
    found = geometry.in_image(local, K, depth.shape)
    np.testing.assert_array_equal(found[0], rows)
    np.testing.assert_array_equal(found[1], columns)
    assert found[2].all()


def test_points_beside_or_behind_an_image_fall_on_no_pixel() -> None:
    ahead, beside, behind, close = [0, 0, 1], [5, 0, 1], [0, 0, -1], [0, 0, 0.01]
    points = np.array([ahead, beside, behind, close], float)
    row, column, inside = geometry.in_image(points, K, (30, 40), near=0.02)
    assert inside.tolist() == [True, False, False, False]
    assert row.tolist() == [14, 0, 0, 0]
    assert column.tolist() == [22, 0, 0, 0]
