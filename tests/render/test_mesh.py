"""Triangles against rays shot at them: depth, normals, colors and which is in front."""

import numpy as np
from analytic import look, pinhole

from rpaug.assets import shapes
from rpaug.render import mesh

WHITE = np.full((4, 4, 3), 255, np.uint8)


def camera():
    return pinhole(80, 64, 90.0), look((0.4, -0.7, 0.5), (0.0, 0.0, 0.05))


def test_a_box_is_where_rays_hit_it():
    K, pose = camera()
    size = np.array([0.2, 0.3, 0.1])
    thing = shapes.joined([shapes.box(tuple(size), WHITE)])
    seen = mesh.draw(thing, np.eye(4), K, pose, (80, 64))
    rows, columns = np.mgrid[:64, :80]
    local = np.stack(
        [(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones((64, 80))], -1
    )
    rays, eye = local @ pose[:3, :3].T, pose[:3, 3]
    low, high = np.array([-0.1, -0.15, 0.0]), np.array([0.1, 0.15, 0.1])
    with np.errstate(divide="ignore"):
        a, b = (low - eye) / rays, (high - eye) / rays
    enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    hit = (enter < leave) & (enter > 0)
    assert (hit != seen.hit).mean() < 0.002  # rays along an edge
    both = hit & seen.hit
    np.testing.assert_allclose(seen.depth[both], enter[both], rtol=1e-9)
    axis = np.minimum(a, b).argmax(-1)
    np.testing.assert_allclose(np.abs(seen.normals[both]).max(-1), 1, atol=1e-6)
    assert (np.abs(seen.normals[both]).argmax(-1) == axis[both]).all()
    assert ((seen.normals[both] * rays[both]).sum(-1) < 0).all()
    np.testing.assert_allclose(seen.albedo[both], 1, atol=1e-6)


def test_the_picture_lies_where_it_should_and_far_ones_are_averaged():
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32] = 255  # the upper half is white
    thing = shapes.joined([shapes.box((0.2, 0.2, 0.2), picture)])
    K, pose = pinhole(64, 64, 200.0), look((0.0, -0.9, 0.1), (0.0, 0.0, 0.1))
    seen = mesh.draw(thing, np.eye(4), K, pose, (64, 64))
    rows, columns = np.nonzero(seen.hit)
    middle = columns == 32
    top, bottom = rows[middle].min(), rows[middle].max()
    assert seen.albedo[top + 2, 32].min() > 0.95
    assert seen.albedo[bottom - 2, 32].max() < 0.05
    fine = (np.indices((64, 64)).sum(0) % 2 * 255).astype(np.uint8)
    checks = shapes.joined([shapes.box((0.2, 0.2, 0.2), np.stack([fine] * 3, -1))])
    far = mesh.draw(
        checks, np.eye(4), pinhole(64, 64, 200.0), look((0, -4.0, 0.1), (0, 0, 0.1)), (64, 64)
    )
    assert np.abs(far.albedo[far.hit] - 0.5).max() < 0.1


def test_nothing_behind_the_camera_is_drawn():
    thing = shapes.joined([shapes.box((0.2, 0.2, 0.2), WHITE)])
    pose = look((0.0, -0.9, 0.1), (0.0, -2.0, 0.1))
    assert not mesh.draw(thing, np.eye(4), pinhole(), pose, (96, 80)).hit.any()
