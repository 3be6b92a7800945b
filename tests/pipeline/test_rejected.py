"""Copies that fail their gates: drawn again, then kept apart, the same however the run goes."""

import json
from pathlib import Path

import pytest
from rpaug_adapters.rlbench import RLBench
from runs import augment, contents

from rpaug.core import registry
from rpaug.core.files import REJECTED
from rpaug.pipeline import copies, job, journal, recipe, report, write
from rpaug.pipeline.convert import convert
from rpaug.pipeline.made import MadeEpisodes
from rpaug.pipeline.missing_copies import MissingCopies
from rpaug.pipeline.run import Run
from rpaug.scene.build import build

MOVING = {"op": "camera_pose", "camera": "front", "shift": 0.15, "turn": 0.05}
LIMIT = 0.1  # of holes: some draws keep it, others do not


def gated(**limits: object) -> recipe.Recipe:
    return recipe.build(
        {
            "version": 1,
            "seed": 5,
            "copies": 3,
            "edits": [MOVING],
            "gates": {"tries": 2, **limits},
        }
    )


def reports(root: Path) -> dict[str, dict]:
    if not root.is_dir():
        return {}
    return {
        key: json.loads((root / key / report.NAME).read_bytes()) for key in RLBench().episodes(root)
    }


@pytest.fixture(scope="module")
def run(template: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of which some copies were kept at once, some drawn again, and some rejected."""
    out = tmp_path_factory.mktemp("gated") / "out"
    summary = augment(template, gated(holes=LIMIT), out)
    kept, rejected = reports(out), reports(out / REJECTED)
    assert summary.exit_code == 1
    assert len(kept) + len(rejected) == 6
    assert summary.copies == len(kept)
    assert summary.rejected.keys() == rejected.keys()
    assert all("holes" in reason for reason in summary.rejected.values())
    return out


def test_what_is_drawn_again_is_how_and_not_whether(template: Path) -> None:
    """Else an edit that often fails its gates would be done less often than its probability says."""
    light = {"op": "light_color", "range": [[0.1] * 3, [0.5] * 3], "probability": 0.5}
    asked = recipe.build({"version": 1, "edits": [light, light, light]})
    key = RLBench().episodes(template)[0]
    scene = build(RLBench().read(template, key), with_bodies=False)
    seen = set()
    for copy in range(6):
        tries = [copies.draw(scene, asked, copy, attempt)[1] for attempt in range(4)]
        whether = {tuple(one.option is not None for one in draws) for draws in tries}
        assert len(whether) == 1
        seen |= whether
        if any(whether.copy().pop()):
            assert len({str(draws) for draws in tries}) == 4
    assert len(seen) > 1


def test_what_is_kept_keeps_the_limits_and_what_is_rejected_does_not(run: Path) -> None:
    kept, rejected = reports(run), reports(run / REJECTED)
    assert rejected
    assert {one["gates"]["attempt"] for one in kept.values()} == {0, 1}
    for one in kept.values():
        assert one["gates"]["passed"]
        assert one["gates"]["figures"]["holes"] <= LIMIT
    for one in rejected.values():
        assert one["gates"]["attempt"] == 1
        assert one["gates"]["figures"]["holes"] > LIMIT
    numbers = sorted(int(key.rsplit("episode", 1)[1]) for key in kept)
    assert numbers == list(range(len(kept)))


def test_workers_make_the_same_bytes(template: Path, run: Path, tmp_path: Path) -> None:
    augment(template, gated(holes=LIMIT), tmp_path / "two", workers=2)
    assert contents(tmp_path / "two") == contents(run)


def test_a_stopped_run_is_resumed_to_the_same_bytes(
    template: Path, run: Path, tmp_path: Path
) -> None:
    """Killed before its last copies, a run has gaps in its numbers: where rejected copies were, and at the end."""
    out = tmp_path / "out"
    wanted = gated(holes=LIMIT)
    job_order = []

    journal.begin(out, Run(template, wanted, out).marker, template)
    planned = [*MissingCopies(Run(template, wanted, out), MadeEpisodes())]
    for one in planned[:1]:
        job_order += list(job.augment(one))
    augment(template, wanted, out, resume=True)
    assert contents(out) == contents(run)


def test_a_report_replays_a_rejected_copy_exactly(
    template: Path, run: Path, tmp_path: Path
) -> None:
    for root in (run, run / REJECTED):
        key, described = next(iter(reports(root).items()))
        target = tmp_path / root.name
        write.replay(RLBench(), template, described, target, key)
        assert contents(target / key) == contents(root / key)


def test_if_every_copy_is_rejected_the_exit_code_still_says_one(
    template: Path, tmp_path: Path
) -> None:
    summary = augment(template, gated(holes=0.0), tmp_path / "out")
    assert (summary.exit_code, summary.copies, len(summary.rejected)) == (1, 0, 6)
    assert not RLBench().episodes(tmp_path / "out")
    assert len(RLBench().episodes(tmp_path / "out" / REJECTED)) == 6


def test_a_draw_that_failed_is_not_tried_again(template: Path, tmp_path: Path) -> None:
    red = {"op": "recolor", "target": {"handle": 300}, "color": {"rgb": [0.3, 0.5, 0.7]}}
    wanted = recipe.build({"version": 1, "edits": [red], "gates": {"tries": 100, "color": 0.0}})
    augment(template, wanted, tmp_path / "out")
    assert {one["gates"]["attempt"] for one in reports(tmp_path / "out" / REJECTED).values()} == {0}


@pytest.mark.parametrize("layout", ["rlds", "lerobot", "rdt"])
def test_rejected_copies_after_kept_ones_end_no_run(
    layout: str, template: Path, tmp_path: Path
) -> None:
    """Of layouts that gather episodes: each copy keeps its own report, whatever number it gets at the end."""
    convert(template, tmp_path / "in", layout, fps=20)
    wanted = recipe.build({**gated(holes=LIMIT, tries=1).source, "copies": 2})
    out = tmp_path / "out"
    summary = augment(tmp_path / "in", wanted, out)
    assert summary.exit_code == 1
    assert summary.copies
    assert summary.rejected
    adapter = registry.adapter(layout)
    kept, rejected = adapter.episodes(out), adapter.episodes(out / REJECTED)
    assert (len(kept), len(rejected)) == (summary.copies, len(summary.rejected))
    for root, keys in ((out, kept), (out / REJECTED, rejected)):
        for key in keys:
            described = report.of(root / key)
            assert described is not None
            assert described["gates"]["passed"] == (root == out)
            wanted_length = adapter.read(tmp_path / "in", described["source"]).length
            assert adapter.read(root, key).length == wanted_length
    again = augment(tmp_path / "in", wanted, out, resume=True)
    assert (again.resumed, again.copies) == (4, summary.copies)


def test_originals_are_not_judged(template: Path, tmp_path: Path) -> None:
    wanted = recipe.build({**gated(holes=0.0).source, "keep_originals": True, "copies": 1})
    summary = augment(template, wanted, tmp_path / "out")
    assert (summary.copies, len(summary.rejected)) == (2, 2)
    assert all("gates" not in one for one in reports(tmp_path / "out").values())
