"""Free places keep their distance from what stands and from what moves; zones and cameras say which of them matter."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from tabletop import instance_id, scene

from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.pipeline import copies, prepare, recipe
from rpaug.scene.placement import placing, policy_views, swept, zones
from rpaug.scene.placement.free_space import CELL, EDGE, FreeSpace
from rpaug.scene.sampled_frames import look

SIDE = 40  # cells


@some.composite
def rooms(draw) -> FreeSpace:
    """A table with some things on it, and some way through the air."""
    rng = np.random.default_rng(draw(some.integers(0, 2**16)))
    still = np.full((SIDE, SIDE), np.inf, np.float32)
    swept = np.full((SIDE, SIDE), np.inf, np.float32)
    for heights in (still, swept):
        rows, columns = rng.integers(0, SIDE, (2, 6))
        heights[rows, columns] = rng.uniform(0, 0.3, 6)
    seen = np.ones((SIDE, SIDE), bool)
    seen[: rng.integers(0, 8)] = False
    return FreeSpace(rng.uniform(-1, 1, 2), 0.7, seen, still, swept)


@settings(max_examples=30, deadline=None)
@given(rooms(), some.floats(0.01, 0.06), some.floats(0.02, 0.2), some.sampled_from([0.02, 0.05]))
def test_a_free_place_is_apart_from_all_else(room, radius, height, margin) -> None:
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    outline = radius * np.stack([np.cos(turns), np.sin(turns)], 1)
    taken = (room.still < height) | (room.swept < height + margin)
    others = room.at(np.argwhere(taken))
    for middle in room.at(np.argwhere(room.spots(outline, height, margin)))[::7]:
        away = np.linalg.norm(others - middle, axis=1).min(initial=np.inf)
        assert away > radius + margin - 1.5 * CELL
        assert room.seen[room.covered(outline + middle)].all()
        inner = middle - room.origin
        assert (inner > radius - CELL).all()
        assert (inner < SIDE * CELL - radius + CELL).all()


@some.composite
def outlines(draw) -> np.ndarray:
    """A convex footprint around its middle, of whatever proportions and turn."""
    turns = np.linspace(0, 2 * np.pi, draw(some.integers(4, 12)), endpoint=False)
    corners = np.stack([np.cos(turns), np.sin(turns)], 1)
    corners *= [draw(some.floats(0.02, 0.08)), draw(some.floats(0.01, 0.04))]
    turn = draw(some.floats(0, np.pi))
    return corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


@settings(max_examples=60, deadline=None)
@given(rooms(), outlines())
def test_a_footprint_keeps_away_from_where_the_support_ends(room, outline) -> None:
    """Seen or not: cells beyond the grid are no support either."""
    around = np.pad(room.seen, 8)
    ends = room.at(np.argwhere(~around) - 8)
    share = np.linspace(0, 1, 9)[:, None, None]
    border = (outline * (1 - share) + np.roll(outline, -1, axis=0) * share).reshape(-1, 2)
    bare = replace(
        room, still=np.full_like(room.still, np.inf), swept=np.full_like(room.swept, np.inf)
    )
    for middle in room.at(np.argwhere(bare.spots(outline, 0.1)))[::5]:
        away = np.linalg.norm(ends - (middle + border)[:, None], axis=-1).min()
        # To the middle of a cell that is none; the last one that is may be the support by half.
        assert away > EDGE + CELL


@settings(max_examples=30, deadline=None)
@given(rooms(), some.floats(0.03, 0.2), some.integers(0, 2**16))
def test_near_is_a_distance_in_metres_also_from_outside(room, within, seed) -> None:
    points = room.origin + np.random.default_rng(seed).uniform(-0.3, 0.7, (5, 2))
    every = room.at(np.argwhere(np.ones((SIDE, SIDE), bool)))
    away = np.linalg.norm(every[:, None] - points, axis=-1).min(1).reshape(SIDE, SIDE)
    near = room.near(points, within)
    assert not (near & (away > within + CELL)).any()
    assert not (~near & (away < within - CELL)).any()


@pytest.mark.gl
def test_nothing_that_moves_was_ever_seen_below_its_way() -> None:
    room = placing.find_free_space(scene())
    moving = [h for b in scene().tracked if b.motion != "static" for h in b.instance_ids]
    moving += scene().roles["robot"]
    low = 0
    for view in scene().episode.views.values():
        for t in range(scene().episode.length):
            use = np.isin(view.ids(t), moving) & (view.depth(t) > 0)
            points = geometry.world_points(view.depth(t), view.camera, t)[use]
            points = points[points[:, 2] < room.level + swept.HIGHEST]
            columns, rows = np.rint((points[:, :2] - room.origin) / CELL).astype(int).T
            inside = (rows >= 0) & (columns >= 0) & (rows < room.seen.shape[0])
            inside &= columns < room.seen.shape[1]
            over = points[inside, 2] - room.level - room.swept[rows[inside], columns[inside]]
            assert (over > -1e-4).all()
            low += (points[inside, 2] - room.level < 0.1).sum()
    assert low > 1000


@pytest.mark.gl
@pytest.mark.parametrize("name", ["block_textured", "block_small", "cylinder"])
def test_a_thing_that_leaves_stands_on_support_that_nobody_saw(name: str) -> None:
    """Else it could not be moved by less than its own width; what it does not cover stays unseen."""
    one = frozenset([instance_id(name)])
    stays, leaves = placing.find_free_space(scene()), placing.find_free_space(scene(), one)
    covered = stays.covered(placing.hull(placing.points_of(scene(), one)))
    assert stays.seen[covered].mean() < 0.3
    assert leaves.seen[covered].all()
    np.testing.assert_array_equal(leaves.seen[~covered], stays.seen[~covered])


@pytest.mark.gl
def test_one_thing_takes_the_place_of_another() -> None:
    """What was removed leaves room, which an edit after it is held to have."""
    gone = instance_id("cylinder")
    stood = placing.hull(placing.points_of(scene(), [gone])).mean(0).round(2).tolist()
    edits = [
        {"op": "remove", "target": {"handle": gone}},
        {"op": "insert", "category": "die", "at": stood},
    ]
    both = recipe.build({"version": 1, "edits": edits})
    assert prepare.ground(scene(), both) == ()
    assert all(one.edit is not None for one in copies.draw(scene(), both, 0)[1])
    alone = recipe.build({"version": 1, "edits": [{"op": "light_color"}, edits[1]]})
    (why,) = prepare.ground(scene(), alone)
    assert "no room" in why


def test_places_beside_the_arm_are_free_where_a_camera_shows_it() -> None:
    room = placing.find_free_space(scene())
    path = zones.low_path(scene(), room.level)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.02
    assert (room.spots(square, 0.05, 0.02) & room.near(path, 0.15)).sum() > 50


@pytest.mark.gl
def test_zones_lie_in_the_workspace_and_near_what_they_are_called_by() -> None:
    room = placing.find_free_space(scene())
    found = zones.find(scene(), room, 0.15, None)
    low, high = zones.workspace(scene())
    tips = scene().episode.robot.gripper_to_world[:, :2, 3]
    assert (tips > low).all()
    assert (tips < high).all()
    sampled = look(scene().episode)
    shown = np.isin(sampled.ids, list(zones.acted_on(scene()))) & (sampled.depth > 0)
    target = sampled.points[shown][:, :2]
    assert np.ptp(target, axis=0).max() > 0.15, "the target is carried"
    path = zones.low_path(scene(), room.level)[:, :2]
    for name, ways in (("path", [path]), ("target", [target]), ("beyond", [path, target])):
        middles = room.at(np.argwhere(found[name]))
        assert ((middles >= low) & (middles <= high)).all()
        away = np.min([_away(middles, way) for way in ways], axis=0)
        assert (away > 0.15).all() if name == "beyond" else (away <= 0.15).all()
    assert not (found["outside"] & found["anywhere"]).any()
    given = zones.find(scene(), room, 0.15, ((-0.1, -0.1), (0.1, 0.1)))
    assert given["anywhere"].sum() == pytest.approx(441, abs=42)


@pytest.mark.gl
def test_a_floor_below_is_not_where_the_robot_works() -> None:
    room = placing.find_free_space(scene())
    with pytest.raises(TargetError, match=r"lies .* cm below wherever the gripper went"):
        zones.find(scene(), replace(room, level=room.level - 0.75), 0.15, None)


def _away(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.array([np.linalg.norm(others - one, axis=1).min() for one in points])


@pytest.mark.gl
def test_a_thing_that_hides_the_target_or_that_nobody_sees_is_refused() -> None:
    target = frozenset({instance_id("pad")})
    views = policy_views.find(scene().episode, target, None)
    cube = np.stack(np.meshgrid(*[[-0.02, 0.02]] * 3), -1).reshape(-1, 3)
    pad = placing.points_of(scene(), target).mean(0)
    camera = scene().cameras[views.sampled.cameras[0]].cam_to_world[0, :3, 3]
    before = pad + 0.2 * (camera - pad) / np.linalg.norm(camera - pad)
    assert views.with_thing(cube + before, 0.02) is None
    assert views.with_thing(cube + before, 1.0) is not None
    assert views.with_thing(cube + np.array([0.0, 0.0, 50.0]), 1.0) is None
    around = 0.15 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    beside = [views.with_thing(cube + pad + step, 0.02) for step in around]
    assert any(after is not None for after in beside)


@pytest.mark.gl
def test_the_policys_cameras_are_known_ones() -> None:
    with pytest.raises(TargetError, match="no camera is called 'nose'; there are: "):
        policy_views.find(scene().episode, frozenset(), ("nose",))
