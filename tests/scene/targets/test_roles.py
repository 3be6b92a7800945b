"""Roles in worlds of boxes and in two real recordings, whose handles were read off mask overlays by eye."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import boxes
import numpy as np
import pytest
from boxes import BLOCK, FLOOR, HAND, OTHER, PAD, TABLE, WALL, Box, World

from rpaug import twin
from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.core.types import Belief, Body, Scene
from rpaug.scene.build import build
from rpaug.scene.targets import roles
from rpaug.scene.targets.observed import Evidence, Thing, _between
from rpaug.scene.targets.supports import Ground
from rpaug.scene.targets.targets import Target, find
from rpaug.scene.tracking import bodies

VOID = 16777215

SEEN_BY_EYE = {
    "open the top drawer": {
        "manipulated": {108},
        "receiver": {96, 98, 103, 105},  # frame, lower drawers, legs
        "robot": {31, 34, 35, 39, 40, 41, 42, 43, 44},
        "table": {48, 52},
        "background": {10, 53, 55, 56},  # floor and walls
    },
    "open the bottom drawer": {
        "manipulated": {173},
        "receiver": {171, 178, 180, 183},
        "robot": {31, 34, 35, 39, 40, 41, 42, 43, 44, 45, 46},
        "table": {48, 52},
        "background": {10, 53, 55},
    },
}


def test_roles_of_a_real_recording(real: Scene) -> None:
    assert {name: set(instance_ids) for name, instance_ids in real.roles.items()} == SEEN_BY_EYE[
        real.episode.instruction
    ]


def test_pick_and_place(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    assert scene.roles == {
        "manipulated": {BLOCK},
        "receiver": {PAD},
        "robot": {HAND},
        "table": {TABLE},
        "background": {FLOOR, WALL},
    }


def test_a_block_that_is_pushed_to_a_place_on_the_table_has_no_receiver(
    pushed: tuple[World, Scene],
) -> None:
    _, scene = pushed
    assert scene.roles["manipulated"] == {BLOCK}
    assert "receiver" not in scene.roles
    with pytest.raises(
        TargetError, match="ends over the table with 100 % of its outline, and at nothing else"
    ):
        find(scene, Target(role="receiver"))
    assert OTHER not in frozenset().union(*scene.roles.values())


@pytest.mark.parametrize("length", [1, 4])
def test_where_nothing_moves_only_places_are_known(length: int) -> None:
    episode = boxes.still(length).episode()
    known = roles.held(roles.believe(episode, bodies.track(episode)))
    assert known == {"table": {TABLE}, "background": {FLOOR, WALL}}


def test_numbers_of_handles_do_not_matter(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    rng = np.random.default_rng(3)
    new = dict(zip(world.boxes, rng.choice(5000, len(world.boxes), replace=False) + 1, strict=True))
    other = World(
        {int(new[h]): box for h, box in world.boxes.items()}, world.gripper, world.gripper_open
    ).episode()
    known = roles.held(roles.believe(other, bodies.track(other)))
    assert known == {
        name: {int(new[h]) for h in instance_ids} for name, instance_ids in scene.roles.items()
    }


def _believed(world: World) -> Mapping[str, Belief]:
    episode = world.episode()
    return roles.believe(episode, bodies.track(episode))


def test_beliefs_have_reasons_and_bounded_confidence(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    assert scene.roles.keys() == scene.beliefs.keys()
    for belief in scene.beliefs.values():
        assert roles.BOUND <= belief.confidence <= 1
        assert all(belief.reasons)


def test_a_belief_below_the_bound_is_no_role_and_is_cited(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    weak = replace(scene.beliefs["receiver"], confidence=roles.BOUND - 0.01, reasons=("a guess",))
    beliefs = {**scene.beliefs, "receiver": weak}
    doubting = replace(scene, beliefs=beliefs, roles=roles.held(beliefs))
    assert "receiver" not in doubting.roles
    with pytest.raises(TargetError, match=r"a guess: confidence 0\.39, below 0\.4"):
        find(doubting, Target(role="receiver"))


def test_a_small_table_is_one_and_the_floor_far_below_is_not() -> None:
    world = boxes.pick_and_place()
    small = {**world.boxes, TABLE: Box((0.28, 0.6, 0.04), boxes.at(0.12, 0.05, -0.02))}
    found = _believed(replace(world, boxes=small))
    assert found["table"].instance_ids == {TABLE}
    assert found["background"].instance_ids >= {FLOOR, WALL}


def test_where_there_is_no_table_things_stand_on_the_floor() -> None:
    world = boxes.pick_and_place()
    left = {h: box for h, box in world.boxes.items() if h != TABLE}
    left[FLOOR] = Box((5, 5, 0.02), boxes.at(0, 0, -0.01))
    assert _believed(replace(world, boxes=left))["table"].instance_ids == {FLOOR}


def test_what_settles_by_itself_is_not_manipulated_and_receives() -> None:
    world = boxes.pick_and_place()
    drop = np.tile((0.15, 0.2, 0.015), (len(world.gripper), 1))
    drop[0, 2] += 0.02
    settling = replace(world.boxes[PAD], poses=boxes.poses(drop))
    found = _believed(replace(world, boxes={**world.boxes, PAD: settling}))
    assert found["manipulated"].instance_ids == {BLOCK}
    assert found["receiver"].instance_ids == {PAD}


def test_what_falls_beside_what_falls_was_not_pushed() -> None:
    gaps = np.zeros((3, 2, 2))
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1:, 2, 3] = -0.01
    low, high = np.zeros(3), np.ones(3)
    body = Body(frozenset([1, 2]), poses, "aligned", 0.0)
    things = {h: Thing(h, body, np.zeros((1, 3)), np.zeros((1, 3)), low, high) for h in (1, 2)}
    sampled = SimpleNamespace(frames=np.arange(3))
    evidence = Evidence(things, sampled, None, gaps)  # type: ignore[arg-type]
    assert not evidence.pushed(1, {2: np.array([False, True])}).any()
    assert evidence.pushed(1, {2: np.array([True, False])}).tolist() == [True, False]


def test_what_is_manipulated_is_as_sure_as_the_least_sure_thing_in_it() -> None:
    hand, held, pushed = 1, 2, 3
    steps = 9
    poses = np.tile(np.eye(4), (steps, 1, 1))
    poses[:, 0, 3] = 0.02 * np.arange(steps)
    gaps = np.full((steps, 3, 3), 0.1)
    gaps[:, :2, :2] = 0.0
    gaps[:4, 2, :] = gaps[:4, :, 2] = (
        0.0  # the hand is beside it in half of its way, then it rolls on
    )
    low, high = np.zeros(3), np.full(3, 0.1)
    things = {
        h: Thing(h, Body(frozenset([h]), poses, "aligned", 0.0), low[None], low[None], low, high)
        for h in (hand, held, pushed)
    }
    sampled = SimpleNamespace(frames=np.arange(steps))
    evidence = Evidence(things, sampled, None, gaps)  # type: ignore[arg-type]
    found = roles._moved(evidence, [hand], [hand])
    assert found.instance_ids == {held, pushed}
    assert found.confidence == pytest.approx(4 / 8)
    assert len(found.reasons) == 2
    assert any(
        f"instance {pushed} moves in 8 steps" in why and "in 4 of" in why for why in found.reasons
    )


def test_what_stands_on_the_table_is_not_the_table() -> None:
    world = boxes.pick_and_place()
    tray = Box((0.3, 0.3, 0.03), boxes.at(0.1, -0.14, 0.015))
    lifted = boxes.at(0, 0, 0.03) @ world.boxes[BLOCK].poses
    gripper = boxes.at(0, 0, 0.03) @ world.gripper
    higher = {
        BLOCK: replace(world.boxes[BLOCK], poses=lifted),
        HAND: replace(world.boxes[HAND], poses=gripper),
        OTHER: tray,
    }
    found = _believed(replace(world, boxes={**world.boxes, **higher}, gripper=gripper))
    assert found["table"].instance_ids == {TABLE}
    assert found["receiver"].instance_ids == {PAD}


def test_a_rim_on_the_tables_edge_is_no_background_and_a_wall_beside_the_table_is() -> None:
    world = boxes.pick_and_place()
    rim = Box((0.04, 1.16, 0.08), boxes.at(-0.33, 0, 0.04))  # longer than the table
    wall = Box((0.02, 1.4, 1.0), boxes.at(-0.36, 0, 0.2))
    rimmed = _believed(replace(world, boxes={**world.boxes, OTHER: rim}))
    walled = _believed(replace(world, boxes={**world.boxes, OTHER: wall}))
    assert rimmed["background"].instance_ids == {FLOOR, WALL}
    assert rimmed["receiver"].instance_ids == {PAD}
    assert walled["background"].instance_ids == {FLOOR, WALL, OTHER}


@pytest.mark.parametrize(("wall", "table"), [(0.1, {1}), (0.0, {1, 2})])
def test_of_two_bins_one_is_brought_into_and_two_leaves_are_one_table(
    wall: float, table: set[int]
) -> None:
    grid = np.mgrid[0:0.4:20j, 0:0.4:20j].reshape(2, -1).T
    flat = np.column_stack([grid, np.zeros(len(grid))])
    rim = np.column_stack([grid[:40], np.full(40, wall)])
    block, poses = 3, np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = 0, 0.1, 0.2, 0.3, 0.42
    still = np.tile(np.eye(4), (5, 1, 1))
    surfaces = {
        1: (still, flat, rim),
        2: (still, flat + np.array([0.42, 0, 0]), rim + np.array([0.42, 0, 0])),
        block: (poses, 0.1 * flat + [0.2, 0.2, 0.02]),
    }
    things = {}
    for h, (track, *parts) in surfaces.items():
        points = np.concatenate(parts)
        normals = np.repeat(
            [[0, 0, 1.0], [1.0, 0, 0]], [len(parts[0]), len(points) - len(parts[0])], axis=0
        )
        motion = "aligned" if h == block else "static"
        body = Body(frozenset([h]), track, motion, 0.0)
        things[h] = Thing(h, body, points, normals, points.min(0), points.max(0))
    gripper = poses[:, :3, 3] + [0.2, 0.2, 0.1]
    sampled = SimpleNamespace(frames=np.arange(5))
    evidence = Evidence(things, sampled, gripper, np.ones((5, 3, 3)))  # type: ignore[arg-type]
    assert roles._table(evidence, Ground(evidence, ()), (), {block}).instance_ids == table


def test_what_hangs_is_one_with_what_holds_it_up() -> None:
    world = boxes.pick_and_place()
    block = world.boxes[BLOCK].poses.copy()
    block[-9:, 2, 3] += 0.1  # it ends that much higher, upon the hanging shelf
    block[12:-9, 2, 3] += 0.1
    board = Box((0.14, 0.02, 0.4), boxes.at(0.15, 0.28, 0.3))
    changed = {
        PAD: replace(world.boxes[PAD], poses=boxes.at(0.15, 0.2, 0.115)),
        BLOCK: replace(world.boxes[BLOCK], poses=block),
        OTHER: board,
    }
    found = _believed(replace(world, boxes={**world.boxes, **changed}))
    assert found["receiver"].instance_ids == {PAD, OTHER}


def test_what_comes_up_to_a_thing_was_brought_to_it_and_what_passes_by_was_not() -> None:
    frames, still = np.arange(4), np.tile(np.eye(4), (4, 1, 1))
    way = np.array([0.0, 0.3, 0.54, 0.6])
    poses = still.copy()
    poses[:, 0, 3] = way
    corner, none = np.full(3, 0.02), np.zeros((1, 3))
    things = {
        h: Thing(
            h, Body(frozenset([h]), track, "aligned", 0.0), none, none, at - corner, at + corner
        )
        for h, track, at in (
            (1, poses, np.zeros(3)),
            (2, still, np.array([0.66, 0, 0])),
            (3, still, np.array([0.54, 0, 0])),
            (4, still, np.array([0.9, 0, 0])),
        )
    }
    gaps = np.full((4, 4, 4), 0.1)
    evidence = Evidence(things, SimpleNamespace(frames=frames), None, gaps)  # type: ignore[arg-type]
    assert roles._approached(evidence, 1, 2) == pytest.approx(1 - 0.02 / 0.62)
    assert roles._approached(evidence, 1, 3) == 0  # it went past
    assert roles._approached(evidence, 1, 4) == 0  # it stayed away
    over: Any = SimpleNamespace(falls=lambda _, t: {2: 1.0} if t == 0 else {3: 1.0})
    assert roles._brought(evidence, over, 1, 3)[0] == 0.8  # it ends above that one
    assert roles._brought(evidence, over, 1, 2)[0] < 0.8  # and began above the other


def test_of_things_that_are_touched_alike_the_largest_receives() -> None:
    still, none = np.tile(np.eye(4), (4, 1, 1)), np.zeros((1, 3))
    things = {}
    for h, at, side in ((1, 0.0, 0.02), (2, 0.1, 0.08), (3, -0.05, 0.03)):
        middle, half = np.array([at, 0.0, 0.0]), np.full(3, side)
        body = Body(frozenset([h]), still, "aligned", 0.0)
        things[h] = Thing(h, body, none, none, middle - half, middle + half)
    gaps = np.full((4, 3, 3), 0.1)
    gaps[:, 0, 1:] = gaps[:, 1:, 0] = 0  # the first touches both others
    evidence = Evidence(things, SimpleNamespace(frames=np.arange(4)), None, gaps)  # type: ignore[arg-type]
    ground: Any = SimpleNamespace(falls=lambda *_: {}, hangs=lambda _: False)
    found = roles._receiver(evidence, ground, {1}, {1}, ())
    assert (found.instance_ids, found.confidence) == ({2}, 1.0)


def test_what_a_pit_shows_carries_less_than_the_plate_around_it() -> None:
    plate, base, puck = 1, 2, 3
    grid = np.mgrid[-0.6:0.6:60j, -0.6:0.6:60j].reshape(2, -1).T
    pit = np.abs(grid).max(1) < 0.15
    rim = np.array([[x, y] for x in np.linspace(-0.8, 0.8, 6) for y in (-0.8, 0.8)])
    still, poses = np.tile(np.eye(4), (5, 1, 1)), np.tile(np.eye(4), (5, 1, 1))
    poses[3:, :3, 3] = 0.4, 0, 0.1  # lifted out, and over the plate

    def level(*parts: tuple[np.ndarray, float]) -> np.ndarray:
        return np.concatenate([np.column_stack([xy, np.full(len(xy), z)]) for xy, z in parts])

    surfaces = {
        plate: level((grid[~pit], 0.05)),
        base: level((grid[pit], 0.0), (rim, -0.6)),
        puck: level((grid[np.abs(grid).max(1) < 0.03], 0.02)),
    }
    things = {
        h: Thing(
            h,
            Body(frozenset([h]), *((poses, "aligned") if h == puck else (still, "static")), 0.0),
            points,
            np.tile([0, 0, 1.0], (len(points), 1)),
            points.min(0),
            points.max(0),
        )
        for h, points in surfaces.items()
    }
    gripper = poses[:, :3, 3] + [0, 0, 0.1]
    seen = np.concatenate([surfaces[plate], surfaces[base]])  # by one camera above
    sampled = SimpleNamespace(
        frames=np.arange(5),
        depth=np.ones((5, 1, 1, len(seen))),
        points=np.tile(seen, (5, 1, 1, 1, 1)),
        cam_to_world=np.tile(boxes.at(0, 0, 3), (5, 1, 1, 1)),
    )
    ground = Ground(Evidence(things, sampled, gripper, np.ones((5, 3, 3))), ())  # type: ignore[arg-type]
    assert ground.top(base).height == pytest.approx(0)
    load = ground.carried({puck: 0.4}, roles.NEAR)
    fallen = load.weight[base] - load.passed[plate, base]
    assert load.weight[plate] > fallen > 0


def test_a_floor_that_is_seen_below_a_table_from_beside_is_no_hole_in_it() -> None:
    table, floor, box = 1, 2, 3
    grid = np.mgrid[-0.5:0.5:50j, -0.5:0.5:50j].reshape(2, -1).T
    hidden = np.abs(grid - [0.2, 0]).max(1) < 0.1  # the box stands there
    still = Body(frozenset([0]), np.tile(np.eye(4), (2, 1, 1)), "static", 0.0)

    def thing(instance_id: int, xy: np.ndarray, z: float) -> Thing:
        points = np.column_stack([xy, np.full(len(xy), z)])
        up = np.tile([0, 0, 1.0], (len(points), 1))
        return Thing(instance_id, still, points, up, points.min(0), points.max(0))

    def landing(eye: np.ndarray, ends: np.ndarray) -> dict[int, float]:
        """What the box lands on if the ends were seen from a place."""
        sampled = SimpleNamespace(
            frames=np.arange(1),
            depth=np.ones((1, 1, 1, len(ends))),
            points=ends[None, None, None],
            cam_to_world=boxes.at(*eye)[None, None],
        )
        things = {
            table: thing(table, grid[~hidden], 0.0),
            floor: thing(floor, grid, -0.7),
            box: thing(box, grid[hidden], 0.2),
        }
        evidence = Evidence(things, sampled, None, np.ones((1, 3, 3)))  # type: ignore[arg-type]
        return Ground(evidence, ()).landing(things[box].points, box)

    below = np.column_stack([grid, np.full(len(grid), -0.7)])
    assert landing(np.array([2, 0, -0.3]), below) == {table: 1.0}
    through = landing(np.array([0.2, 0, 2]), below[hidden])
    assert through[floor] > 0.3  # but for what is next to the table that was seen


def test_a_handle_in_the_hand_from_the_first_frame_is_no_link() -> None:
    hand = boxes.path((0.0, 0, 0.25), (0.0, 0, 0.15), steps=12)
    hinge, long = np.array([0.2, 0, 0.2]), 0.2
    handle = []
    for angle in np.arcsin((hand[:, 2] - 0.05 - hinge[2]) / long):
        turned = geometry.rigid(np.array([0, angle, 0]), hinge)
        handle.append(turned @ boxes.at(-long / 2, 0, 0))
    things = boxes.furniture() | {
        PAD: Box((0.1, 0.1, 0.3), boxes.at(0.25, 0, 0.15), (0, 0, 200)),
        BLOCK: Box((long, 0.06, 0.03), np.stack(handle), (0, 160, 0)),
        HAND: Box((0.05, 0.12, 0.06), boxes.poses(hand), (230, 230, 230)),
    }
    found = _believed(World(things, boxes.poses(hand), np.zeros(len(hand))))
    assert HAND in found["robot"].instance_ids
    assert BLOCK not in found["robot"].instance_ids


def test_what_fills_no_surface_has_no_role(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    episode = world.episode()
    name, view = next(iter(episode.views.items()))
    assert view.ids is not None

    def speckled(t: int) -> np.ndarray:
        ids = view.ids(t).copy()  # type: ignore[misc]
        ids[1, [3, 9]] = VOID
        return ids

    views = {**episode.views, name: replace(view, ids=speckled)}
    void = replace(episode, views=views)
    assert roles.held(roles.believe(void, bodies.track(void))) == scene.roles


@pytest.mark.gl
def test_what_is_pressed_is_manipulated_though_nothing_is_seen_to_move() -> None:
    """Thirty frames show the button's centimetre too seldom for a track."""
    take = twin.perform("push_button", 1000, episode=0, frames=30)
    names = {instance_id: name for name, instance_id in take.truth.handles.items()}
    found = build(take.episode, with_bodies=True).roles
    assert {names[h] for h in found["manipulated"]} == {"button"}
    assert {names[h] for h in found["receiver"]} == {"button_base"}


def test_gaps_are_those_of_all_pairs_of_points():
    """Three clusters: the first two 3 cm apart, the third touching the second; the widths of both pixels taken off."""
    rng = np.random.default_rng(0)
    ids = np.repeat([1, 2, 3], 60).astype(np.int32)
    points = (
        rng.random((180, 3)) * 0.02 + np.array([[0, 0, 0], [0.05, 0, 0], [0.069, 0, 0]])[ids - 1]
    )
    pixel = 0.0005 + 0.001 * rng.random(180)
    gaps = np.full((3, 3), np.nan)
    _between(ids, np.ones(180, np.float32), pixel, points, np.array([1, 2, 3], np.int32), gaps)
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    apart -= 2 * np.maximum(pixel[:, None], pixel[None])
    for a, b in ((0, 1), (0, 2), (1, 2)):
        expected = max(0.0, apart[ids == a + 1][:, ids == b + 1].min())
        np.testing.assert_allclose([gaps[a, b], gaps[b, a]], expected, rtol=1e-12)
    assert 0.02 < gaps[0, 1] < 0.05
    assert gaps[1, 2] == 0
