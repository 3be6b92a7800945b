"""What edits put in has in the masks the ids that the report says, though stray ids end their range."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic import TABLE
from rpaug_adapters.rlbench import RLBench
from runs import GROUP, augment

from rpaug.pipeline import recipe, report
from rpaug.pipeline import verify as verifying
from rpaug.pipeline.verify import Finding, verify
from rpaug.scene.build import build

VOID = 2**24 - 1
RECIPE = {"version": 1, "seed": 2, "edits": [{"op": "distractors", "count": 2}]}


def paint(folder: Path, kind: str, t: int, value: int) -> None:
    """Four pixels of one image, all channels alike."""
    path = folder / f"front_{kind}" / f"{t}.png"
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    image[:2, :2] = value
    cv2.imwrite(str(path), image)


@pytest.fixture(scope="module")
def strayed(template: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset with a few pixels of the void: at the end of the masks' range, black and as far as depth goes."""
    root = tmp_path_factory.mktemp("void") / "in"
    shutil.copytree(template / GROUP / "episode1", root / GROUP / "episode0")
    for kind, value in {"mask": 255, "rgb": 0, "depth": 255}.items():
        paint(root / GROUP / "episode0", kind, 5, value)
    return root


@pytest.fixture(scope="module")
def augmented(strayed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("added") / "out"
    assert augment(strayed, recipe.build(RECIPE), out).exit_code == 0
    return out


def bad(target: Path, source: Path) -> list[Finding]:
    return [finding for finding in verify(target, source).findings if finding.level == "bad"]


def test_masks_hold_what_the_report_says(strayed: Path, augmented: Path) -> None:
    given = report.of(augmented / GROUP / "episode0")
    assert given
    things = [thing["handle"] for thing in given["draws"][0]["edit"]["things"]]
    assert list(given["added"]) == [str(one) for one in things]
    made = RLBench().read(augmented, f"{GROUP}/episode0")
    for one, where in given["added"].items():
        assert int(one) < VOID
        for name, (t, pixels) in where.items():
            ids = made.views[name].ids
            assert ids
            assert (ids(t) == int(one)).sum() == pixels > 0
    assert any(given["added"].values())
    assert bad(augmented, strayed) == []


@pytest.mark.parametrize("spoilt", ["mask", "report"])
def test_verify_compares_report_and_masks(
    strayed: Path, augmented: Path, tmp_path: Path, spoilt: str
) -> None:
    out = Path(shutil.copytree(augmented, tmp_path / "out"))
    folder = out / GROUP / "episode0"
    if spoilt == "mask":
        paint(folder, "mask", 0, 77)
    else:
        given = report.of(folder)
        assert given
        given["added"] = {
            str(VOID + 1 + n): where for n, where in enumerate(given["added"].values())
        }
        (folder / report.NAME).write_text(json.dumps(given))
    found = bad(out, strayed)
    assert {one.topic for one in found} == {"instances"}
    assert any("neither recorded nor put in" in one.message for one in found)
    if spoilt == "report":
        assert any(f"0 pixels of {VOID + 1}" in one.message for one in found)


def test_a_stray_id_is_left_out_of_an_edit_and_the_edit_is_made(strayed: Path) -> None:
    scene = build(RLBench().read(strayed, f"{GROUP}/episode0"), with_bodies=True)
    target = {"handle": [TABLE, VOID]}
    asked = recipe.build(
        {"version": 1, "edits": [{"op": op, "target": target, **more} for op, more in PAINTS]}
    )
    for step in asked.steps:
        operator = step.options[0].operator
        edit = operator.sample(scene, np.random.default_rng(0))
        assert [one["handle"] for one in edit["surfaces"]] == [TABLE]
        assert "black" in edit["left_out"][str(VOID)]
        (laid,) = operator.apply(scene, json.loads(json.dumps(edit))).appearance
        assert laid.instance_ids == {TABLE}


PAINTS = [
    ("recolor", {"color": "blue"}),
    ("table_color", {}),
    ("background_texture", {"texture": "oak"}),
]


def test_only_where_there_are_masks_is_a_thing_that_none_shows_noted(strayed: Path) -> None:
    recorded = RLBench().read(strayed, f"{GROUP}/episode0")
    without = replace(
        recorded, views={name: replace(view, ids=None) for name, view in recorded.views.items()}
    )
    for episode, notes in ((recorded, 1), (without, 0)):
        found = verifying._instances("k", episode, episode, {"added": {"9": {}}}, [0])
        assert [one.level for one in found] == ["note"] * notes
