"""`--share` and `--tier 4`, the whole way: the same episodes in any order, and again from their reports."""

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from quick_fits import QUICK, quick_worker
from rolling import demonstration
from rpaug_adapters.rlbench import RLBench
from runs import GROUP, contents

from rpaug.gaussians import cached, store
from rpaug.pipeline import job, prepare, recipe, report, write
from rpaug.pipeline import workers as local
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.run import Budget

RECIPE = {
    "version": 1,
    "copies": 1,
    "edits": [{"op": "recolor", "target": {"handle": 300}, "color": "blue"}],
}
FIRST, SECOND = f"{GROUP}/episode0", f"{GROUP}/episode1"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits of a few steps: what is asked for here does not hang on how good they are."""
    for name, fit in QUICK.items():
        monkeypatch.setattr(cached, name, fit)
    monkeypatch.setattr(local, "_serve", quick_worker)


def run(
    source: Path, target: Path, scenes: Path, tier: int = 3, workers: int = 1, **changes: Any
) -> Path:
    wanted = recipe.build(RECIPE | changes)
    done = execute(Run(source, wanted, target, tier, scenes, share=True), workers=workers)
    assert not done.failures, done.failures
    return target


def test_the_first_of_a_place_lends_whatever_is_selected(template: Path) -> None:
    adapter = RLBench()
    assert prepare.donors(adapter, template, [FIRST, SECOND]) == {SECOND: FIRST}
    assert prepare.donors(adapter, template, [SECOND]) == {SECOND: FIRST}
    assert prepare.donors(adapter, template, [FIRST]) == {}


def test_no_order_of_fitting_changes_anything(template: Path, tmp_path: Path) -> None:
    both = run(template, tmp_path / "both", tmp_path / "one")
    # The second episode alone, first, into a store of its own; then all.
    alone = run(template, tmp_path / "alone", tmp_path / "two", select={"episodes": ["*episode1"]})
    later = run(template, tmp_path / "later", tmp_path / "two")
    assert contents(both / GROUP) == contents(later / GROUP)
    images = {
        name.split("/", 1)[1]: data
        for name, data in contents(both / GROUP).items()
        if name.startswith("episode1/") and name.endswith(".png")
    }
    for name, data in contents(alone / GROUP / "episode0").items():
        if name.endswith(".png"):
            assert data == images[name], name
    described = json.loads((both / SECOND / report.NAME).read_bytes())
    assert described["plan"]["fit"]["founder"] == FIRST
    assert described["plan"]["fit"]["borrowed"] > 500
    assert store.names(tmp_path / "one") == store.names(tmp_path / "two")
    # And from the report alone, without a store.
    write.replay(RLBench(), template, described, tmp_path / "again", SECOND)
    assert contents(both / SECOND) == contents(tmp_path / "again" / SECOND)


def test_any_number_of_workers_and_any_order_of_jobs_give_the_same(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Path(shutil.copytree(template, tmp_path / "source"))
    RLBench().write(demonstration(5), source, f"{GROUP}/episode2", dict)
    one = run(source, tmp_path / "one", tmp_path / "alone")
    in_turn = local.run

    def backwards(
        jobs: Sequence[job.Job], workers: int, budget: Budget | None
    ) -> Iterator[local.Outcome]:
        return in_turn(jobs[::-1], workers, budget)

    monkeypatch.setattr(local, "run", backwards)
    two = run(source, tmp_path / "two", tmp_path / "together", workers=2)
    found = contents(one / GROUP)
    described = [json.loads(data) for name, data in found.items() if name.endswith(report.NAME)]
    assert [d["plan"]["fit"].get("founder") for d in described] == [None, FIRST, FIRST]
    assert found == contents(two / GROUP)
    assert arrays(tmp_path / "alone") == arrays(tmp_path / "together")


def arrays(scenes: Path) -> dict[str, bytes]:
    """What a store holds but for each scene's own facts, which tell seconds."""
    kept = contents(scenes)
    return {name: data for name, data in kept.items() if not name.endswith(".zarr/zarr.json")}


def test_what_cannot_be_read_lends_nothing(template: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(template, broken)
    (broken / FIRST / "low_dim_obs.pkl").write_bytes(b"")
    assert prepare.donors(RLBench(), broken, [SECOND]) == {}


def test_the_fourth_tier_end_to_end(template: Path, tmp_path: Path) -> None:
    """The ball is told to be one that bends by its masks alone; a second run finds all of it in the store."""
    scenes = tmp_path / "scenes"
    one = run(template, tmp_path / "one", scenes, tier=4)
    kept = store.names(scenes)
    two = run(template, tmp_path / "two", scenes, tier=4)
    assert store.names(scenes) == kept
    assert contents(one / GROUP) == contents(two / GROUP)
    described = json.loads((one / SECOND / report.NAME).read_bytes())
    assert set(described["plan"]["carriers"].values()) == {"tier 4, Gaussians in space and time"}
    four = described["plan"]["fit"]["four"]
    assert four["frames"] > 1
    assert four["handles"] or four["reason"]
    before, after = (RLBench().read(root, SECOND).views["front"] for root in (template, one))
    assert before.ids is not None
    ball = before.ids(3) == 300
    assert (np.abs(after.rgb(3).astype(int) - before.rgb(3)).max(-1)[ball] > 30).mean() > 0.5
