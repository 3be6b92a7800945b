"""The viewer: points where surfaces are, Gaussians with their spread, a server that answers, a file that is whole."""

import io
import sys
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import viser
from rerun.chunk import Chunk, RrdReader

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
    cloud = running.space.cloud(last, 2_000)
    (mesh,) = running.space.meshes(last)
    for name, part in running.space.apart(cloud).items():
        keep = ~np.isin(part.ids, list(mesh.instance_ids))
        discs = running.server.scene.get_handle_by_name(f"/instances/{name}")
        assert (discs is not None) == keep.any()
        if discs is not None:
            assert (np.asarray(discs.rgbs) == part.colors[keep]).all()
    running.colored = live.INSTANCE
    running.show(last)
    for name, part in running.space.apart(cloud).items():
        if len(part.points):
            discs = running.server.scene.get_handle_by_name(f"/instances/{name}")
            assert (np.asarray(discs.rgbs) == running.space.by_instance(part.ids)).all()


def test_names_of_instances_are_folded_away(running: live.LiveView) -> None:
    shown = running.server.gui._container_handle_from_uuid.values()  # viser lists it nowhere else
    folders = [one for one in shown if isinstance(one, viser.GuiFolderHandle)]
    assert len(folders) == 2
    assert not any(one.expand_by_default for one in folders)
    (names,) = folders[0]._children.values()
    assert "new" in names.content


def test_a_recording_for_rerun_is_whole_and_never_overwritten(
    recorded: Space, tmp_path: Path
) -> None:
    path = tmp_path / "a.rrd"
    assert rerun_file.write(recorded, path, most=300) == recorded.length
    assert [one.name for one in tmp_path.iterdir()] == ["a.rrd"]
    paths = {chunk.entity_path for chunk in RrdReader(path).stream()}
    named = {f"/world/instances/{name.replace(' ', '_')}" for name in recorded.entities()}
    assert {"/world/instances/robot", "/world/cameras/front", "/world/cameras/wrist"} < paths
    assert named < paths
    with pytest.raises(BadInput, match=r"a\.rrd: --rerun: found a file; expected a new one"):
        rerun_file.write(recorded, path)
    with pytest.raises(BadInput, match=r"a\.ply: --rerun: found '\.ply'; expected .*scenes export"):
        rerun_file.write(recorded, tmp_path / "a.ply")


def logged(path: Path, entity: str, column: str) -> list[Any]:
    """What a recording holds of an entity's column, chunk by chunk, as Rerun reads it back."""
    chunks: list[Chunk] = [c for c in RrdReader(path).stream() if c.entity_path == entity]
    found = []
    for chunk in chunks:
        batch = chunk.to_record_batch()
        found += [batch[name].to_pylist() for name in batch.schema.names if name == column]
    return [row for rows in found for row in rows]


def test_a_recording_for_rerun_names_roles_and_textures_what_was_put_in(
    edited: Space, tmp_path: Path
) -> None:
    path = tmp_path / "a.rrd"
    rerun_file.write(edited, path, most=4_000)
    (context,) = logged(path, "/world", "AnnotationContext:context")
    classes = {one["class_description"]["info"]["label"]: one["class_id"] for one in context[0]}
    assert {"robot", "rest"} < set(classes)
    (mesh,) = edited.meshes(0)
    place = f"/world/put_in/{mesh.name.replace(' ', '_')}"
    (corners,) = logged(path, place, "Mesh3D:vertex_positions")
    np.testing.assert_allclose(corners, mesh.scale * mesh.mesh.points, atol=1e-6)
    (texture,) = logged(path, place, "Mesh3D:albedo_texture_buffer")
    assert np.array_equal(np.ravel(texture[0]), mesh.mesh.image.ravel())
    places = logged(path, place, "Transform3D:translation")
    assert len(places) == edited.length
    np.testing.assert_allclose(places[0][0], mesh.to_world[:3, 3], atol=1e-6)
    ids = logged(path, "/world/instances/robot", "Points3D:class_ids")
    assert {one for row in ids for one in row or ()} == {classes["robot"]}
    labels = logged(path, "/world/instances/robot/name", "Points3D:labels")
    assert labels
    assert all(row in (["robot"], None, []) for row in labels)


def test_discs_lie_flat_on_the_surface_they_show(recorded: Space) -> None:
    """The table is level: its discs face up, have no height, and reach their neighbours."""
    cloud = recorded.cloud(0, 20_000)
    (table,) = (name for name in recorded.entities() if name.startswith("table"))
    part = recorded.apart(cloud)[table]
    assert len(part.points) > 500
    up = np.abs(part.normals[:, 2])
    assert np.median(up) > 0.999
    level = part.of(up > 0.999)
    heights, widths = level.covariances[:, 2, 2], level.covariances[:, 0, 0]
    assert (heights < 0.05 * widths).all()
    np.testing.assert_allclose(widths, level.radii**2, rtol=0.02)
    gaps = [np.sort(((level.points - one) ** 2).sum(1))[1] ** 0.5 for one in level.points[:200]]
    assert np.median(gaps) < 2 * np.median(level.radii)


def test_all_pixels_have_one_name_or_none(recorded: Space) -> None:
    cloud = recorded.cloud(2, 3_000)
    parts = recorded.apart(cloud)
    assert sum(len(part.points) for part in parts.values()) == len(cloud.points)
    assert [name for name in recorded.entities() if "robot" in name] == ["robot"]  # of many links


@pytest.fixture
def drawn(edited: Space) -> Iterator[live.LiveView]:
    with live.LiveView(edited, 18866, most=20_000) as made:
        yield made


def handle(view: live.LiveView, name: str) -> Any:
    return view.server.scene.get_handle_by_name(name)


def test_what_was_put_in_is_shown_with_its_texture(drawn: live.LiveView) -> None:
    (mesh,) = drawn.space.meshes(0)
    node = handle(drawn, f"/put in/{mesh.name}")
    assert node.visible
    np.testing.assert_allclose(node.position, mesh.to_world[:3, 3], atol=1e-6)
    assert handle(drawn, f"/instances/{mesh.name}") is None  # no discs within it
    shown = trimesh.load(io.BytesIO(node.glb_data), file_type="glb", force="mesh")
    assert np.array_equal(
        np.asarray(shown.visual.material.baseColorTexture.convert("RGB")), mesh.mesh.image
    )
    drawn.toggle(mesh.name, False)
    assert not node.visible
    assert handle(drawn, f"/instances/{mesh.name}") is None
    drawn.toggle(mesh.name, True)
    assert node.visible
    drawn.toggle(live.PUT_IN, False)
    assert not node.visible
    assert handle(drawn, f"/instances/{mesh.name}") is not None


def test_names_are_shown_and_hidden_each_by_itself(drawn: live.LiveView) -> None:
    assert handle(drawn, "/names/robot") is None
    drawn.toggle(live.LABELS, True)
    assert handle(drawn, "/names/robot").text == "robot"
    assert handle(drawn, "/instances/robot") is not None
    drawn.toggle("robot", False)
    assert handle(drawn, "/names/robot") is None
    assert handle(drawn, "/instances/robot") is None
    drawn.toggle("robot", True)
    drawn.colored = live.INSTANCE
    drawn.show(1)
    color = drawn.space.entities()["robot"][1]
    colors = handle(drawn, "/instances/robot").rgbs
    assert (np.asarray(colors) == color).all()


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
