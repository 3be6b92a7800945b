"""What edits lie and stand on where there is no depth, and where things may be put."""

import json

import numpy as np
import pytest
from pydantic import TypeAdapter
from rgb_only_tables import episode, image, still

from rpaug.core import geometry, registry
from rpaug.core.errors import Unsupported
from rpaug.pipeline.contracts import shown
from rpaug.scene.build import build
from rpaug.scene.instances import ground_plane, rgb_episode
from rpaug.scene.placement.placing import find_free_space

LENGTH = 12


@pytest.fixture(scope="module")
def scene():
    return build(episode(LENGTH), with_bodies=True)


def edited(scene, op: str, **fields):
    operator = TypeAdapter(registry.operator(op)).validate_python(fields)
    edit = operator.sample(scene, np.random.default_rng(1))
    return operator.apply(scene, json.loads(json.dumps(edit)))


def test_an_unplaced_camera_looks_down_on_the_support() -> None:
    support = np.zeros((64, 64), bool)
    support[20:60, 10:50] = True
    made = ground_plane.of(still(3), support, ~support)
    points = geometry.world_points(made.depth.astype(float), made.camera, 0)
    assert np.abs(points[support][:, 2]).max() < 1e-5
    assert points[~support][:, 2].min() > -ground_plane.FLOOR - 1e-3
    assert made.camera.cam_to_world[0, 2, 3] > 0.3
    middle = points[support].mean(0)
    assert np.linalg.norm(middle - made.camera.cam_to_world[0, :3, 3]) < 2 * ground_plane.DISTANCE


def test_a_placed_camera_stays_where_it_is_told() -> None:
    camera = ground_plane.of(still(3), np.ones((64, 64), bool), np.zeros((64, 64), bool)).camera
    given = still(3, assumed=False)
    given = type(given)(given.K, camera.cam_to_world, 64, 64)
    made = ground_plane.of(given, np.ones((64, 64), bool), np.zeros((64, 64), bool))
    assert made.camera is given


def test_things_stand_where_no_line_of_sight_to_what_moves_passes_through(scene) -> None:
    after = edited(scene, "distractors", count=1, size=[0.04, 0.1])
    made = shown(after)
    ids = scene.episode.views["image_0"].ids
    moves = list(scene.roles["robot"])
    changed = 0
    for t in range(LENGTH):
        differs = (made.views["image_0"].rgb(t) != image(t)).any(-1)
        assert not (differs & np.isin(ids(t), moves)).any()
        changed += differs.sum()
    assert changed > 10 * LENGTH


def test_room_is_seen_and_free(scene) -> None:
    free = find_free_space(scene)
    assert free.level == 0
    assert 0 < free.seen.mean() < 1
    assert np.isfinite(free.swept).any()


def test_nothing_is_written_of_what_was_assumed(scene) -> None:
    made = shown(edited(scene, "recolor", target={"text": "the red thing"}, color="blue"))
    view, recorded = made.views["image_0"], episode(LENGTH).views["image_0"]
    assert view.depth is None
    assert view.ids is None
    assert view.proxy is None
    assert np.array_equal(view.camera.cam_to_world, recorded.camera.cam_to_world)
    assert view.camera.assumed


@pytest.mark.parametrize(
    ("op", "role", "fields"),
    [
        ("recolor", "robot", {"target": {"text": "the red thing"}, "color": "blue"}),
        ("table_color", "robot", {}),
        ("background_texture", "table", {}),
        ("table_texture", "background", {}),
    ],
)
def test_pixels_an_edit_does_not_mean_keep_their_bytes(scene, op, role, fields) -> None:
    made = shown(edited(scene, op, **fields)).views["image_0"]
    inner = scene.episode.views["image_0"]
    for t in (0, 6, 11):
        kept = np.isin(inner.ids(t), list(scene.roles[role]))
        # Two pixels off an outline nothing is mixed.
        for _ in range(2):
            kept[1:-1, 1:-1] &= kept[:-2, 1:-1] & kept[2:, 1:-1] & kept[1:-1, :-2] & kept[1:-1, 2:]
        kept[[0, 1, -2, -1]] = kept[:, [0, 1, -2, -1]] = False
        assert kept.any()
        assert np.array_equal(made.rgb(t)[kept], image(t)[kept])
        assert (made.rgb(t) != image(t)).any()


def test_cameras_that_do_not_know_of_one_another_share_no_new_thing() -> None:
    found = build(episode(LENGTH, views=2), with_bodies=True)
    with pytest.raises(Unsupported, match=r"image_0, image_1 stand to one another.*cameras.yaml"):
        find_free_space(found)


def test_what_is_assumed_is_said(scene) -> None:
    given = "\n".join(rgb_episode.assumptions(scene.episode))
    for part in ("focal length of 77 px assumed", "45 degrees", "0.75 m", "median of 12 frames"):
        assert part in given
    assert not rgb_episode.assumptions(episode())
