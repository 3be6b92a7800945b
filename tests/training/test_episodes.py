"""The dataset in a training loop: coherent draws, the same in any worker, what `augment` would write."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rolling import demonstration
from rpaug_adapters.rlbench import RLBench
from torch.utils.data import DataLoader

from rpaug import CameraView, Episode, Unsupported
from rpaug.core import memo
from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.training import AugmentedEpisodes

RECIPE = {
    "version": 1,
    "seed": 11,
    "copies": 2,
    "edits": [
        {"op": "recolor", "target": {"handle": 300}, "color": {"sample": "colosseum"}},
        {"op": "light_color"},
    ],
}


@pytest.fixture
def episodes(template: Path, tmp_path: Path) -> AugmentedEpisodes:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(RECIPE))
    return AugmentedEpisodes(template, path, frames="all")


def equal(one: dict, other: dict) -> bool:
    return one["edits"] == other["edits"] and all(
        torch.equal(image, other["cameras"][name][kind])
        for name, images in one["cameras"].items()
        for kind, image in images.items()
    )


def test_an_item_has_what_was_promised(episodes: AugmentedEpisodes) -> None:
    assert len(episodes) == 2
    item = episodes[0]
    assert item["instruction"] == "roll the ball"
    assert item["frames"].tolist() == list(range(8))
    front = item["cameras"]["front"]
    assert front["rgb"].shape == (8, 80, 96, 3)
    assert front["rgb"].dtype == torch.uint8
    assert front["depth"].dtype == torch.float32
    assert front["ids"].dtype == torch.int32
    assert front["cam_to_world"].shape == (8, 4, 4)


def test_epochs_draw_anew_and_come_back(episodes: AugmentedEpisodes) -> None:
    first = episodes[0]
    episodes.set_epoch(1)
    second = episodes[0]
    assert first["edits"] != second["edits"]
    assert not equal(first, second)
    episodes.set_epoch(0)
    assert equal(first, episodes[0])


def test_an_epoch_is_what_augment_writes(
    episodes: AugmentedEpisodes, template: Path, tmp_path: Path
) -> None:
    execute(Run(template, recipe.build(RECIPE), tmp_path / "out"))
    for epoch, number in ((0, 1), (1, 3)):
        episodes.set_epoch(epoch)
        item = episodes[1]
        written = RLBench().read(
            tmp_path / "out", f"roll_ball/all_variations/episodes/episode{number}"
        )
        for name, view in written.views.items():
            for t in range(written.length):
                assert np.array_equal(item["cameras"][name]["rgb"][t], view.rgb(t))


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_workers_give_the_same_items(episodes: AugmentedEpisodes, start: str) -> None:
    alone = [episodes[i] for i in range(2)]
    loader = DataLoader(episodes, batch_size=None, num_workers=2, multiprocessing_context=start)
    for one, other in zip(alone, loader, strict=True):
        assert equal(one, other)


def test_key_frames_and_cameras_can_be_chosen(template: Path, tmp_path: Path) -> None:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(RECIPE))
    item = AugmentedEpisodes(template, path, frames="key", cameras=["overhead"])[0]
    assert list(item["cameras"]) == ["overhead"]
    assert item["frames"][0] == 0
    assert len(item["frames"]) < 8
    picked = AugmentedEpisodes(template, path, frames=[5, 2])[0]
    assert picked["frames"].tolist() == [5, 2]


def test_gaussians_are_not_fitted_in_a_training_loop(template: Path, tmp_path: Path) -> None:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(RECIPE))
    with pytest.raises(Unsupported, match="tier"):
        AugmentedEpisodes(template, path, tier=3)


def test_writing_to_an_item_does_not_reach_the_next(episodes: AugmentedEpisodes) -> None:
    first = episodes[0]["cameras"]["front"]["K"]
    kept = first.clone()
    first *= 2
    assert torch.equal(episodes[0]["cameras"]["front"]["K"], kept)


def test_wrong_arguments_are_refused_at_once(template: Path, tmp_path: Path) -> None:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(RECIPE))
    with pytest.raises(Unsupported, match="alll"):
        AugmentedEpisodes(template, path, frames="alll")  # type: ignore[arg-type]
    with pytest.raises(Unsupported, match="list of names"):
        AugmentedEpisodes(template, path, cameras="front")
    with pytest.raises(Unsupported, match="frame numbers from 0"):
        AugmentedEpisodes(template, path, frames=[0, -1])


def without(instance_id: int, length: int = 6) -> Episode:
    """The demonstration, in which that handle is another one."""
    episode = demonstration(length)

    def other(view: CameraView) -> CameraView:
        ids = view.ids
        assert ids is not None
        return replace(view, ids=lambda t: np.where(ids(t) == instance_id, 399, ids(t)))

    return replace(episode, views={name: other(view) for name, view in episode.views.items()})


@pytest.mark.parametrize(
    "edits", [RECIPE["edits"][:1], [{**RECIPE["edits"][0], "probability": 0.5}]]
)  # type: ignore[index]
def test_what_augment_skips_comes_as_recorded_and_is_told(
    tmp_path: Path, edits: list[dict]
) -> None:
    folder, key = tmp_path / "in", "roll_ball/all_variations/episodes/episode{}"
    RLBench().write(demonstration(8), folder, key.format(0), dict)
    RLBench().write(without(300), folder, key.format(1), dict)
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps({**RECIPE, "edits": edits}))
    made = execute(Run(folder, recipe.load(path), tmp_path / "out"))
    assert list(made.failures) == [key.format(1)]

    episodes = AugmentedEpisodes(folder, path, frames="all")
    for epoch in range(3):
        episodes.set_epoch(epoch)
        assert episodes[0]["skipped"] == ""
        with pytest.warns(UserWarning, match=r"episode1 comes as recorded: .*no such instance 300"):
            item = episodes[1]
        assert item["skipped"] in made.failures[key.format(1)]
        assert item["edits"] == []
        recorded = RLBench().read(folder, key.format(1))
        for name, view in recorded.views.items():
            assert all(
                np.array_equal(item["cameras"][name]["rgb"][t], view.rgb(t)) for t in range(6)
            )


def test_an_epoch_asks_no_more_of_what_is_remembered_than_the_one_before(
    episodes: AugmentedEpisodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared, same = [], memo._same

    def counted(one: object, other: object) -> bool:
        compared.append(one)
        return same(one, other)

    def of(epoch: int) -> int:
        compared.clear()
        episodes.set_epoch(epoch)
        assert not episodes[0]["skipped"]
        return len(compared)

    monkeypatch.setattr(memo, "_same", counted)
    early = [of(epoch) for epoch in range(6)][-1]
    late = [of(epoch) for epoch in range(6, 26)][-1]
    assert 0 < late <= early + 20
