"""A first recipe: valid, with comments, and only of what the episode has something for."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rgb_only_tables
from typer.testing import CliRunner

import rpaug
from rpaug.cli import app
from rpaug.core import registry
from rpaug.core.errors import RpaugError
from rpaug.pipeline import inspect, prepare, recipe, starter


def written(episode: rpaug.Episode, described: Mapping[str, Any], episodes: int = 1) -> str:
    tried = starter.tried(episode, described, episodes)
    return starter.text(tried, tried.offers)


def test_the_sample_has_something_for_every_edit(tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    done = CliRunner().invoke(app, ["init", "sample", "--out", str(path)])
    assert done.exit_code == 0
    assert "rpaug preview sample --recipe" in done.stdout
    made = recipe.load(path)
    assert len(made.steps) == len(starter.CANDIDATES)
    assert "“open the drawer”" in path.read_text()
    assert ".md" not in path.read_text()  # whoever installed rpaug has no docs
    again = CliRunner().invoke(app, ["init", "sample", "--out", str(path), "--json"])
    assert again.exit_code == 2  # nothing is overwritten
    assert "already" in json.loads(again.stdout)["error"]


def test_what_an_episode_lacks_stands_there_as_a_comment_with_why() -> None:
    rgb = np.full((3, 24, 32, 3), 90, np.uint8)
    rgb[:, 8:16, 8:16] = (200, 30, 30)
    masks = np.ones((3, 24, 32), np.int32)
    masks[:, 8:16, 8:16] = 2
    episode = rpaug.Episode.from_arrays(rgb, masks=masks, instruction="push the block")
    made = written(episode, inspect.inspect(episode)[0])
    names = [
        one.name
        for step in recipe.build(starter.parse(made.encode(), "r")[0]).steps
        for one in step.options
    ]
    assert "light_color" in names
    assert len(names) <= starter.FEW
    assert "probability: 0.9" in made  # or many copies would be the recording
    assert "camera_pose" not in names
    assert "# not here: cameras bumped" in made
    assert max(map(len, made.splitlines())) <= 120


def test_instances_are_found_once_for_all_edits_that_are_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rgb = np.full((3, 24, 32, 3), 90, np.uint8)
    rgb[:, 8:16, 8:16] = (200, 30, 30)
    episode = rpaug.Episode.from_arrays(rgb)
    looked, find = [], prepare.find
    monkeypatch.setattr(prepare, "find", lambda *given: looked.append(0) or find(*given))  # type: ignore[func-returns-value]
    written(episode, inspect.inspect(episode)[0])
    assert len(looked) == 1


def test_where_nothing_can_be_edited_the_reasons_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    episode = rpaug.Episode.from_arrays(np.full((2, 24, 32, 3), 90, np.uint8))
    monkeypatch.setattr(starter, "CANDIDATES", starter.CANDIDATES[:1])
    with pytest.raises(RpaugError, match="no edit can be made: "):
        written(episode, {})


@pytest.mark.parametrize("rejected", [2, 3])
def test_an_edit_stays_if_half_of_its_draws_pass(
    rejected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    near = ("near", "{op: camera_pose, camera: front, shift: 0.01, turn: 0.01}")
    monkeypatch.setattr(starter, "CANDIDATES", (starter.CANDIDATES[0], near))

    def faults(scene: object, plan: object, made: recipe.Recipe, copy: int) -> list[str]:
        moves = made.steps[0].options[0].name == "camera_pose"
        return ["dark"] if moves and copy <= rejected else []

    monkeypatch.setattr(starter, "_faults", faults)
    made = written(rpaug.read("sample"), {})
    assert ("would reject 3 of 4 trial copies: dark" in made) == (rejected == 3)


def test_cameras_that_gates_would_refuse_are_a_comment(monkeypatch: pytest.MonkeyPatch) -> None:
    far = ("far", "{op: camera_pose, camera: front, shift: 0.9, turn: 0.5}")
    monkeypatch.setattr(starter, "CANDIDATES", (starter.CANDIDATES[0], far))
    episode = rpaug.read("sample")
    made = written(episode, {})
    assert "# not here: far: the gates, which check copies, would reject" in made
    assert len(recipe.build(starter.parse(made.encode(), "r")[0]).steps) == 1


def test_where_gates_reject_all_cameras_at_once_the_others_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(starter, "CANDIDATES", (starter.CANDIDATES[-1],))

    def faults(scene: object, plan: object, made: recipe.Recipe, copy: int) -> list[str]:
        (option,) = made.steps[0].options
        given = option.operator.camera  # type: ignore[attr-defined]
        return ["torn"] if given == "static" or "overhead" in given else []

    monkeypatch.setattr(starter, "_faults", faults)
    made = written(rpaug.read("sample"), {})
    assert 'camera: ["front", "left_shoulder", "right_shoulder"]' in made
    assert "would reject 4 of 4 trial copies: torn" in made
    assert len(recipe.build(starter.parse(made.encode(), "r")[0]).steps) == 1


def photographed() -> tuple[rpaug.Episode, dict]:
    """Nothing is moved there, a block and a plate lie on a table, and the table is doubted."""
    episode = rgb_only_tables.episode()
    described = inspect.inspect(episode)[0]
    described["roles"]["table"]["believed"] = False
    return episode, described


def test_a_thing_without_a_role_is_offered_as_a_comment() -> None:
    episode, described = photographed()
    assert "manipulated" not in described["roles"]
    alone = written(episode, described)
    (offer,) = [line for line in alone.splitlines() if "target: {handle: " in line]
    among = written(episode, described, episodes=2)
    assert "{handle: " not in among  # it would be refused
    (named,) = [line for line in among.splitlines() if "target: the " in line]
    for line in (offer, named):
        assert line.startswith("  # - {op: recolor")
        recipe.build({"version": 1, "edits": [starter.parse(line[6:].encode(), "r")[0]]})


def test_of_a_video_one_copy_is_made_for_it_takes_minutes() -> None:
    episode, described = photographed()
    assert "copies: 4 " in written(episode, described)
    assert "copies: 1 " in written(episode, described | {"film": {}})
    parts = {"passed_through": [39, 40, 52], "pieces": [[51, 120], [0, 38]]}
    said = " ".join(written(episode, described | {"film": parts}).replace("# ", "").split())
    assert "Frames 39 to 40, 52 have no camera pose: all but light_color and sensor edits" in said
    assert "in pieces (frames 51 to 120; 0 to 38) that are not set beside each other" in said
    assert "rough in videos" in said
    assert "rough in videos" not in written(episode, described)


def test_the_table_of_a_video_is_painted_only_where_a_person_asks_for_it() -> None:
    episode, described = photographed()
    kinds = [
        ("another tabletop", "{op: table_texture, probability: 0.5}"),
        ("lamps", "{op: light_color, probability: 0.5}"),
    ]
    offers = [starter.Offer(words, entry, None) for words, entry in kinds]

    def edits(described: Mapping[str, Any], count: int) -> list[str]:
        tried = starter.Tried(episode, described, 1, tuple(offers[:count]))
        made = starter.parse(starter.text(tried, offers[:count]).encode(), "r")[0]
        return [one["op"] for one in made["edits"]]

    assert edits(described, 2) == ["table_texture", "light_color"]
    assert edits(described | {"film": {}}, 2) == ["light_color"]
    assert edits(described | {"film": {}}, 1) == ["table_texture"]  # nothing else can be made


def test_doubted_roles_are_not_listed_as_found() -> None:
    episode, described = photographed()
    head = written(episode, described).partition("version: 1")[0].replace("\n# ", " ")
    assert "Not sure enough to be edited: table." in head
    assert "table: " not in head


def asked(tmp_path: Path, answers: list[str], *options: str) -> tuple[Any, Path]:
    out = tmp_path / "asked.yaml"
    given = "\n".join(answers) + "\n"
    return CliRunner().invoke(app, ["new-recipe", *options, "--out", str(out)], input=given), out


def test_a_person_says_which_edits_and_how_often(tmp_path: Path) -> None:
    shares = ["0.25", "0", "often", "2", "1", "0", "0", "0", "0", "3"]
    done, out = asked(tmp_path, shares, "sample", "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout[done.stdout.index("{") :])["recipe"] == str(out)
    assert "'often' is not a number from 0 to 1" in done.output
    made = recipe.load(out)
    assert made.copies == 3
    assert [(step.options[0].name, step.probability) for step in made.steps] == [
        ("recolor", 0.25), ("table_texture", 1.0),
    ]  # fmt: skip
    assert "# not here: other walls and floor: not wanted" in out.read_text()


def test_nothing_is_written_where_nothing_is_wanted_or_nobody_answers(tmp_path: Path) -> None:
    done, out = asked(tmp_path, ["0"] * 7, "sample")
    assert done.exit_code == 2
    assert "no edit is wanted" in done.stderr
    silent, out = asked(tmp_path, ["0.5"], "sample")
    assert silent.exit_code != 0
    assert not out.exists()


def test_a_person_points_out_what_no_role_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rgb = np.full((3, 24, 32, 3), 90, np.uint8)
    rgb[:, 8:16, 8:16] = (200, 30, 30)
    masks = np.ones((3, 24, 32), np.int32)
    masks[:, 8:16, 8:16] = 2
    episode = rpaug.Episode.from_arrays(rgb, masks=masks, instruction="push the block")
    monkeypatch.setattr(registry, "read_among", lambda *given: (episode, [episode.key]))
    done, out = asked(tmp_path, ["2", "1", *["0"] * 7, "2"], str(tmp_path))
    assert "2: instance 2 (red)" in done.stderr, done.output
    (step,) = recipe.load(out).steps
    assert step.options[0].name == "recolor"
    assert "handle: 2" in out.read_text()
