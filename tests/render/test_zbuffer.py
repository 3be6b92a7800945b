"""Surfels against a scene known in closed form, and on inputs that are hard."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BOX, TABLE, look, pinhole, shoot
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core import geometry
from rpaug.render.zbuffer import PIECE, Source, carve, render, to_bytes

EYE, AT = (0.1, -0.7, 0.9), (0.0, 0.0, 0.05)


def source(eye=EYE, at=AT, width=96, height=80, ball=None, **how) -> Source:
    K, pose = pinhole(width, height), look(eye, at)
    rgb, depth, ids = shoot(K, pose, width, height, ball)
    return Source(K=K, cam_to_world=pose, rgb=rgb, depth=depth, ids=ids, **how)


def psnr(a, b) -> float:
    return -10 * np.log10(np.mean((a.astype(float) / 255 - b.astype(float) / 255) ** 2))


@pytest.mark.parametrize("size", [(96, 80), (61, 131)])
def test_moved_camera_agrees_with_the_closed_form(size):
    """Depth is exact on planes, color as good as cubic interpolation of a pattern of ten-pixel period."""
    K = pinhole(*size, focal=120.0)
    pose = look(EYE, AT) @ geometry.rigid(
        np.array([0.03, -0.04, 0.05]), np.array([0.06, -0.05, 0.08])
    )
    view = render(K, pose, size, [source(width=128, height=112)])
    rgb, depth, ids = shoot(K, pose, *size)
    seen = ~view.hole & (depth > 0)
    assert seen.mean() > 0.6  # the rest looks past the table
    error = np.abs(view.depth - depth)[seen]
    assert np.median(error) < 1e-6  # float32 rounding at 1 m
    assert np.mean(error > 0.02) < 0.02  # silhouettes, to half a recorded pixel
    assert np.mean((view.ids == ids)[seen]) > 0.98
    same = seen & (view.ids == ids) & (np.abs(view.depth - depth) < 1e-3)
    assert psnr(view.image[same], rgb[same]) > 38


@pytest.mark.parametrize("width", [96, 2 * PIECE + 37])
def test_the_recorded_camera_gives_the_recorded_image(width):
    recorded = source(distant=True, at=(0.0, 0.3, 0.45), width=width)
    assert (recorded.depth == 0).any()  # sky
    view = render(recorded.K, recorded.cam_to_world, (width, 80), [recorded])
    np.testing.assert_array_equal(view.image, recorded.rgb)
    np.testing.assert_array_equal(view.depth, recorded.depth)
    np.testing.assert_array_equal(view.ids, recorded.ids)
    assert not view.hole.any()


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-0.2, 0.2), min_size=6, max_size=6))
def test_a_plane_stays_without_cracks(motion):
    """Whatever the motion, a drawn table has no pin-hole: every hole touches the border of what was recorded."""
    flat = source(eye=(0.0, -0.4, 3.0), at=(0.0, 0.0, 0.0))
    flat = replace(flat, ids=np.full_like(flat.ids, TABLE), depth=_plane_depth(flat))
    pose = flat.cam_to_world @ geometry.rigid(np.array(motion[:3]), np.array(motion[3:]))
    view = render(flat.K, pose, (96, 80), [flat])
    around = np.zeros((78, 94), int)
    for i in range(3):
        for j in range(3):
            around += ~view.hole[i : i + 78, j : j + 94]
    assert not (view.hole[1:-1, 1:-1] & (around == 8)).any()


def _plane_depth(flat: Source) -> np.ndarray:
    rays = geometry.unproject(np.ones((80, 96)), flat.K) @ flat.cam_to_world[:3, :3].T
    return (-flat.cam_to_world[2, 3] / rays[..., 2]).astype(np.float32)


def test_the_world_origin_does_not_matter():
    K, pose = pinhole(), look((0.15, -0.85, 0.65), AT)
    here = render(K, pose, (96, 80), [source()])
    far = np.eye(4)
    far[:3, 3] = 1e4, -2e4, 5e3
    moved = replace(source(), cam_to_world=far @ source().cam_to_world)
    there = render(K, far @ pose, (96, 80), [moved])
    np.testing.assert_allclose(there.depth, here.depth, atol=1e-6)  # 1e4 m * 2**-52, magnified
    assert (
        there.image == here.image
    ).mean() > 0.999  # a color may fall on the other side of a half


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_the_unit_of_length_does_not_matter(factor):
    def scaled(pose):
        return np.concatenate(
            [np.concatenate([pose[:3, :3], pose[:3, 3:] * factor], 1), pose[3:]], 0
        )

    pose = look((0.15, -0.85, 0.65), AT)
    plain = render(pinhole(), pose, (96, 80), [source()])
    big = replace(source(), cam_to_world=scaled(source().cam_to_world))
    big = replace(big, depth=(source().depth.astype(np.float64) * factor).astype(np.float32))
    view = render(pinhole(), scaled(pose), (96, 80), [big])
    assert (view.hole == plain.hole).mean() > 0.999
    both = ~view.hole & ~plain.hole
    np.testing.assert_allclose(view.depth[both] / factor, plain.depth[both], rtol=2e-3)


def test_nearest_wins_and_the_earlier_source_within_the_tolerance():
    pose = np.eye(4)
    K = pinhole(8, 6)

    def wall(depth, grey, **how):
        return Source(
            K=K, cam_to_world=pose, rgb=np.full((6, 8, 3), grey, np.uint8),
            depth=np.full((6, 8), depth, np.float32), ids=np.full((6, 8), grey, np.int32), **how,
        )  # fmt: skip

    assert (render(K, pose, (8, 6), [wall(2, 10), wall(1.9, 20)]).ids == 20).all()
    assert (render(K, pose, (8, 6), [wall(2, 10), wall(1.995, 20)]).ids == 10).all()
    assert (render(K, pose, (8, 6), [wall(2, 10), wall(2.1, 20)]).ids == 10).all()
    carved = render(K, pose, (8, 6), [wall(2, 10), wall(1.9, 20, carved=True)], witness=wall(2, 10))
    assert (carved.ids == 10).all()
    behind = render(K, pose, (8, 6), [wall(2, 20, carved=True)], witness=wall(1.9, 10))
    assert (behind.ids == 20).all()  # hidden is not carved


def _painted_plane(eye: tuple[float, float, float], shade: int) -> Source:
    """The table's plane alone from `eye`, in one grey."""
    flat = source(eye=eye, at=(0.0, 0.0, 0.0))
    depth = _plane_depth(flat)
    rgb = np.full_like(flat.rgb, shade)
    return replace(
        flat, rgb=rgb, ids=np.full_like(flat.ids, TABLE), depth=np.where(depth > 0, depth, 0)
    )


def test_a_finer_recording_comes_before_a_stretched_one():
    above = _painted_plane((0.0, -0.1, 1.0), 200)
    slanted = _painted_plane((0.0, -1.4, 0.8), 50)
    view = render(above.K, above.cam_to_world, (96, 80), [slanted, above])
    middle = np.s_[30:50, 38:58]
    assert (view.image[middle] == 200).all()
    alone = render(above.K, above.cam_to_world, (96, 80), [slanted])
    drawn = ~alone.hole
    assert drawn[middle].all()
    assert alone.rough[drawn].any()  # stretched, and said so
    assert not view.rough[middle].any()


def test_streaks_are_not_drawn():
    """From above, a table seen from its edge is a hole; a camera that only came nearer draws all of it."""
    grazing = _painted_plane((0.0, -1.4, 0.15), 50)
    above = look((0.0, -0.1, 1.0), (0.0, 0.0, 0.0))
    assert render(grazing.K, above, (96, 80), [grazing]).hole[30:50, 38:58].all()
    far = _painted_plane((0.0, -0.6, 6.0), 50)
    near = render(far.K, look((0.0, -0.1, 1.0), (0.0, 0.0, 0.0)), (96, 80), [far])
    assert not near.hole.any()
    assert near.rough.all()  # one recorded pixel is six


def test_what_was_put_elsewhere_has_no_streaks_either():
    grazing = replace(_painted_plane((0.0, -1.4, 0.15), 50), before=True)
    above = _painted_plane((0.0, -0.1, 1.0), 200)
    view = render(above.K, above.cam_to_world, (96, 80), [above, grazing])
    assert (view.source[30:50, 38:58] == 0).all()
    slanted = replace(_painted_plane((0.0, -1.4, 0.8), 50), before=True)
    view = render(above.K, above.cam_to_world, (96, 80), [above, slanted])
    assert (view.source[30:50, 38:58] == 1).all()
    assert view.rough[30:50, 38:58].any()


def test_coarse_recordings_do_not_color_what_finer_ones_show():
    """Beside the first, recordings of a place are averaged: as fine ones, not one whose pixel spans six of theirs."""
    near, far = _painted_plane((0.0, -0.1, 1.0), 200), _painted_plane((0.0, -0.6, 6.0), 50)
    first = replace(near, use=np.zeros(near.ids.shape, bool))
    middle = np.s_[30:50, 38:58]

    def gray(*others: Source) -> np.ndarray:
        return render(near.K, near.cam_to_world, (96, 80), [first, *others]).image[middle]

    assert (gray(near, far) == 200).all()
    assert (gray(near, replace(near, rgb=np.full_like(near.rgb, 100))) == 150).all()
    assert (gray(far) == 50).all()


def test_colors_never_cross_ids():
    """A red thing on a black one, moved by half a pixel: no pixel is a mixture."""
    K, depth = pinhole(16, 16), np.full((16, 16), 1.0, np.float32)
    ids = np.where(np.arange(16) < 8, 1, 2) * np.ones((16, 1), np.int32)
    rgb = np.where((ids == 1)[..., None], [255, 0, 0], [0, 0, 0]).astype(np.uint8)
    pose = np.eye(4)
    pose[0, 3] = 0.5 / K[0, 0]
    view = render(K, pose, (16, 16), [Source(K, np.eye(4), rgb, depth, ids.astype(np.int32))])
    drawn = view.image[~view.hole]
    assert set(map(tuple, drawn.tolist())) == {(255, 0, 0), (0, 0, 0)}


def hard_cases():
    plain = source()
    holes = plain.depth.copy()
    holes[::3, ::2] = 0
    holes[1::7] = np.nan
    holes[2::9] = np.inf
    holes[4::9] = -1
    tiny = Source(
        K=np.array([[100.0, 0, 0], [0, 100.0, 0], [0, 0, 1]]), cam_to_world=plain.cam_to_world,
        rgb=np.full((1, 1, 3), 9, np.uint8), depth=np.ones((1, 1), np.float32), ids=np.ones((1, 1), np.int32),
    )  # fmt: skip
    inside = look((0.0, 0.0, 0.12), (0.0, 0.5, 0.0))
    away = look((0.1, -0.9, 0.6), (0.1, -2.0, 0.6))
    grazing = look((0.0, -0.6, 1e-4), (0.0, 0.0, 0.0))
    here = plain.cam_to_world
    return {
        "depth holes": (replace(plain, depth=holes, distant=True), here),
        "one pixel": (tiny, here),
        "inside the box": (plain, inside),
        "everything behind": (plain, away),
        "along the table": (plain, grazing),
        "touching a surface": (plain, look((0.0, -0.1 - 1e-9, 0.12), (0.0, 1.0, 0.12))),
        "nothing recorded": (replace(plain, depth=np.zeros_like(plain.depth)), here),
        "nothing used": (replace(plain, use=np.zeros(plain.depth.shape, bool)), here),
        "turned half round": (plain, here @ geometry.rigid(np.array([0, 0, np.pi]), np.zeros(3))),
    }


@pytest.mark.parametrize("name", hard_cases())
def test_hard_inputs_stay_finite(name):
    hard, pose = hard_cases()[name]
    for size in ((96, 80), (1, 1), (7, 3)):
        view = render(pinhole(*size), pose, size, [hard, replace(hard, carved=True)], witness=hard)
        assert np.isfinite(view.depth).all()
        assert view.depth.min() >= 0
        assert view.rgb.min() >= 0  # false for NaN too
        assert view.rgb.max() <= 1
        assert ((view.source < 0) == view.hole).all()
        assert (view.ids[view.hole] == 0).all()
        assert set(np.unique(view.ids)) <= {0, *np.unique(hard.ids).tolist()}


def test_a_box_is_not_seen_from_inside():
    hard, pose = hard_cases()["inside the box"]
    assert not (render(pinhole(), pose, (96, 80), [hard]).ids == BOX).any()


def test_to_bytes_undoes_the_division():
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, 2)
    np.testing.assert_array_equal(to_bytes((grey / 255.0).astype(np.float32)), grey)


def test_what_a_witness_saw_through_is_carved():
    """A plane at 1 m, and a witness beside it that saw a wall at 2 m in place of its left half."""
    K, pose, there = pinhole(16, 12), np.eye(4), np.eye(4)
    there[0, 3] = 0.01
    depth = np.ones((12, 16), np.float32)
    seen = np.where(np.arange(16) < 8, 2.0, 1.0) * np.ones((12, 1))
    rgb, ids = np.zeros((12, 16, 3), np.uint8), np.zeros((12, 16), np.int32)
    witness = Source(K, there, rgb, seen.astype(np.float32), ids)
    shown = np.ones((12, 16), bool)
    shown[0] = False
    carve(shown, depth, K, pose, [witness], 0.006)
    assert not shown[0].any()
    assert not shown[1:, 1:7].any()
    assert shown[1:, 10:].all()
