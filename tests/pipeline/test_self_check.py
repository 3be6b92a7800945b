"""Roles that the recording refutes: the edits that went by them are rejected before anything is rendered."""

from dataclasses import dataclass, replace
from pathlib import Path

import boxes
import numpy as np
import pytest
from pydantic import TypeAdapter

from rpaug.core.interfaces import Edit
from rpaug.core.types import Belief, Scene
from rpaug.operators.recolor import AlbedoRatio, Recolor
from rpaug.pipeline import copies, plan, recipe, self_check

TABLE = {"op": "table_color"}
PUT_IN = {"op": "distractors", "count": 1, "harmonise": False}
BLOCK = {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"}
WALLS = {"op": "background_texture", "texture": "oak"}


def known(scene: Scene, *edits: dict, **keys: object) -> tuple[str, ...]:
    """The faults of a copy with these edits before it is rendered."""
    wanted = recipe.build({"version": 1, "seed": 1, "edits": list(edits), **keys})
    operators = [option.operator for step in wanted.steps for option in step.options]
    prepared = copies.PreparedEpisode(scene, plan.make(operators, scene.episode), wanted)
    return copies.draw_copy(prepared, 1, judge=lambda made: ()).known


@pytest.fixture(scope="module")
def right(placed: tuple[boxes.World, Scene]) -> Scene:
    roles = {
        "manipulated": frozenset({boxes.BLOCK}),
        "receiver": frozenset({boxes.PAD}),
        "robot": frozenset({boxes.HAND}),
        "table": frozenset({boxes.TABLE}),
        "background": frozenset({boxes.FLOOR, boxes.WALL}),
    }
    return replace(placed[1], roles=roles, beliefs={})


@pytest.fixture(scope="module")
def floored(right: Scene) -> Scene:
    """The same scene with the floor taken for the table."""
    background = frozenset({boxes.TABLE, boxes.WALL})
    return replace(
        right, roles={**right.roles, "table": frozenset({boxes.FLOOR}), "background": background}
    )


def test_right_roles_are_not_doubted(right: Scene) -> None:
    assert known(right, TABLE, BLOCK, WALLS, PUT_IN) == ()


def test_a_table_that_bears_nothing_is_refuted(floored: Scene) -> None:
    unseen, away = known(floored, TABLE)
    assert unseen == "table_color: the table: no camera sees a change of it where the robot works"
    assert "no lower than 70 cm above the table" in away
    assert [*self_check.of_place(floored, floored)] == [away]  # whatever is put in there


def test_an_edit_that_does_not_go_by_the_table_is_not_held_against_it(floored: Scene) -> None:
    assert known(floored, BLOCK) == ()


def test_what_is_put_in_stands_on_the_table_or_in_the_receiver(right: Scene) -> None:
    _, draws = copies.draw(right, recipe.build({"version": 1, "edits": [PUT_IN]}), 1)
    option, edit = draws[0].option, draws[0].edit
    assert option
    assert edit
    (thing,) = edit["things"]
    for height, fault in ((0.0, 0), (0.3, 1), (-0.3, 1)):
        pose = [list(row) for row in thing["pose"]]
        pose[2][3] += height
        made = option.operator.apply(right, {**edit, "things": [{**thing, "pose": pose}]})
        assert len(self_check.faults(right, made, [(option, edit)])) == fault


@dataclass(frozen=True, kw_only=True)
class Spilling(Recolor):
    """Paints the pad too and does not say so."""

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        after = super().apply(scene, edit)
        (own,) = after.appearance
        assert isinstance(own, AlbedoRatio)
        return replace(
            after, appearance=(replace(own, instance_ids=own.instance_ids | {boxes.PAD}),)
        )


def test_what_changes_beside_its_target_is_refuted(right: Scene) -> None:
    operator = TypeAdapter(Spilling).validate_python(
        {"target": {"role": "manipulated"}, "color": "yellow"}
    )
    option = recipe.Option("spilling", {}, operator)
    edit = operator.sample(right, np.random.default_rng(0))
    (fault,) = self_check.faults(right, operator.apply(right, edit), [(option, edit)])
    assert "pixels change beside it" in fault


def test_what_a_person_settled_is_not_doubted(floored: Scene) -> None:
    belief = Belief(floored.roles["table"], 1.0, ("roles.yaml",))
    assert known(replace(floored, beliefs={"table": belief}), TABLE) == ()


@pytest.mark.parametrize("gates", [False, {"self_check": False}])
def test_the_check_can_be_turned_off(floored: Scene, gates: object) -> None:
    assert known(floored, TABLE, gates=gates) == ()


def test_off_is_what_yaml_makes_of_it(tmp_path: Path) -> None:
    file = tmp_path / "recipe.yaml"
    for words, checked in (("off", False), ("null", True), ("{holes: 0.1}", True)):
        file.write_text(f"version: 1\ngates: {words}\n")
        loaded = recipe.load(file)
        assert loaded.self_check is checked
        assert (loaded.gates is not None) == ("holes" in words)
