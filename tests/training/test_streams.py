"""Windows of frames, and the stream that shuffles and shares them out."""

import json
from pathlib import Path

import pytest
import torch
from torch.utils.data import DataLoader

from rpaug import Unsupported
from rpaug.training import AugmentedEpisodes, AugmentedStream, Schedule, Windows

RECIPE = {
    "version": 1,
    "seed": 2,
    "edits": [{"op": "recolor", "target": {"handle": 300}, "color": {"sample": "colosseum"}}],
}


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(RECIPE))
    return path


def test_windows_are_frames_of_one_draw(template: Path, recipe: Path) -> None:
    runs = AugmentedEpisodes(template, recipe, frames=Windows(3, stride=2, step=2))
    whole = AugmentedEpisodes(template, recipe, frames="all")
    assert [run["frames"].tolist() for run in runs] == [[0, 2, 4], [2, 4, 6], [0, 2, 4]]
    for run, number in zip(runs, (0, 0, 1), strict=True):
        assert run["edits"] == whole[number]["edits"]
        every = whole[number]["cameras"]["front"]["rgb"]
        assert torch.equal(run["cameras"]["front"]["rgb"], every[run["frames"]])
        assert run["joint_positions"].shape[0] == 3


def test_a_window_longer_than_its_episode_repeats_the_last_frame(
    template: Path, recipe: Path
) -> None:
    runs = AugmentedEpisodes(template, recipe, frames=Windows(7))
    assert [run["frames"].tolist() for run in runs] == [
        [0, 1, 2, 3, 4, 5, 6],
        [1, 2, 3, 4, 5, 6, 7],
        [0, 1, 2, 3, 4, 5, 5],
    ]


def named(item: dict) -> tuple[str, int]:
    return item["key"], int(item["frames"][0])


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_a_stream_gives_each_item_once(template: Path, recipe: Path, workers: int) -> None:
    runs = AugmentedEpisodes(template, recipe, frames=Windows(2))
    stream = AugmentedStream(runs, mixed=2)
    loader = DataLoader(stream, batch_size=None, num_workers=workers)
    assert sorted(map(named, loader)) == sorted(map(named, runs))


def test_ranks_share_and_epochs_shuffle(template: Path, recipe: Path) -> None:
    runs = AugmentedEpisodes(template, recipe, frames=Windows(2))
    halves = [list(map(named, AugmentedStream(runs, rank=r, ranks=2))) for r in range(2)]
    assert sorted(halves[0] + halves[1]) == sorted(map(named, runs))
    orders = set()
    for epoch in range(3):
        runs.set_epoch(epoch)
        orders.add(tuple(map(named, AugmentedStream(runs, mixed=2))))
    assert len(orders) == 3
    with pytest.raises(Unsupported, match="rank"):
        AugmentedStream(runs, rank=2, ranks=2)


def test_an_epoch_may_leave_episodes_as_recorded(template: Path, recipe: Path) -> None:
    mixed = AugmentedEpisodes(template, recipe, frames="all", schedule=Schedule(ratio=(1, 1)))
    edits = []
    for epoch in range(6):
        mixed.set_epoch(epoch)
        edits.append(tuple(bool(mixed[i]["edits"]) for i in range(2)))
    assert all(sum(epoch) == 1 for epoch in edits)
    assert set(edits) == {(True, False), (False, True)}
