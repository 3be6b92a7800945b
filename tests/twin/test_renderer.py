"""The pictures: cameras mean what they state, depth is metric, a pixel names one body."""

import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest

from rpaug import Unsupported, twin
from rpaug.core import geometry
from rpaug.core.types import CameraView
from rpaug.twin import cameras, renderer, tabletop, tasks
from rpaug.twin.motion import play

pytestmark = pytest.mark.gl


def pixels(view: CameraView, t: int, handle: int) -> np.ndarray:
    assert view.ids is not None
    return view.ids(t) == handle


def test_forward_kinematics_is_the_simulated_gripper():
    job = tasks.open_drawer(np.random.default_rng(0))
    motion = play(tabletop.ARM, job.script, job.placing, 12)
    world = tabletop.build(job.placing, np.random.default_rng(1), 2)
    with closing(renderer.Renderer(world, twin.Look(), 32)) as here:
        for t in range(motion.length):
            here.pose(motion.joint_positions[t], motion.opening[t], {})
            hand = np.eye(4)
            hand[:3, :3] = here.data.body("hand").xmat.reshape(3, 3)
            hand[:3, 3] = here.data.body("hand").xpos
            tip = hand @ geometry.rigid(np.zeros(3), np.array([0, 0, 0.1034]))
            np.testing.assert_allclose(tip, motion.gripper_to_world[t], atol=1e-9)
            left, right = (here.data.body(f"finger_{s}").xpos for s in ("left", "right"))
            assert np.linalg.norm(left - right) == pytest.approx(2 * motion.opening[t], abs=1e-9)


@pytest.mark.parametrize("size", [128, 200])
def test_intrinsics_hold_at_integer_pixel_centres(size):
    # The table is a plane at a known height: half a pixel of error would show as 0.1 mm and more.
    take = twin.perform("pick_block", 0, size=size, frames=17)
    for name, view in take.episode.views.items():
        points = geometry.world_points(view.depth(0), view.camera, 0)
        on_top = pixels(view, 0, take.truth.handles["table"]) & (points[..., 2] > 0.74)
        assert on_top.sum() > 0.02 * size**2, name
        assert np.abs(points[on_top][:, 2] - tabletop.TABLE).max() < 2e-5, name


@pytest.mark.parametrize("t", [0, 15])
@pytest.mark.parametrize(
    "pair", [("front", "overhead"), ("left_shoulder", "right_shoulder"), ("wrist", "overhead")]
)
def test_cameras_agree_on_depth(drawer, pair, t):
    first, second = (drawer.episode.views[name] for name in pair)
    convex = ("table", "floor", "pad", "block_plain", "block_two_coloured", "block_textured")
    errors = disagreement(first, second, t, [drawer.truth.handles[name] for name in convex])
    assert len(errors) > 50
    # The few others lie where one face of a thing hides another of its own within 2 cm.
    assert np.quantile(errors, 0.97) < 1e-4


def disagreement(first: CameraView, second: CameraView, t: int, handles: list[int]) -> np.ndarray:
    """|depth of the first's points in the second - its depth there|, where both saw one flat face of a handle.

    On a plane the inverse of depth is affine in the pixel, so that interpolating it between pixels is exact.
    """
    points = geometry.world_points(first.depth(t), first.camera, t)
    at, z = geometry.project(points, second.camera, t)
    corner = np.floor(at).astype(int)
    inside = ((corner >= 0) & (corner < second.camera.width - 1)).all(-1) & (z > 0)
    (column, row), (x, y) = corner[inside].T, (at - corner)[inside].T
    places = [(row + down, column + right) for down in (0, 1) for right in (0, 1)]
    weights = [(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x]
    a, b, c, d = inverse = np.array([1 / second.depth(t)[place] for place in places])
    error = np.abs(1 / np.sum(weights * inverse, 0) - z[inside])
    facing = np.isin(first.ids(t)[inside], handles) & (error < 0.02)
    same = np.all([second.ids(t)[place] == first.ids(t)[inside] for place in places], 0)
    flat = np.abs(a - b - c + d) < 1e-5
    return error[same & flat & facing]


@pytest.mark.parametrize("antialias", [False, True])
def test_a_pixel_names_one_part(antialias):
    take = twin.perform("open_drawer", 1, frames=11, look=twin.Look(antialias=antialias))
    known = set(take.truth.handles.values())
    for view in take.episode.views.values():
        for t in range(11):
            assert set(np.unique(view.ids(t))) <= known
            assert (view.depth(t) > 0).all()


def test_antialiasing_touches_edges_of_color_only():
    hard, soft = (
        twin.perform("open_drawer", 1, frames=11, look=twin.Look(antialias=on)).episode.views[
            "front"
        ]
        for on in (False, True)
    )
    np.testing.assert_array_equal(hard.depth(5), soft.depth(5))
    np.testing.assert_array_equal(hard.ids(5), soft.ids(5))
    differs = (hard.rgb(5) != soft.rgb(5)).any(-1)
    assert 0.005 < differs.mean() < 0.5


@pytest.mark.parametrize(("switch", "sign"), [("shadows", -1), ("specular", 1)])
def test_shadows_darken_and_highlights_brighten(switch, sign):
    plain, other = (
        twin.perform("open_drawer", 1, frames=11, look=look).episode.views["front"]
        for look in (twin.Look(), twin.Look(**{switch: True}))
    )
    np.testing.assert_array_equal(plain.depth(5), other.depth(5))
    np.testing.assert_array_equal(plain.ids(5), other.ids(5))
    change = sign * (other.rgb(5).astype(int) - plain.rgb(5))
    assert (change > 20).any(-1).mean() > 0.02
    assert change.min() >= -2  # a light that is drawn in a pass of its own is rounded once more


def test_nothing_is_beyond_the_far_plane(drawer, block):
    for take in (drawer, block):
        for name, view in take.episode.views.items():
            assert all((view.ids(t) > 0).all() for t in range(take.episode.length)), name
            assert max(view.depth(t).max() for t in range(take.episode.length)) < cameras.FAR[name]


def test_the_wrist_is_rigid_to_the_gripper(drawer):
    wrist = drawer.episode.views["wrist"].camera.cam_to_world
    held = geometry.inverse(drawer.episode.robot.gripper_to_world) @ wrist
    np.testing.assert_allclose(held, np.tile(cameras.WRIST, (len(held), 1, 1)), atol=1e-12)
    for name in ("front", "left_shoulder", "right_shoulder", "overhead"):
        assert drawer.episode.views[name].camera.fixed


def test_the_drawer_is_seen_where_its_pose_says(drawer):
    view, handle = drawer.episode.views["left_shoulder"], drawer.truth.handles["drawer"]
    track = drawer.poses["drawer"]
    t = drawer.truth.key_frames[3]
    points = geometry.world_points(view.depth(t), view.camera, t)[pixels(view, t, handle)]
    local = geometry.transform(geometry.inverse(track[t]), points)
    assert len(points) > 100
    # Inside the box that the drawer fills in its own frame.
    assert (local > [-0.121, -0.141, 0.09]).all()
    assert (local < [0.135, 0.141, 0.206]).all()


def test_the_fingers_close_on_the_grip(drawer):
    t = drawer.truth.key_frames[2]
    tip, track = drawer.episode.robot.gripper_to_world[t], drawer.poses["drawer"]
    np.testing.assert_allclose(tip[:3, 3], geometry.transform(track[t], tabletop.GRIP), atol=1e-8)
    assert drawer.episode.robot.gripper_open[t] == 0.0


def test_hidden_depth_buffer_is_reversed():
    # Depth is solved for under this assumption; MuJoCo must be told before every reading.
    world = tabletop.build(
        tasks.open_drawer(np.random.default_rng(0)).placing, np.random.default_rng(1), 2
    )
    with closing(renderer.Renderer(world, twin.Look(), 16)) as here:
        assert here._exact.readDepthMap == mujoco.mjtDepthMap.mjDEPTH_ZEROFAR


def test_missing_opengl_names_the_packages(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with pytest.raises(Unsupported, match="libegl1 libgl1-mesa-dri"):
        renderer.open_gl(16)


def test_missing_driver_names_the_packages(tmp_path):
    # A fresh interpreter whose EGL loader finds no driver at all.
    code = (
        "from rpaug import Unsupported\nfrom rpaug.twin.renderer import open_gl\n"
        "try:\n    open_gl(16)\nexcept Unsupported as error:\n    print(error)\n"
    )
    hidden = {"__EGL_VENDOR_LIBRARY_FILENAMES": str(tmp_path / "none.json"), "MUJOCO_GL": "egl"}
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **hidden}, capture_output=True, text=True
    )
    assert "libegl1 libgl1-mesa-dri" in done.stdout, done.stderr


@pytest.mark.parametrize(
    "triton",
    [
        "assert 'libLLVM' not in open('/proc/self/maps').read(), 'after Mesa'",
        "raise ImportError('a broken install')",
    ],
    ids=["whole", "broken"],
)
def test_triton_is_loaded_before_mesa_or_not_at_all(triton: str, tmp_path: Path) -> None:
    """The other way round libtriton takes Mesa's LLVM for its own, and the process dies."""
    (tmp_path / "triton.py").write_text(triton)
    script = "import sys\nfrom rpaug.twin.renderer import open_gl\nopen_gl(8)\n"
    script += "assert ('triton' in sys.modules) == (sys.argv[1] == 'whole')"
    word = "broken" if "broken" in triton else "whole"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script, word], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_walls_cast_no_shadow():
    """Lamps hang inside the room; the arm alone darkens walls and floor."""
    both = [
        twin.perform("open_drawer", 0, frames=17, look=twin.Look(shadows=one, lamps=twin.RIG[:1]))
        for one in (False, True)
    ]
    handles = both[0].truth.handles
    plain, shaded = (take.episode.views["overhead"].rgb(0).astype(int) for take in both)
    ids = both[0].episode.views["overhead"].ids(0)
    assert (plain - shaded)[ids == handles["floor"]].max() <= 1
    assert (plain - shaded)[ids == handles["table"]].max() > 20
