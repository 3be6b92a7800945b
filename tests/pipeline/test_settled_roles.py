"""`roles.yaml` settles roles for all episodes of a dataset, wherever scenes are built; disagreement is said."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from analytic import BALL, BOX, TABLE
from rpaug_adapters.rlbench import RLBench
from runs import GROUP, augment, contents
from typer.testing import CliRunner

import rpaug
from rpaug.cli import app
from rpaug.core.errors import BadInput
from rpaug.core.types import Scene
from rpaug.pages import instances
from rpaug.pipeline import inspect as inspection
from rpaug.pipeline import recipe, report, role_facts
from rpaug.scene.build import build
from rpaug.scene.targets.settled import NAME, SettledRole, read, settle
from rpaug.training import AugmentedEpisodes

PAINT = {"op": "recolor", "target": {"role": "receiver"}, "color": "red"}
SETTLED = f"version: 1\nroles:\n  receiver: {{handle: {BOX}}}\n"


@pytest.fixture(scope="module")
def scene(template: Path) -> Scene:
    return build(RLBench().read(template, f"{GROUP}/episode0"), with_bodies=True)


def asked(**keys: Any) -> recipe.Recipe:
    return recipe.build({"version": 1, "edits": [PAINT], **keys})


def test_augment_training_and_replay_go_by_it(dataset: Path, tmp_path: Path) -> None:
    assert augment(dataset, asked(), tmp_path / "without").exit_code == 2  # nobody is the receiver
    (dataset / NAME).write_text(SETTLED)
    out = tmp_path / "out"
    assert augment(dataset, asked(), out).exit_code == 0
    key = RLBench().episodes(out)[0]
    given = report.of(out / key)
    assert given
    assert given["recipe"]["roles"] == {"receiver": {"handle": BOX}}
    assert given["roles"]["receiver"]["reasons"] == [NAME]
    assert [one["handle"] for one in given["draws"][0]["edit"]["surfaces"]] == [BOX]
    (dataset / NAME).unlink()  # a report stands alone
    again = tmp_path / "again"
    assert contents(again / rpaug.replay(given, dataset, again)) == contents(out / key)
    (dataset / NAME).write_text(SETTLED)
    item = AugmentedEpisodes(dataset, asked(), frames=[0], scenes=tmp_path / "scenes")[0]
    assert item["edits"] == given["draws"]
    (dataset / NAME).write_text(SETTLED.replace(str(BOX), str(BALL)))  # no cache answers for it
    item = AugmentedEpisodes(dataset, asked(), frames=[0], scenes=tmp_path / "scenes")[0]
    assert [one["handle"] for one in item["edits"][0]["edit"]["surfaces"]] == [BALL]


def test_a_recipe_goes_before_the_file(dataset: Path) -> None:
    (dataset / NAME).write_text(SETTLED)
    own = asked(roles={"receiver": {"handle": BALL}, "table": {"handle": TABLE}})
    assert own.settled(dataset).source["roles"] == own.source["roles"]


def test_a_settled_role_is_certain_and_takes_its_ids_from_others(scene: Scene) -> None:
    assert TABLE in scene.roles["table"]
    made, wrong = settle(scene, {"receiver": SettledRole(handle=[TABLE])})
    assert made.roles["receiver"] == {TABLE}
    assert "table" not in made.roles
    assert TABLE not in made.beliefs["table"].instance_ids
    assert made.beliefs["receiver"].confidence == 1
    assert wrong == ()


def test_a_settled_role_that_is_not_there_is_absent(scene: Scene) -> None:
    made, (wrong,) = settle(scene, {"table": SettledRole(handle=4711)})
    assert "table" not in made.roles
    assert "no such instance 4711" in wrong
    made, wrong_ids = settle(
        scene, {"table": SettledRole(handle=[4711, BALL])}
    )  # of several, those that are
    assert (made.roles["table"], wrong_ids) == ({BALL}, ())
    _, (wrong,) = settle(scene, {"table": SettledRole(color="magenta")})
    assert "nothing fits" in wrong


def test_a_color_settles_a_role(scene: Scene) -> None:
    _, rows, _ = inspection.inspect(scene.episode)
    for row in rows:
        same = {one.instance_id for one in rows if one.color_name == row.color_name}
        made, _ = settle(scene, {"receiver": SettledRole(color=row.color_name, all=True)})
        assert made.roles["receiver"] == same


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("version: 2\nroles: {}\n", "version: found 2; expected Input should be 1"),
        ("version: 1\nroles: {tabel: {handle: 1}}\n", "roles.tabel"),
        (
            "version: 1\nroles: {table: {handle: 1, color: red}}\n",
            "exactly one of handle and color",
        ),
        ("version: 1\nroles: {table: {color: blarg}}\n", "no color is called 'blarg'"),
        ("version: 1\nroles: {table: {name: desk}}\n", "give handle or color"),
        ("version: 1\nroles: {table: {handle: '1'}}\n", "roles.table.handle"),
        ("a: &a [*a]\n", "line 1"),
        ("just words\n", "file: found 'just words'"),
    ],
)
def test_a_wrong_file_is_refused_with_its_fault(tmp_path: Path, text: str, found: str) -> None:
    (tmp_path / NAME).write_text(text)
    with pytest.raises(BadInput) as error:
        read(tmp_path)
    assert str(tmp_path / NAME) in str(error.value)
    assert found in str(error.value)


def test_inspect_writes_the_file_once(dataset: Path) -> None:
    (dataset / NAME).write_text(SETTLED)
    wish = ["inspect", str(dataset), "--write-roles", "--json"]
    assert CliRunner().invoke(app, wish).exit_code == 2
    assert (dataset / NAME).read_text() == SETTLED
    (dataset / NAME).unlink()
    done = CliRunner().invoke(app, wish)
    assert done.exit_code == 0, done.output
    written = read(dataset)
    assert written["table"].handle == [TABLE]
    assert json.loads(done.stdout)["roles_file"] == str(dataset / NAME)


def test_what_differs_is_said_last(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inspection, "disagreement", lambda *_: ["table: 1 of 2 have none"])
    lines = CliRunner().invoke(app, ["inspect", str(dataset), "--write-roles"]).stdout.splitlines()
    assert lines[-2] == "roles differ: table: 1 of 2 have none"
    assert lines[-1].startswith("roles written to")


def test_no_id_is_written_where_it_would_be_refused() -> None:
    row = SimpleNamespace(role="table", instance_id=3, color_name="gray")
    other = SimpleNamespace(role="", instance_id=4, color_name="gray")
    alike = [{"table": {"handles": [3]}}] * 2  # by chance, where each episode is numbered anew
    assert "  table: {handle: [3]}" in inspection.roles_file([row, other], alike)  # type: ignore[list-item]
    text = inspection.roles_file([row, other], alike, lasting=False)  # type: ignore[list-item]
    assert "handle:" not in text
    assert "# table: [3] in this episode; without recorded masks ids hold in one alone" in text
    by_color = inspection.roles_file([row], alike, lasting=False)  # type: ignore[list-item]
    assert "  table: {color: gray, all: true}" in by_color


def test_a_doubted_role_is_written_as_a_comment_that_settles_it(tmp_path: Path) -> None:
    rows = [
        SimpleNamespace(role="robot", instance_id=1, color_name="black", pixels={"a": 9}),
        SimpleNamespace(role="", instance_id=2, color_name="silver", pixels={"a": 90}),
    ]
    doubt = {"table": {"handles": [2], "reasons": ["color alone does not tell it"]}}
    for lasting, expected in (
        (True, SettledRole(handle=[2])),
        (False, SettledRole(color="silver", all=True)),
    ):
        text = inspection.roles_file(rows, [], lasting, doubt)  # type: ignore[arg-type]
        (tmp_path / NAME).write_text(text)
        assert "table" not in read(tmp_path)
        assert "# table is doubted: color alone does not tell it." in text
        assert "# manipulated: {" in text  # nobody took anything for it
        (tmp_path / NAME).write_text(text.replace("# table: ", "table: "))
        assert read(tmp_path)["table"] == expected
    (tmp_path / NAME).write_text(inspection.roles_file([], []))
    assert read(tmp_path) == {}


def test_the_page_outlines_roles(scene: Scene) -> None:
    roles = {"receiver": SettledRole(handle=BOX)}
    described, rows, seen = inspection.inspect(scene.episode, roles=roles)
    page = instances.page(seen, described, rows).decode()
    assert f"<b>receiver</b>: {BOX}, 100 % sure<br><span class=soft>{NAME}" in page
    assert page.count("<figure>") == len(scene.episode.views)


def test_roles_that_differ_between_episodes_are_said(scene: Scene) -> None:
    bare = replace(scene, roles={}, beliefs={})
    settled, _ = settle(bare, {"table": SettledRole(handle=TABLE)})
    table = role_facts.describe(settled)
    floor = {"table": {**table["table"], "longest_cm": 3 * table["table"]["longest_cm"]}}
    none = role_facts.describe(bare)
    assert role_facts.disagreement({"a": table, "b": table}) == []
    (missing,) = role_facts.disagreement({"a": table, "b": none})
    assert missing == "table: 1 of 2 episodes have none: b"
    (odd,) = role_facts.disagreement({"a": table, "b": floor, "c": table})
    assert "otherwise in 1 of 3 episodes: b" in odd
    groups = {"train": {"a": table, "b": none}, "val": {"c": table}}
    assert role_facts.disagreements(groups) == ["table: 1 of 2 episodes of train have none: b"]
