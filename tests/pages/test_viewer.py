"""The viewer: points where surfaces are, Gaussians with their spread, a server that answers, a file that is whole."""

import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from rpaug.core import geometry, registry
from rpaug.core.errors import BadInput, MissingExtra
from rpaug.core.types import Gaussians
from rpaug.pages import live, rerun_file
from rpaug.pages.space import Space, of_episode
from rpaug.pipeline import recipe

DISTRACTOR = recipe.build({"version": 1, "edits": [{"op": "distractors", "count": 1}]})


@pytest.fixture(scope="module")
def recorded() -> Space:
    return of_episode(registry.SAMPLE, None, None, 1)


@pytest.fixture(scope="module")
def edited() -> Space:
    return of_episode(registry.SAMPLE, None, DISTRACTOR, 1)


def test_points_lie_where_their_pixels_are_seen(recorded: Space) -> None:
    """One camera's points come back to its own pixels, with their color and id."""
    view = recorded.episode.views["front"]
    alone = Space("", recorded.length, recorded.episode.__class__(**{
        **vars(recorded.episode), "views": {"front": view}
    }))  # fmt: skip
    cloud = alone.cloud(3, 500)
    assert 100 < len(cloud.points) <= 500
    local = geometry.transform(geometry.inverse(view.camera.cam_to_world[3]), cloud.points)
    pixels = np.rint((local / local[:, 2:]) @ view.camera.K.T)[:, :2].astype(int)
    assert (view.rgb(3)[pixels[:, 1], pixels[:, 0]] == cloud.colors).all()
    assert (view.ids(3)[pixels[:, 1], pixels[:, 0]] == cloud.ids).all()
    np.testing.assert_allclose(
        view.depth(3)[pixels[:, 1], pixels[:, 0]], local[:, 2], rtol=1e-4, atol=1e-4
    )


def test_an_inserted_thing_is_there_as_points_and_as_a_mesh(edited: Space) -> None:
    (mesh,) = edited.meshes(0)
    new = int(mesh.name.removeprefix("new "))
    cloud = edited.cloud(0, 80_000)
    seen = cloud.points[cloud.ids == new]
    assert len(seen) > 5
    low, high = mesh.vertices.min(0) - 0.01, mesh.vertices.max(0) + 0.01
    assert ((seen > low) & (seen < high)).all(1).mean() > 0.9
    assert edited.by_instance(np.array([new, 0])).tolist() == [[230, 60, 200], [90, 90, 90]]


def test_what_was_put_in_and_falls_is_where_it_is_by_then(edited: Space) -> None:
    (body,) = (body for body in edited.bodies if body.mesh is not None)
    way = body.to_world.copy()
    way[1:, 2, 3] -= 0.1
    falling = replace(edited, bodies=(replace(body, to_world=way),))
    (first,), (last,) = falling.meshes(0), falling.meshes(edited.length - 1)
    np.testing.assert_allclose(
        first.vertices - last.vertices, np.tile([0, 0, 0.1], (len(first.vertices), 1))
    )


def test_gaussians_have_the_spread_of_their_axes() -> None:
    """A quarter turn about z carries the long axis from x to y."""
    half = np.sqrt(0.5)
    one = Gaussians(
        np.zeros((1, 3), np.float32),
        np.array([[half, 0, 0, half]], np.float32),
        np.array([[0.3, 0.1, 0.2]], np.float32),
        np.ones(1, np.float32),
        np.zeros((1, 1, 3), np.float32),
        np.ones(1, np.int32),
    )
    splats = Space("", 1, gaussians=lambda _: one).splats(0)
    np.testing.assert_allclose(splats.covariances[0], np.diag([0.01, 0.09, 0.04]), atol=1e-6)
    np.testing.assert_allclose(splats.colors, 0.5)


@pytest.fixture(scope="module")
def running(edited: Space) -> Iterator[live.LiveView]:
    with live.LiveView(edited, 18766, most=2_000) as made:
        yield made


def test_the_browser_finds_the_viewer_on_this_machine_alone(running: live.LiveView) -> None:
    assert running.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(running.url, timeout=30) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read().lower()


def test_what_is_drawn_follows_the_frame_and_the_colors(running: live.LiveView) -> None:
    last = running.space.length - 1
    running.show(last)
    for name, view in running.space.episode.views.items():
        handle = running.server.scene.get_handle_by_name(f"/cameras/{name}")
        np.testing.assert_allclose(handle.position, view.camera.cam_to_world[last, :3, 3])
    seen = running.server.scene.get_handle_by_name("/seen")
    assert (np.asarray(seen.colors) == running.space.cloud(last, 2_000).colors).all()
    running.colored = live.INSTANCE
    running.show(last)
    seen = running.server.scene.get_handle_by_name("/seen")
    ids = running.space.cloud(last, 2_000).ids
    assert (np.asarray(seen.colors) == running.space.by_instance(ids)).all()


def test_names_of_instances_are_folded_away(running: live.LiveView) -> None:
    shown = running.server.gui._container_handle_from_uuid.values()  # viser lists it nowhere else
    (folder,) = (one for one in shown if isinstance(one, viser.GuiFolderHandle))
    assert not folder.expand_by_default
    (names,) = folder._children.values()
    assert "new" in names.content


def test_a_recording_for_rerun_is_whole_and_never_overwritten(
    recorded: Space, tmp_path: Path
) -> None:
    path = tmp_path / "a.rrd"
    assert rerun_file.write(recorded, path, most=300) == recorded.length
    assert [one.name for one in tmp_path.iterdir()] == ["a.rrd"]
    command = [sys.executable, "-m", "rerun_cli", "rrd", "print", str(path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for name in ("/world/seen", "/world/cameras/front", "/world/cameras/wrist"):
        assert name in printed
    with pytest.raises(BadInput, match=r"a\.rrd: --rerun: found a file; expected a new one"):
        rerun_file.write(recorded, path)
    with pytest.raises(BadInput, match=r"a\.ply: --rerun: found '\.ply'; expected .*scenes export"):
        rerun_file.write(recorded, tmp_path / "a.ply")


def test_a_missing_package_names_its_extra(
    recorded: Space, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtra, match=r"rpaug\[view\]"):
        live.LiveView(recorded, 0)
    with pytest.raises(MissingExtra, match=r"rpaug\[rerun\]"):
        rerun_file.write(recorded, tmp_path / "a.rrd")


def test_where_a_port_is_taken_the_next_one_is_said(running: live.LiveView) -> None:
    taken = running.server.get_port()
    with live.LiveView(Space("other", 1), taken) as other:
        assert other.server.get_port() != taken
        assert other.url.endswith(str(other.server.get_port()))
