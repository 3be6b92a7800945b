"""An edit that an episode has nothing for: left out with its reason, its copy kept aside, or the run ended."""

import json
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from rpaug_adapters.rlbench import RLBench
from runs import GROUP, augment, contents

import rpaug
from rpaug.core.errors import Missing, TargetError
from rpaug.core.files import REJECTED
from rpaug.core.types import Scene
from rpaug.pipeline import card, copies, prepare, recipe, report
from rpaug.pipeline.verify import verify
from rpaug.scene.build import build
from rpaug.training import AugmentedEpisodes

NOWHERE = {"op": "recolor", "target": {"handle": 4711}, "color": "red"}
LIGHT = {"op": "light_color", "range": [[0.1] * 3, [0.5] * 3]}


def header(target: Path) -> dict[str, Any]:
    return dict(yaml.safe_load((target / card.NAME).read_text().split("---\n")[1]))


def asked(*edits: dict[str, Any], **keys: Any) -> recipe.Recipe:
    return recipe.build({"version": 1, "seed": 3, "edits": list(edits), **keys})


@pytest.fixture(scope="module")
def scene(template: Path) -> Scene:
    return build(RLBench().read(template, f"{GROUP}/episode0"), with_bodies=True)


def test_what_is_left_out_shifts_no_other_draw(scene: Scene) -> None:
    there = {
        **NOWHERE,
        "target": {"handle": min(scene.instance_ids)},
        "color": {"sample": "colosseum"},
    }
    for copy in range(4):
        for probability in (1.0, 0.5):
            drawn = [
                copies.draw(scene, asked({**first, "probability": probability}, LIGHT), copy)[1]
                for first in (there, NOWHERE)
            ]
            assert drawn[0][1] == drawn[1][1]
            # What was not drawn is not said to be missing.
            assert bool(drawn[0][0].edit) == bool(drawn[1][0].left_out)


def test_a_copy_that_shows_what_was_recorded_is_not_called_synthetic(
    template: Path, tmp_path: Path
) -> None:
    """Copies of which nothing could be made were duplicates, called synthetic, with exit code 0."""
    rare = {**NOWHERE, "probability": 0.999}, {**LIGHT, "probability": 0.001}
    empty = augment(template, asked(*rare, copies=2), tmp_path / "empty")
    assert (empty.copies, empty.as_recorded, empty.exit_code) == (4, 4, 1)
    assert header(tmp_path / "empty")["episodes"] == {"recorded": 4, "synthetic": 0}
    some = augment(
        template, asked(NOWHERE, {**LIGHT, "probability": 0.5}, copies=4), tmp_path / "some"
    )
    keys = RLBench().episodes(tmp_path / "some")
    given = [json.loads((tmp_path / "some" / key / report.NAME).read_bytes()) for key in keys]
    edited = ["edit" in one["draws"][1] for one in given]
    assert [one["synthetic"] for one in given] == edited
    assert some.as_recorded == edited.count(False)
    assert 0 < edited.count(True) < len(keys)


def test_what_is_left_out_is_a_line_in_report_and_summary(template: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    summary = augment(template, asked(NOWHERE, LIGHT, copies=2), out)
    assert (summary.copies, summary.exit_code) == (4, 1)  # all copies were to have it, none has
    maybe = augment(template, asked({**NOWHERE, "probability": 0.9}, LIGHT), tmp_path / "maybe")
    assert (maybe.copies, maybe.exit_code) == (2, 0)
    (line,) = json.loads((out / report.SUMMARY).read_bytes())["left_out"]
    assert {"episodes": 2, "drawn_in": 2, "copies": 4}.items() <= line.items()
    (why,) = line["reasons"]
    brief, _, instead = why["reason"].partition("; there is: ")
    assert instead
    assert summary.lacked == [
        f"recolor of handle 4711: in no copy: 2 of 2 episodes lacked it: {brief}"
    ]
    key = RLBench().episodes(out)[0]
    given = json.loads((out / key / report.NAME).read_bytes())
    assert "no such instance 4711" in given["draws"][0]["left_out"]
    assert "edit" not in given["draws"][0]
    assert verify(out, template).passed
    again = tmp_path / "again"
    written = rpaug.replay(given, template, again)
    assert contents(again / written) == contents(out / key)


def test_a_copy_that_lacks_an_edit_may_be_kept_aside(template: Path, tmp_path: Path) -> None:
    wanted = asked({**NOWHERE, "probability": 0.5}, LIGHT, copies=3, on_missing="skip_copy")
    summary = augment(template, wanted, tmp_path / "out")
    assert summary.exit_code == 1
    assert summary.copies + len(summary.rejected) == 6
    assert 0 < summary.copies < 6
    assert all("recolor: handle 4711" in why for why in summary.rejected.values())
    for key in RLBench().episodes(tmp_path / "out" / REJECTED):
        given = report.of(tmp_path / "out" / REJECTED / key)
        assert given
        assert given["draws"][0]["left_out"]


def test_a_run_may_be_ended_by_it(template: Path, tmp_path: Path, scene: Scene) -> None:
    wanted = asked(LIGHT, NOWHERE, on_missing="fail")
    summary = augment(template, wanted, tmp_path / "out")
    assert summary.exit_code == 1
    assert "recolor: handle 4711: no such instance" in str(summary.aborted)
    assert not (tmp_path / "out").exists()
    with pytest.raises(Missing, match="4711"):
        copies.draw(scene, wanted, 1)


def test_all_that_is_lacking_is_told_at_once(scene: Scene) -> None:
    nothing = {**NOWHERE, "target": {"handle": 4712}}
    with pytest.raises(Missing, match=r"4711.*4712"):
        prepare.ground(scene, asked(LIGHT, NOWHERE, nothing, on_missing="fail"))
    off = SimpleNamespace(spread=0.2)
    views = {name: replace(view, sensed=off) for name, view in scene.episode.views.items()}
    rough = replace(scene, episode=replace(scene.episode, views=views))
    (why,) = prepare.ground(rough, asked(LIGHT, {"op": "remove", "target": {"handle": 4711}}))
    assert "may be off by 200 mm" in why
    assert "no such instance 4711" in why


def test_an_episode_is_lost_only_if_all_its_edits_are_missing(
    template: Path, tmp_path: Path, scene: Scene
) -> None:
    with pytest.raises(TargetError, match=r"recolor: handle 4711"):
        prepare.ground(scene, asked(NOWHERE))
    (missing,) = prepare.ground(scene, asked({"one_of": [NOWHERE, LIGHT]}))
    assert "4711" in missing
    assert augment(template, asked(NOWHERE), tmp_path / "out").exit_code == 2


def test_training_names_what_it_leaves_out(template: Path) -> None:
    with pytest.warns(UserWarning, match="recolor is left out: handle 4711"):
        item = AugmentedEpisodes(template, asked(NOWHERE, LIGHT), frames=[0])[0]
    assert not item["skipped"]
    assert "left_out" in item["edits"][0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wanted = asked(NOWHERE, LIGHT, on_missing="skip_copy")
        assert "4711" in AugmentedEpisodes(template, wanted, frames=[0])[0]["skipped"]
    with pytest.raises(Missing):
        _ = AugmentedEpisodes(template, asked(NOWHERE, LIGHT, on_missing="fail"))[0]
