"""What was spoilt in an output since it was written is made again by `--resume`, to the same bytes, in every layout."""

import json
from collections.abc import Callable
from pathlib import Path

import droid_samples
import lerobot_samples
import pytest
import rlds_samples
import sim_samples
import videos
from runs import augment, contents

from rpaug.core.errors import BadInput
from rpaug.core.registry import adapter_for
from rpaug.pipeline import card, journal, output_folder, recipe, report
from rpaug.pipeline.run import Run

WANTED = recipe.build({"version": 1, "copies": 2, "edits": [{"op": "sensor_noise"}]})


def robomimic(folder: Path) -> None:
    folder.mkdir()
    sim_samples.robomimic(folder / "demo.hdf5", demos=3)


def maniskill(folder: Path) -> None:
    folder.mkdir()
    sim_samples.maniskill(folder / "traj.h5", demos=3)


def filmed(folder: Path) -> None:
    folder.mkdir()
    videos.write(folder / "one.mp4", 6)
    videos.write(folder / "two.mp4", 7)


def droid(folder: Path) -> None:
    folder.mkdir()
    droid_samples.droid(folder)


MADE: dict[str, Callable[[Path], object]] = {
    "rlds": rlds_samples.dataset,
    "lerobot": lerobot_samples.dataset,
    "robomimic": robomimic,
    "maniskill": maniskill,
    "video": filmed,
    "droid": droid,
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Path]]:
    """A small dataset of a layout, and a finished run over it; each made once."""
    made: dict[str, tuple[Path, Path]] = {}

    def give(kind: str) -> tuple[Path, Path]:
        if kind not in made:
            folder = tmp_path_factory.mktemp(kind)
            source, out = folder / "in", folder / "out"
            MADE[kind](source)
            assert augment(source, WANTED, out).exit_code == 0
            made[kind] = source, out
        return made[kind]

    return give


def reports(out: Path) -> list[Path]:
    return sorted(out.rglob(report.NAME), key=lambda path: (len(str(path)), path))


def shared(out: Path) -> list[str]:
    return [*journal.read(out).shared.get("", {})]


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


@pytest.mark.parametrize("spoil", [emptied, Path.unlink])
@pytest.mark.parametrize("kind", MADE)
def test_an_episode_whose_report_is_spoilt_is_made_again(
    kind: str, spoil: Callable[[Path], None], whole: Callable[[str], tuple[Path, Path]]
) -> None:
    source, out = whole(kind)
    before = contents(out)
    every = reports(out)
    spoil(every[1])
    again = augment(source, WANTED, out, resume=True)
    assert (again.exit_code, again.resumed, again.copies) == (0, len(every) - 1, len(every))
    assert differ(before, contents(out)) == []


def differ(one: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


@pytest.mark.parametrize(
    ("kind", "ending"),
    [
        ("rlds", "00001-of-00002"),
        ("lerobot", "file-000.parquet"),
        ("lerobot", "file-000.mp4"),
        ("lerobot", "tasks.parquet"),
        ("robomimic", ".hdf5"),
        ("maniskill", ".h5"),
        ("maniskill", ".json"),
        ("video", "video_2.mp4"),
    ],
)
@pytest.mark.parametrize("spoil", [emptied, cut, Path.unlink])
def test_what_lies_in_a_spoilt_file_is_made_again(
    kind: str, ending: str, spoil: Callable[[Path], None], whole: Callable[[str], tuple[Path, Path]]
) -> None:
    source, out = whole(kind)
    before, count = contents(out), len(reports(out))
    spoil(out / next(name for name in shared(out) if name.endswith(ending)))
    again = augment(source, WANTED, out, resume=True)
    assert (again.exit_code, again.copies) == (0, count)
    assert differ(before, contents(out)) == []


@pytest.mark.parametrize(
    ("kind", "name"), [("rlds", "features.json"), ("lerobot", "info.json"), ("droid", "aggregated")]
)
def test_a_spoilt_file_that_nothing_makes_again_is_named(
    kind: str, name: str, whole: Callable[[str], tuple[Path, Path]]
) -> None:
    source, out = whole(kind)
    path = next(out / one for one in shared(out) if name in one)
    held = path.read_bytes()
    before = contents(out)
    for spoil in (emptied, Path.unlink):
        spoil(path)
        with pytest.raises(BadInput, match=name):
            augment(source, WANTED, out, resume=True)
        path.write_bytes(held)
        assert differ(before, contents(out)) == []


def test_the_summary_and_the_card_are_made_again(
    whole: Callable[[str], tuple[Path, Path]],
) -> None:
    source, out = whole("robomimic")
    summary = json.loads((out / report.SUMMARY).read_bytes())
    text = (out / card.NAME).read_text()
    emptied(out / report.SUMMARY)
    (out / card.NAME).unlink()
    augment(source, WANTED, out, resume=True)
    again = json.loads((out / report.SUMMARY).read_bytes())
    assert {**again, "resumed": 0} == {**summary, "resumed": 0}
    assert (out / card.NAME).read_text() == text


@pytest.mark.parametrize("kind", ["rlds", "lerobot", "robomimic", "video"])
def test_a_finished_output_is_not_written_again(
    kind: str, whole: Callable[[str], tuple[Path, Path]]
) -> None:
    source, out = whole(kind)
    kept = [out / name for name in shared(out)]
    before = {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in kept}
    assert augment(source, WANTED, out, resume=True).resumed == len(reports(out))
    assert before == {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in kept}


def test_an_episode_of_no_run_is_named_and_left_alone(
    whole: Callable[[str], tuple[Path, Path]],
) -> None:
    source, out = whole("video")
    videos.write(out / "mine.mp4", 4)
    with pytest.raises(BadInput, match=r"mine.*one of no run of rpaug"):
        augment(source, WANTED, out, resume=True)
    assert (out / "mine.mp4").stat().st_size
    (out / "mine.mp4").unlink()


def test_the_journal_says_what_every_folder_held(
    whole: Callable[[str], tuple[Path, Path]],
) -> None:
    source, out = whole("lerobot")
    held = journal.read(out)
    run = Run(source, WANTED, out)
    assert [key for key, _ in held.made.of("")] == list(adapter_for(source).episodes(out))
    assert [*output_folder.mend(run).made.of("")] == [*held.made.of("")]
