"""A whole job on color images with outlines for models: what words name is edited, in every camera and frame."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from rgb_only_tables import BLOCK, episode, image

import rpaug
from rpaug.core.errors import TargetError
from rpaug.pipeline import prepare, recipe
from rpaug.scene.targets import nouns, targets
from rpaug.scene.targets.targets import Target

LENGTH = 12


def truth(color: tuple[int, int, int], t: int) -> np.ndarray:
    return np.abs(image(t, noise=0).astype(int) - color).max(-1) == 0


def outlines(tmp_path: Path, words: str = "gadget", times: range = range(LENGTH)) -> str:
    rows, columns = np.nonzero(truth(BLOCK, 0))
    corners = [
        [int(columns.min()), int(rows.min())], [int(columns.max()), int(rows.min())],
        [int(columns.max()), int(rows.max())], [int(columns.min()), int(rows.max())],
    ]  # fmt: skip
    frames = {str(t): [{"words": words, "polygon": corners}] for t in times}
    path = tmp_path / "outlines.json"
    path.write_text(json.dumps({episode().key: {"image_0": frames}}))
    return f"outlines:{path}"


def asked(text: str, model: str, **more: object) -> recipe.Recipe:
    edit = {"op": "recolor", "target": {"text": text}, "color": "green", **more}
    return recipe.build({"version": 1, "models": {"text": model}, "edits": [edit]})


def test_a_thing_is_edited_by_its_name_alone(tmp_path: Path) -> None:
    given = asked("the gadget", outlines(tmp_path))
    scene, plan = prepare.prepare_scene(episode(), given, 0)
    (instance,) = targets.find(scene, Target(text="the gadget"))
    assert scene.names == {"gadget": frozenset({instance})}
    assert any(
        "'gadget': instance" in one and "12 frames of image_0" in one for one in plan.assumed
    )
    made = rpaug.augment(episode(), given.source)
    for t in (0, 5, 11):
        block, before = truth(BLOCK, 0), episode().views["image_0"].rgb(t)
        after = made.views["image_0"].rgb(t)
        changed = (after != before).any(-1)
        near = (
            cv2.dilate(block.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        )  # a lens mixes there
        assert not (changed & ~near).any()
        shown = block & (scene.episode.views["image_0"].ids(t) == instance)
        red, green = (after[shown][:, k].astype(int).mean() for k in (0, 1))
        assert green > red


def test_what_models_do_not_find_is_refused(tmp_path: Path) -> None:
    model = outlines(tmp_path)
    path = Path(model.removeprefix("outlines:"))
    drawn = json.loads(path.read_text())
    corners = [[2, 2], [8, 2], [8, 8], [2, 8]]
    for_a_moment = {"words": "widget", "polygon": corners}
    drawn[episode().key]["image_0"]["5"].append(for_a_moment)
    path.write_text(json.dumps(drawn))
    given = asked("the widget", model)
    with pytest.raises(TargetError, match="the models found no widget"):
        prepare.ground(prepare.prepare_scene(episode(), given, 0)[0], given)


def test_without_a_model_a_line_says_what_one_would_add() -> None:
    given = recipe.build({"version": 1, "edits": [{"op": "table_color"}]})
    _, plan = prepare.prepare_scene(episode(), given, 0)
    assert any("--models text=NAME" in one for one in plan.assumed)


def test_what_the_instruction_names_is_manipulated_where_nothing_else_tells() -> None:
    told = replace(episode(), descriptions=("put the gadget on the plate",))
    names = {"gadget": frozenset({7}), "plate": frozenset({8, 9})}
    found = nouns.by_instruction(told.descriptions, names, ())
    assert found["manipulated"].instance_ids == {7}
    assert "receiver" not in found  # two plates
    assert nouns.by_instruction(told.descriptions, names, ("manipulated",)) == {}
    assert nouns.things(told.descriptions) == ["gadget", "plate"]
