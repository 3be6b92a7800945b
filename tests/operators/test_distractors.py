"""Distractors stand where they were asked to: near what matters, apart, in reach, alike, together; or it is said."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from tabletop import instance_id, scene

from rpaug.assets import library
from rpaug.compose import inserted
from rpaug.core import color_space, geometry
from rpaug.core.errors import BadRecipe, TargetError, Unsupported
from rpaug.operators import distractors
from rpaug.operators.distractors import Distractors
from rpaug.pipeline.copies import Draw
from rpaug.pipeline.recipe import Option
from rpaug.pipeline.run import Summary
from rpaug.scene.placement import placing, zones

pytestmark = pytest.mark.gl


def drawn(seed: int = 0, **fields) -> dict:
    return Distractors(harmonise=False, **fields).sample(scene(), np.random.default_rng(seed))


def points(thing: dict) -> np.ndarray:
    mesh = library.mesh(thing["asset"])
    return geometry.transform(np.array(thing["pose"]), thing["scale"] * mesh.points)


def middle(thing: dict) -> np.ndarray:
    flat = points(thing)[:, :2]
    return (flat.min(0) + flat.max(0)) / 2


def away(thing: dict) -> float:
    """Metres from its middle to the target or the low path."""
    level = placing.find_free_space(scene()).level
    near = np.concatenate([zones.target_places(scene()), zones.low_path(scene(), level)])[:, :2]
    return float(np.linalg.norm(near - middle(thing), axis=1).min())


SHARES = some.fixed_dictionaries({"path": some.floats(0, 0.5), "target": some.floats(0, 0.5)})


@settings(max_examples=8, deadline=None)
@given(SHARES, some.integers(1, 4), some.integers(1, 3), some.integers(0, 2**16))
def test_wherever_they_stand_they_are_apart_at_rest_and_in_reach(near, count, groups, seed) -> None:
    edit = drawn(seed, near=near, count=count, groups=groups)
    assert edit == drawn(seed, near=near, count=count, groups=groups)
    assert sum(edit["asked"].values()) == count == len(edit["things"])
    room = placing.find_free_space(scene())
    low, high = zones.workspace(scene())
    outlines = []
    for thing in edit["things"]:
        where = points(thing)
        assert where[:, 2].min() == pytest.approx(room.level, abs=1e-6)
        if not edit["elsewhere"]:
            assert ((middle(thing) >= low) & (middle(thing) <= high)).all()
        outline = placing.hull(where)
        covered = room.covered(outline)
        assert not (covered & (room.still < 0.001)).any()
        assert not (covered & (room.swept < where[:, 2].max() - room.level)).any()
        outlines.append(outline)
    for k, one in enumerate(outlines):
        for other in outlines[:k]:
            assert np.linalg.norm(one[:, None] - other, axis=-1).min() > 0.01


def test_a_third_stands_near_unless_asked_otherwise() -> None:
    things = [thing for seed in range(20) for thing in drawn(seed, count=3)["things"]]
    near = np.mean([away(thing) <= 0.15 for thing in things])
    assert near == pytest.approx(1 / 3, abs=0.05)


@pytest.mark.parametrize("near", ["path", "target"])
def test_a_word_means_all_of_them(near) -> None:
    assert (
        max(away(thing) for seed in range(4) for thing in drawn(seed, near=near)["things"]) < 0.15
    )


def test_what_finds_no_room_near_stands_elsewhere_and_that_is_said(monkeypatch) -> None:
    monkeypatch.setattr(zones, "low_path", lambda scene, level: np.zeros((0, 3)))
    operator = Distractors(near={"path": 1.0}, harmonise=False)
    edit = operator.sample(scene(), np.random.default_rng(0))
    assert edit["elsewhere"] == edit["asked"] == {"path": 2}
    (line,) = Draw(0, Option("distractors", {}, operator), edit).describe()["fell_short"]
    low = "within 15 cm of the gripper's low path"
    said = f"added things stand elsewhere: no room {low}"
    assert line == f"2 of 2 {said}"
    short = {"edit": "distractors", "count": 2, "of": 8, "what": said, "episodes": ["a", "b"]}
    assert Summary(fell_short=[short]).shortfalls == [f"distractors: 2 of 8 {said} (a, b)"]
    with pytest.raises(Unsupported, match="no room"):
        drawn(near="path")


def test_a_smaller_thing_is_drawn_where_the_first_does_not_fit() -> None:
    edits = [drawn(seed, near="target", within=0.08) for seed in range(6)]
    names = {thing["asset"] for edit in edits for thing in edit["things"]}
    assert max(library.get(name).largest for name in names) < 0.15


def test_none_stands_twice_while_others_fit() -> None:
    names = ("can_red", "die", "apple")
    for seed in range(4):
        for count, most in ((3, 1), (4, 2)):
            things = drawn(seed, assets=names, count=count)["things"]
            stand = [sum(thing["asset"] == name for thing in things) for name in names]
            assert max(stand) == most


def test_what_fits_stands_twice_where_the_rest_does_not(monkeypatch) -> None:
    fitting = distractors._stood_in
    monkeypatch.setattr(
        distractors, "_stood_in",
        lambda room, zone, group, margin, alike, *rest: (
            None if [one.name for one in alike.choices] == ["die"]
            else fitting(room, zone, group, margin, alike, *rest)
        ),
    )  # fmt: skip
    things = drawn(0, assets=("can_red", "die"), count=3)["things"]
    assert len(things) == 3


def test_sizes_bound_the_longest_side() -> None:
    edits = [drawn(seed, count=3, size=(0.04, 0.07)) for seed in range(4)]
    names = {thing["asset"] for edit in edits for thing in edit["things"]}
    assert len(names) > 1
    assert all(0.04 <= library.get(name).largest <= 0.07 for name in names)


def test_look_alikes_have_the_targets_color_or_proportions() -> None:
    edit = drawn(like="color")
    first, second = (thing["color"] for thing in edit["things"])
    assert first == second
    after = Distractors().apply(scene(), edit)
    for body in inserted.bodies(after):
        shown = color_space.typical(body.mesh.image.reshape(-1, 3))
        assert np.abs(shown / shown.max() - np.array(first) / max(first)).max() < 0.1
    size = np.array([0.05, 0.05, 0.05])
    alike = distractors._shaped(library.assets(), size, (0.04, 0.16))
    sides = np.array([np.sort(asset.size) for asset in alike.choices])
    every = np.array([np.sort(asset.size) for asset in library.assets()])
    assert np.median(sides[:, 0] / sides[:, 2]) > 1.3 * np.median(every[:, 0] / every[:, 2])
    assert all(
        alike.scales[asset.name] * asset.largest == pytest.approx(0.05) for asset in alike.choices
    )


def test_what_the_library_lacks_is_painted_and_scaled() -> None:
    edit = drawn(category="block", color="blue", size=(0.04, 0.04), near="anywhere")
    for thing in edit["things"]:
        asset = library.get(thing["asset"])
        assert asset.category == "block"
        assert thing["scale"] * asset.largest == pytest.approx(0.04)
        assert color_space.nearest(np.array(thing["color"])) == "blue"


def test_assets_that_are_named_stay_as_they_are() -> None:
    name = max(library.find("block"), key=lambda one: one.largest).name
    for thing in drawn(assets=(name,), near="anywhere")["things"]:
        assert (thing["asset"], thing["scale"], "color" in thing) == (name, 1.0, False)


def test_things_of_a_group_stand_together() -> None:
    for seed in range(3):
        edit = drawn(seed, count=3, groups=3, size=(0.04, 0.08))
        outlines = [placing.hull(points(thing)) for thing in edit["things"]]
        for k in (1, 2):
            gaps = [np.linalg.norm(outlines[k][:, None] - o, axis=-1).min() for o in outlines[:k]]
            assert 0.01 < min(gaps) < 0.1


def test_shares_are_at_most_one_and_cameras_known() -> None:
    with pytest.raises(BadRecipe, match="more than 1"):
        Distractors(near={"path": 0.7, "target": 0.7})
    with pytest.raises(TargetError, match="no camera is called"):
        drawn(cameras=("nose",))


def test_without_a_table_nothing_is_placed_on_the_floor() -> None:
    roles = {role: ids for role, ids in scene().roles.items() if role != "table"}
    bare = replace(scene(), roles=roles)
    with pytest.raises(TargetError, match="nothing was seen to be the table"):
        Distractors().sample(bare, np.random.default_rng(0))
    assert instance_id("floor") not in scene().roles["table"]
