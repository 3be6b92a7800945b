"""Parts of a run, put together, are the output that one run writes: the same bytes, however many parts there were."""

import shutil
from collections.abc import Callable
from pathlib import Path

import droid_samples
import lerobot_samples
import pytest
import rlds_samples
import sim_samples
import videos
from runs import GROUP, augment, contents

from rpaug.core.errors import BadInput
from rpaug.pipeline import journal, merge, recipe, report
from rpaug.pipeline.augment import execute
from rpaug.pipeline.run import Run

NOISE = {"op": "sensor_noise"}
WANTED = recipe.build({"version": 1, "copies": 2, "keep_originals": True, "edits": [NOISE]})


def rlbench(folder: Path, template: Path) -> None:
    for number in range(5):
        shutil.copytree(
            template / GROUP / f"episode{number % 2}", folder / GROUP / f"episode{number}"
        )


MADE: dict[str, Callable[[Path], object]] = {
    "rlds": rlds_samples.dataset,
    "lerobot": lerobot_samples.dataset,
    "robomimic": lambda folder: sim_samples.robomimic(folder / "lift.hdf5", demos=3),
    "video": lambda folder: [videos.write(folder / f"{n}.mp4", 4 + n) for n in range(3)],
    "droid": droid_samples.droid,
}


def parts(source: Path, folder: Path, of: int, wanted: recipe.Recipe = WANTED) -> list[Path]:
    outs = [folder / f"part{number}" for number in range(1, of + 1)]
    for number, out in enumerate(outs, 1):
        execute(Run(source, wanted, out, shard=(number, of)))
    return outs


@pytest.mark.parametrize("of", [1, 2, 7])
@pytest.mark.parametrize("kind", ["rlbench", *MADE])
def test_any_number_of_parts_comes_to_the_same_bytes(
    kind: str, of: int, template: Path, tmp_path: Path
) -> None:
    source = tmp_path / "in"
    rlbench(source, template) if kind == "rlbench" else MADE[kind](source)
    whole = augment(source, WANTED, tmp_path / "whole")
    _, summary = merge.merge(tmp_path / "out", parts(source, tmp_path, of))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert (summary.copies, summary.failures) == (whole.copies, {})
    assert summary.changed_share == whole.changed_share
    again = augment(source, WANTED, tmp_path / "out", resume=True)
    assert again.resumed == summary.copies


def test_failures_and_rejected_copies_are_those_of_one_run(dataset: Path, tmp_path: Path) -> None:
    source = tmp_path / "in"
    rlbench(source, dataset)
    image = source / GROUP / "episode2/front_rgb/2.png"
    image.write_bytes(image.read_bytes()[:-9])
    moving = {"op": "camera_pose", "camera": "front", "shift": 0.1, "turn": 0.05}
    wanted = recipe.build(
        {"version": 1, "copies": 3, "edits": [moving], "gates": {"tries": 1, "holes": 0.1}}
    )
    whole = augment(source, wanted, tmp_path / "whole")
    assert whole.rejected
    assert whole.copies
    _, summary = merge.merge(tmp_path / "out", parts(source, tmp_path, 3, wanted))
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert (summary.failures, summary.rejected) == (whole.failures, whole.rejected)
    assert summary.exit_code == 1


def test_a_part_that_is_stopped_goes_on_under_the_same_numbers(
    template: Path, tmp_path: Path
) -> None:
    rlbench(tmp_path / "in", template)
    outs = parts(tmp_path / "in", tmp_path, 2)
    lost = next(iter(journal.read(outs[0]).made.of("")))[0]
    before = contents(outs[0])
    shutil.rmtree(outs[0] / lost)
    execute(Run(tmp_path / "in", WANTED, outs[0], shard=(1, 2)), resume=True)
    assert contents(outs[0]) == before
    with pytest.raises(BadInput, match="another shard"):
        execute(Run(tmp_path / "in", WANTED, outs[0], shard=(2, 2)), resume=True)


def test_a_merge_that_was_stopped_goes_on(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rlbench(tmp_path / "in", template)
    augment(tmp_path / "in", WANTED, tmp_path / "whole")
    outs, append = parts(tmp_path / "in", tmp_path, 2), journal.append
    noted = []

    def stopping(target: Path, lines: list[dict], durable: bool = True) -> None:
        if "made" in lines[0]:
            noted.append(target)
        if len(noted) == 5:
            raise KeyboardInterrupt
        append(target, lines, durable)

    monkeypatch.setattr(journal, "append", stopping)
    with pytest.raises(KeyboardInterrupt):
        merge.merge(tmp_path / "out", outs)
    monkeypatch.setattr(journal, "append", append)
    merge.merge(tmp_path / "out", outs)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_what_is_no_whole_set_of_parts_is_refused(template: Path, tmp_path: Path) -> None:
    rlbench(tmp_path / "in", template)
    outs = parts(tmp_path / "in", tmp_path, 3)
    with pytest.raises(BadInput, match=r"copy 0 in none of the parts 1, 3; expected all parts"):
        merge.merge(tmp_path / "out", [outs[0], outs[2]])
    assert not (tmp_path / "out").exists()
    other = recipe.build({**WANTED.source, "seed": 4})
    execute(Run(tmp_path / "in", other, tmp_path / "other", shard=(2, 3)))
    with pytest.raises(BadInput, match="another recipe"):
        merge.merge(tmp_path / "out", [outs[0], tmp_path / "other", outs[2]])
    augment(tmp_path / "in", WANTED, tmp_path / "whole")
    with pytest.raises(BadInput, match="no part of a run"):
        merge.merge(tmp_path / "out", [tmp_path / "whole"])
    (outs[1] / report.SUMMARY).unlink()
    with pytest.raises(BadInput, match="came to its end"):
        merge.merge(tmp_path / "out", outs)
    assert not (tmp_path / "out").exists()
