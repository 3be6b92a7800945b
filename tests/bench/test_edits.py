"""The bench on small recordings: truths score as truths, rows add up, what it writes can be read."""

import csv
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from rpaug import RpaugError, twin
from rpaug.core import geometry, registry
from rpaug.core.errors import Unsupported
from rpaug.twin.factors import FACTORS
from tools.bench.edits import app
from tools.bench.harness import edits, scores, truths
from tools.bench.harness.cases import CASES, ESTIMATED, TOLD

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def pair() -> tuple[twin.Take, twin.Take]:
    record = {"frames": 17, "size": 48}
    return (
        twin.perform("stack_cups", 1, **record),
        twin.perform("stack_cups", 1, factor="object_color", **record),
    )


def test_the_truth_itself_has_no_error(pair):
    recorded, true = pair
    found = scores.measure(recorded, true.episode, true, {}, False, 1.0)
    assert found.psnr > 88
    assert (found.ssim, found.iou) == pytest.approx((1, 1))
    for name in ("ciede2000", "depth", "depth_far", "outside", "flicker", "holes"):
        assert getattr(found, name) == 0, name
    assert found.reprojection < 0.2  # curved rims of cups, at 48 pixels


def test_what_is_changed_elsewhere_is_counted(pair):
    recorded, true = pair
    view = true.episode.views["front"]
    spoiled = replace(
        view, rgb=lambda t: np.where(np.arange(48)[:, None, None] < 2, 0, view.rgb(t))
    )
    views = {**true.episode.views, "front": spoiled}
    found = scores.measure(recorded, replace(true.episode, views=views), true, {}, False, 1.0)
    assert found.psnr > 88
    assert found.outside == 17 * 2 * 48


def test_moved_cameras_count_whole_and_the_others_not_at_all(pair):
    recorded, _ = pair
    true = twin.perform("stack_cups", 1, frames=17, size=48, factor="camera_pose")
    for name, _, inside, reach in scores.regions(recorded, true, False):
        assert inside.all() == (name in true.truth.bumps)
        assert inside.any() == reach.any()
    holes = {"front/0": np.eye(48, dtype=bool)}
    found = scores.measure(recorded, true.episode, true, holes, False, 1.0)
    assert found.holes == pytest.approx(48 / (3 * 17 * 48 * 48))


def test_every_factor_of_the_twin_has_a_case():
    assert {name for name, case in CASES.items() if not case.truth} <= set(FACTORS)


def test_a_doubled_thing_stands_in_both_places_and_nothing_else_changes(pair):
    recorded, _ = pair
    old, new = recorded.truth.handles[truths.CYLINDER], 999
    look = replace(recorded.truth.new, shifts={truths.CYLINDER: (0.1, 0.0, 0.0)})
    moved = truths.again(recorded, look)
    true = truths.doubled(recorded, moved, old, new)
    assert true.truth.changed == (new,)
    copied = 0
    for name, view in true.episode.views.items():
        before, there = recorded.episode.views[name], moved.episode.views[name]
        for t in range(0, true.episode.length, 8):
            copy = view.ids(t) == new
            copied += copy.sum()
            assert (there.ids(t)[copy] == old).all()
            assert np.array_equal(view.rgb(t)[copy], there.rgb(t)[copy])
            assert (view.depth(t)[copy] < before.depth(t)[copy]).all()
            assert np.array_equal(view.rgb(t)[~copy], before.rgb(t)[~copy])
            assert np.array_equal(view.ids(t)[~copy], before.ids(t)[~copy])
    assert copied > 50


def test_the_copys_shadow_is_not_made_up(pair):
    recorded, moved = pair
    lit = replace(recorded.truth, new=replace(recorded.truth.new, shadows=True))
    with pytest.raises(Unsupported, match="shadow"):
        truths.doubled(replace(recorded, truth=lit), moved, 1, 2)


def test_fainter_shadows_lie_between_those_recorded_and_none():
    recorded = small(CASES["shadows_fainter"].lamps, None, 96, True)
    none = truths.again(recorded, replace(recorded.truth.new, shadows=False)).episode.views
    fainter = truths.fainter(recorded).episode.views
    darker = 0
    for name, view in recorded.episode.views.items():
        cast, lit, found = (one.rgb(3).astype(int) for one in (view, none[name], fainter[name]))
        shadow = (lit - cast).max(-1) > 20
        darker += shadow.sum()
        assert ((cast[shadow] < found[shadow]) & (found[shadow] < lit[shadow])).any(-1).all()
        assert np.abs(found - lit)[~shadow].max() <= 20
    assert darker > 500


@cache
def small(
    lamps: tuple[twin.TwinLamp, ...], factor: str | None, size: int = 16, shadows: bool = False
) -> twin.Take:
    look = twin.Look(lamps=lamps, shadows=shadows)
    return twin.perform("open_drawer", 1, frames=11, size=size, look=look, factor=factor)


def test_one_factor_on_the_edit_is_forgiven_where_it_says_so(pair):
    recorded, true = pair
    dim = {
        name: replace(view, rgb=lambda t, view=view: (view.rgb(t) * 0.8).round().astype(np.uint8))
        for name, view in true.episode.views.items()
    }
    found = scores.measure(recorded, replace(true.episode, views=dim), true, {}, False, 1.0)
    assert found.psnr < 30
    assert found.psnr_scaled > 50  # the rounding of both images


@pytest.mark.parametrize("factor", CASES)
def test_what_an_operator_is_asked_is_plain(factor, tmp_path):
    case = CASES[factor]
    side = (
        96 if factor == "object_place" or case.truth else 16
    )  # what things stand on has to be seen
    recorded = small(case.lamps, None, side, case.truth is not None and case.shadows)
    true = case.truth(recorded) if case.truth else small(case.lamps, factor, side)
    asks = case.ask(recorded, true, tmp_path)
    assert asks[0].method in (TOLD, ESTIMATED)
    for ask in asks:
        json.dumps([ask.steps, ask.edit])
    for known in (True, False):
        for old, new in (case.colors(recorded, true, known) if case.colors else {}).values():
            assert np.shape(old) == np.shape(new) == (3,)
    if true.truth.covers:
        fields = asks[0].steps[0]
        laid = true.truth.covers[true.truth.changed[0]]
        pose = geometry.rigid(np.array(fields["turn"]), np.array(fields["origin"]))
        np.testing.assert_allclose(pose, laid.body_to_world, atol=1e-12)
        assert (tmp_path / fields["texture"]).is_file()


def test_the_command_writes_what_it_measured(tmp_path):
    out = tmp_path / "bench"
    arguments = "--factor object_color --task push_button --seeds 2 --frames 13 --size 48"
    done = CliRunner().invoke(app, [*arguments.split(), "--plot", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "CIELAB in the mask" in done.stdout
    described = json.loads((out / "edits.json").read_text())
    given = described["summary"][0]
    assert (given["method"], given["seeds"], given["outside_worst"]) == (TOLD, 2, 0)
    assert given["psnr_worst"] <= given["psnr"]
    assert given["lead"] > 3
    names = {path.name for path in out.iterdir()}
    assert names == {"edits.csv", "edits.json", "edits.html", "edits.png", "edits-object_color.png"}
    rows = list(csv.DictReader((out / "edits.csv").read_text().splitlines()))
    assert len(rows) == 2 * 6
    assert {row["changed"] for row in rows} == {"button", "button_base"}
    assert described["rows"][0]["psnr"] == float(rows[0]["psnr"])


def test_factors_without_an_operator_are_named(monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "operator_names", lambda: [])
    setting = edits.EditSetting(factors=("light_color",), seeds=1)
    assert edits.missing(setting) == {"light_color": "no operator is called 'light_color'"}
    assert edits.run(setting) == []
    with pytest.raises(RpaugError, match="object_color, object_texture"):
        edits.EditSetting(factors=("gravity",))
    with pytest.raises(RpaugError, match="open_drawer, pick_block"):
        edits.EditSetting(tasks=("juggle",))
