"""A recipe is right if it does all that was wanted, to those things, in that share of copies, and nothing else."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from analytic import BOX, scene

from rpaug.language.asking import AskResult
from rpaug.language.rounds import History
from tools.bench import wishes

RED = {"op": "recolor", "target": {"handle": BOX}, "color": "red"}
DIM = {"op": "light_color", "range": [[0.2, 0.2, 0.2], [0.2, 0.2, 0.2]]}
WANT_RED = {"op": "recolor", "on": [BOX], "color": "red|maroon"}


def judged(edits: list[Any], want: Any, *notes: str, **settings: Any) -> str:
    recipe = {"version": 1, "seed": 0, "copies": 1, "edits": edits} | settings
    result = AskResult(recipe, notes, (), History())
    return wishes.verdict(result, scene({"front": (1.6, 0.3, 1.0)}, length=2), want)


@pytest.mark.parametrize(
    ("edits", "want"),
    [
        ([RED], [[WANT_RED]]),
        ([RED], ["refuse", [WANT_RED]]),
        ([{**RED, "probability": 0.4}], [[WANT_RED | {"p": [0.38, 0.42]}]]),
        ([RED, DIM], [[WANT_RED, {"op": "light_color", "bright": [0.35, 0.45]}]]),
        ([RED], [[WANT_RED, {"op": "light_color", "optional": True}]]),
        (
            [{"one_of": [RED, {**RED, "color": "blue", "weight": 3}]}],
            [[WANT_RED | {"p": [0.2, 0.3]}, WANT_RED | {"color": "blue", "p": [0.7, 0.8]}]],
        ),
        (
            [{"one_of": [RED, {**RED, "color": "blue"}]}],
            [[WANT_RED | {"color": "red|blue", "each": ["red", "blue"]}]],
        ),
        (
            [{"op": "object_size", "target": {"handle": BOX}, "range": [0.8, 0.9]}],
            [[{"op": "object_size", "on": [BOX], "spans": {"range": [0.8, 0.9]}}]],
        ),
        (
            [{"op": "light_direction", "to": [0, 1, 1]}],
            [[{"op": "light_direction", "lamp": [[0, 1, 0]]}]],
        ),
    ],
)
def test_what_was_wanted_is_right(edits: list[Any], want: Any) -> None:
    assert judged(edits, want) == "right"


@pytest.mark.parametrize(
    ("edits", "want"),
    [
        ([RED], ["refuse"]),
        ([{**RED, "color": "blue"}], [[WANT_RED]]),
        ([RED, DIM], [[WANT_RED]]),
        ([DIM], [[WANT_RED, {"op": "light_color"}]]),
        ([RED], [[WANT_RED | {"on": [BOX, 99]}]]),
        ([RED], [[WANT_RED | {"on": [99]}]]),
        ([{**RED, "probability": 0.4}], [[WANT_RED]]),
        ([RED], [[WANT_RED | {"each": ["red", "blue"]}]]),
        ([RED], [[WANT_RED, {"settings": {"copies": 4}}]]),
        ([RED], [[WANT_RED, {"settings": {}, "notes": True}]]),
        ([{"op": "light_direction"}], [[{"op": "light_direction", "lamp": [[0, 1, 0]]}]]),
        (
            [{"op": "camera_pose", "camera": "front", "shift": 0.1}],
            [[{"op": "camera_pose", "cameras": ["front"], "within": {"shift": [0, 0.05]}}]],
        ),
    ],
)
def test_anything_else_is_wrong(edits: list[Any], want: Any) -> None:
    assert judged(edits, want) == "wrong"


def test_a_refusal_is_right_where_it_was_due() -> None:
    here = scene({"front": (1.6, 0.3, 1.0)}, length=2)
    assert wishes.verdict(None, here, ["refuse"]) == "right"
    assert wishes.verdict(None, here, [[WANT_RED]]) == "refused"
    assert wishes.verdict(None, here, None) == "person"


def test_every_wish_says_what_is_wanted() -> None:
    file = Path(wishes.__file__).with_suffix("") / "worked.jsonl"
    for line in file.read_text().splitlines():
        row = json.loads(line)
        assert list(row) == ["scene", "after", "wish", "expect", "want"]
        for way in row["want"] or ():
            assert way == "refuse" or all("op" in one or "settings" in one for one in way)


def test_a_model_is_asked_without_what_is_judged_by(monkeypatch: pytest.MonkeyPatch) -> None:
    here = scene({"front": (1.6, 0.3, 1.0)}, length=2)
    episode = SimpleNamespace(views={"front": None}, descriptions=("push the box",))
    monkeypatch.setattr(wishes, "recorded", lambda path: (episode, here))
    row = {"scene": "box", "after": "a red box", "wish": "blue", "expect": "azure", "want": [[]]}
    first = json.loads(wishes.question(row, Path(), [])[-1]["content"])
    edit = {"said": "red", "probability": None, "options": [RED]}
    answer = wishes.REFUSED | {"refuse": "", "edits": [edit]}
    second = json.loads(wishes.question(row, Path(), [answer])[-1]["content"])
    assert (first["wish"], first["said"]) == ("a red box", [])
    assert (second["wish"], second["said"], second["earlier"]) == ("blue", ["a red box"], [RED])
    assert "azure" not in json.dumps([first, second])


def test_a_sample_goes_by_words_not_by_their_order() -> None:
    rows = [{"scene": "box", "wish": str(number)} for number in range(9)]
    taken = {rows[n]["wish"] for n in wishes.sample(rows, 4)}
    assert len(taken) == 4
    assert taken == {rows[::-1][n]["wish"] for n in wishes.sample(rows[::-1], 4)}
