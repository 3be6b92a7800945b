"""Things that the robot leaves alone stand elsewhere, apart from all others, or twice; what it touches is refused."""

from dataclasses import replace

import numpy as np
import pytest
from tabletop import instance_id, scene, take

from rpaug.core.errors import BadRecipe, Unsupported
from rpaug.operators.duplicate import Duplicate
from rpaug.operators.move import Move
from rpaug.operators.physics import Physics
from rpaug.operators.remove import Remove
from rpaug.operators.spread import Spread
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.placement import placing, standing, untouched, zones
from rpaug.scene.placement.free_space import ASKED, CELL
from rpaug.scene.targets.targets import Target

pytestmark = pytest.mark.gl


class TestMove(OperatorContract):
    def operator(self):
        return Move(target=Target(handle=instance_id("cylinder")))

    def scene(self):
        return scene()


class TestDuplicate(OperatorContract):
    def operator(self):
        return Duplicate(target=Target(handle=instance_id("block_textured")))

    def scene(self):
        return scene()


class TestSpread(OperatorContract):
    def operator(self):
        return Spread()

    def scene(self):
        return scene()


def middle(points):
    return (points.min(0) + points.max(0)) / 2


def test_a_moved_thing_stands_where_it_was_put():
    corners = 0.06 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    spot = placing.find_free_space(scene()).draw(
        corners, 0.15, np.random.default_rng(0), near=(np.array([0.3, 0.0]), 0.5)
    )
    operator = Move(target=Target(handle=instance_id("cylinder")), to=tuple(spot), turn=0)
    after = operator.apply(scene(), operator.sample(scene(), np.random.default_rng(0)))
    view = shown(after).views["overhead"]
    held = view.ids(0) == instance_id("cylinder")
    assert held.any()
    free_space = placing.find_free_space(after)
    at = placing.points_of(scene(), [instance_id("cylinder")])
    body = next(b for b in after.bodies if instance_id("cylinder") in b.instance_ids)
    np.testing.assert_allclose(
        middle(at @ body.to_world[0, :3, :3].T + body.to_world[0, :3, 3])[:2], spot, atol=0.01
    )
    cell = np.rint((spot - free_space.origin) / CELL).astype(int)
    assert free_space.still[cell[1], cell[0]] < 0.02  # its foot is hardly seen


def test_a_place_that_is_taken_is_refused():
    with pytest.raises(Unsupported, match="there is no room at"):
        Move(target=Target(handle=instance_id("cylinder")), to=(0.34, 0.26)).sample(
            scene(), np.random.default_rng(0)
        )


def test_a_turned_thing_needs_room_as_it_then_stands():
    ids = frozenset([instance_id("block_textured")])
    around = placing.find_free_space(scene(), leaving=ids)
    one = standing.thing(scene(), ids, around, "moving")
    turn = float(np.random.default_rng(0).uniform(-1, 1))
    lies, stands = (
        around.spots(shape, one.top, ASKED)
        for shape in (one.outline, standing.turned(one.outline, turn))
    )
    before, after = (
        tuple(around.origin + CELL * np.argwhere(cells)[0][::-1])
        for cells in (lies & ~stands, stands & ~lies)
    )
    target = Target(handle=min(ids))
    with pytest.raises(Unsupported, match="there is no room at"):
        Move(target=target, to=before, turn=1).sample(scene(), np.random.default_rng(0))
    edit = Move(target=target, to=after, turn=1).sample(scene(), np.random.default_rng(0))
    assert edit["motion"][1][0] == pytest.approx(np.sin(turn))


def test_places_keep_their_distance():
    free_space = placing.find_free_space(scene())
    corners = 0.03 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    rng = np.random.default_rng(0)
    true = [
        take().poses[name][0, :2, 3]
        for name in ("pad", "cylinder", "block_small", "block_textured")
    ]
    for _ in range(40):
        spot = free_space.draw(corners, 0.1, rng)
        assert min(np.linalg.norm(spot - other) for other in true) > 0.08
    tall = free_space.spots(corners, 1.0).sum()
    assert tall < free_space.spots(corners, 0.1).sum()


def test_a_thing_that_stands_there_takes_the_room():
    free_space = placing.find_free_space(scene())
    corners = 0.03 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    spot = free_space.draw(corners, 0.1, np.random.default_rng(0))
    assert spot is not None
    assert free_space.draw(corners, 0.1, np.random.default_rng(0), near=(spot, 0.02)) is not None
    assert (
        free_space.with_thing(corners + spot).draw(
            corners, 0.1, np.random.default_rng(0), near=(spot, 0.05)
        )
        is None
    )


def test_copies_have_handles_of_their_own_and_stay():
    operator = Duplicate(target=Target(handle=instance_id("block_textured")), count=2)
    edit = operator.sample(scene(), np.random.default_rng(1))
    new = {instance_id for copy in edit["copies"] for instance_id in copy["handles"].values()}
    assert len(new) == 2
    assert not new & scene().instance_ids
    after = shown(operator.apply(scene(), edit))
    seen = {h for view in after.views.values() for h in np.unique(view.ids(0)).tolist()}
    assert seen >= new
    assert instance_id("block_textured") in seen


def test_spread_leaves_alone_what_has_a_role():
    edit = Spread().sample(scene(), np.random.default_rng(0))
    moved = {instance_id for move in edit["moves"] for instance_id in move["handles"]}
    assert moved
    assert not moved & frozenset().union(*scene().roles.values())


@pytest.mark.parametrize("kind", [Move, Duplicate, Remove, Physics])
def test_without_a_target_one_thing_that_the_robot_leaves_alone_is_drawn(kind):
    operator = kind(material="rubber", particles=500) if kind is Physics else kind()
    edits = [operator.sample(scene(), np.random.default_rng(seed)) for seed in range(6)]
    if kind is Duplicate:
        drawn = [{int(old) for copy in edit["copies"] for old in copy["handles"]} for edit in edits]
    else:
        drawn = [set(edit["handles"]) for edit in edits]
    taken = frozenset().union(*scene().roles.values())
    assert all(one and not one & taken for one in drawn)
    assert len({tuple(sorted(one)) for one in drawn}) > 1


def test_where_the_robot_leaves_nothing_alone_there_is_nothing_to_draw():
    things = frozenset().union(*scene().roles.values())
    bare = replace(
        scene(), bodies=tuple(body for body in scene().bodies if body.instance_ids <= things)
    )
    with pytest.raises(Unsupported, match="nothing stands on the table that the robot leaves"):
        Remove().sample(bare, np.random.default_rng(0))


def test_what_stands_by_the_target_is_not_drawn(monkeypatch):
    """The target is brought to 4 cm from the cylinder."""
    drawn = {frozenset(one.instance_ids) for one in untouched.loose(scene(), "")}
    cylinder = frozenset([instance_id("cylinder")])
    points = placing.points_of(scene(), cylinder)
    beside = points[points[:, 0] == points[:, 0].max()] + np.array([0.04, 0, 0])
    monkeypatch.setattr(zones, "target_places", lambda there: beside)
    left = {frozenset(one.instance_ids) for one in untouched.loose(scene(), "")}
    assert left < drawn
    assert cylinder in drawn - left


def test_without_a_target_nothing_is_known_to_be_beside_the_point():
    lost = replace(
        scene(), roles={k: v for k, v in scene().roles.items() if k in ("table", "robot")}
    )
    with pytest.raises(Unsupported, match="what the task is about is not known"):
        Remove().sample(lost, np.random.default_rng(0))


@pytest.mark.parametrize("operator", [Move, Duplicate])
@pytest.mark.parametrize("role", ["manipulated", "robot", "table"])
def test_what_the_robot_acts_on_is_refused(operator, role):
    with pytest.raises(Unsupported, match=r"recorded actions would be untrue|carries the rest"):
        operator(target=Target(role=role)).sample(scene(), np.random.default_rng(0))


@pytest.mark.parametrize("role", ["manipulated", "robot", "table"])
def test_what_the_robot_acts_on_is_not_spread(role):
    with pytest.raises(Unsupported, match=r"recorded actions would be untrue|carries the rest"):
        Spread(targets=(Target(role=role),)).sample(scene(), np.random.default_rng(0))


def test_no_room_is_said():
    with pytest.raises(Unsupported, match="no free place within 1 cm"):
        Move(target=Target(handle=instance_id("cabinet")), shift=0.01, turn=0).sample(
            scene(), np.random.default_rng(0)
        )


def test_what_does_not_stand_on_the_table_is_refused():
    free_space = placing.find_free_space(scene())
    with pytest.raises(Unsupported, match="does not stand on the table"):
        standing.thing(scene(), frozenset({instance_id("floor")}), free_space, "moving")


def test_a_thing_moves_as_the_robot_sees_it():
    around = placing.find_free_space(scene(), leaving=frozenset([instance_id("cylinder")]))
    one = standing.thing(scene(), frozenset([instance_id("cylinder")]), around, "")
    spot = around.draw(one.outline, one.top, np.random.default_rng(0))
    # The twin's robot works along x, so its left is y.
    wish = Move(target=Target(handle=instance_id("cylinder")), by=tuple(spot - one.middle), turn=0)
    motion = np.array(wish.sample(scene(), np.random.default_rng(0))["motion"])
    np.testing.assert_allclose(motion[:2, 3], spot - one.middle, atol=1e-9)


def test_a_thing_moves_next_to_another():
    pad = take().poses["pad"][0, :2, 3]
    wish = Move(
        target=Target(handle=instance_id("cylinder")),
        near=Target(handle=instance_id("pad")),
    )
    edit = wish.sample(scene(), np.random.default_rng(0))
    one = standing.thing(
        scene(), frozenset([instance_id("cylinder")]), placing.find_free_space(scene()), ""
    )
    spot = np.array(edit["motion"])[:2, :2] @ one.middle + np.array(edit["motion"])[:2, 3]
    assert np.linalg.norm(spot - pad) < 0.35
    with pytest.raises(BadRecipe, match="give one of"):
        Move(target=Target(handle=1), by=(0, 0), to=(0, 0))
