"""Datasets that people have, wrapped: what their samples show is edited, the rest is theirs."""

import json
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from rpaug_adapters.rlbench import RLBench
from torch.utils.data import DataLoader, IterableDataset

from rpaug import Unsupported
from rpaug.core import geometry
from rpaug.training import AugmentedEpisodes, Schedule, wrap

KEYS = [f"roll_ball/all_variations/episodes/episode{n}" for n in range(2)]
FRAMES = [(key, t) for key, length in zip(KEYS, (8, 6), strict=True) for t in range(length)]
PAINT = {"op": "recolor", "target": {"handle": 300}, "color": {"sample": "colosseum"}}
MOVE = {"op": "camera_pose", "camera": "front", "shift": 0.03}


def recipe_file(folder: Path, *edits: dict[str, Any]) -> Path:
    path = folder / "r.yaml"
    path.write_text(json.dumps({"version": 1, "seed": 5, "edits": list(edits)}))
    return path


class Theirs:
    """One frame a sample, as RVT's replay buffer gives it: channels first, colors in -1..1, points in the world."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def __len__(self) -> int:
        return len(FRAMES)

    def __getitem__(self, index: int) -> dict[str, Any]:
        key, t = FRAMES[index]
        view = RLBench().read(self.root, key).views["front"]
        assert view.depth is not None
        points = geometry.unproject(view.depth(t).astype(float), view.camera.K)
        points = geometry.transform(view.camera.cam_to_world[t], points)
        rgb = torch.from_numpy(view.rgb(t).transpose(2, 0, 1).astype(np.float32))
        return {
            "where": (key, t),
            "obs": {"front_rgb": rgb / 127.5 - 1},
            "front_point_cloud": torch.from_numpy(points.transpose(2, 0, 1).astype(np.float32)),
            "front_camera_extrinsics": view.camera.cam_to_world[t].astype(np.float32),
            "action": torch.arange(8) + index,
        }


def wrapped(root: Path, recipe: Path, theirs: Any = None, **more: Any) -> Any:
    given = {
        "front": {
            "rgb": "obs/front_rgb",
            "points": "front_point_cloud",
            "cam_to_world": "front_camera_extrinsics",
        }
    }
    return wrap(
        theirs or Theirs(root), root, recipe,
        episode=lambda sample: sample["where"][0], frame=lambda sample: sample["where"][1],
        cameras=more.pop("cameras", given), **more,
    )  # fmt: skip


@pytest.mark.parametrize("signs", [(1, 1, 1, 1), (-1, -1, 1, 1), (1, -1, -1, 1)])
def test_a_moved_camera_is_told_by_the_axes_the_sample_has(
    template: Path, tmp_path: Path, signs: tuple[int, ...]
) -> None:
    class Turned(Theirs):
        def __getitem__(self, index: int) -> dict[str, Any]:
            sample = super().__getitem__(index)
            key = "front_camera_extrinsics"
            return sample | {key: (sample[key] * signs).astype(np.float32)}

    recipe = recipe_file(tmp_path, MOVE)
    ours = wrapped(template, recipe, Turned(template))[3]
    key, t = FRAMES[3]
    camera = AugmentedEpisodes(template, recipe, frames="all")[KEYS.index(key)]["cameras"]["front"]
    moved = np.asarray(camera["cam_to_world"][t])
    assert not np.allclose(
        moved, RLBench().read(template, key).views["front"].camera.cam_to_world[t]
    )
    assert np.allclose(ours["front_camera_extrinsics"], moved * signs, atol=1e-6)


def test_a_sample_shows_what_the_episode_shows(template: Path, tmp_path: Path) -> None:
    recipe = recipe_file(tmp_path, PAINT, MOVE)
    ours, theirs = wrapped(template, recipe), Theirs(template)
    assert len(ours) == len(theirs)
    episodes = AugmentedEpisodes(template, recipe, frames="all")
    for epoch, index in ((0, 3), (2, 9)):
        ours.set_epoch(epoch)
        episodes.set_epoch(epoch)
        key, t = FRAMES[index]
        front = episodes[KEYS.index(key)]["cameras"]["front"]
        made, before = ours[index], theirs[index]
        wanted = front["rgb"][t].permute(2, 0, 1).float() / 127.5 - 1
        assert torch.allclose(made["obs"]["front_rgb"], wanted, atol=1e-6)
        same = wanted == before["obs"]["front_rgb"]
        assert torch.equal(made["obs"]["front_rgb"][same], before["obs"]["front_rgb"][same])
        assert not torch.equal(made["obs"]["front_rgb"], before["obs"]["front_rgb"])
        pose = front["cam_to_world"][t].numpy()
        assert np.allclose(made["front_camera_extrinsics"], pose, atol=1e-6)
        points = geometry.unproject(front["depth"][t].numpy().astype(float), front["K"].numpy())
        points = geometry.transform(pose, points).transpose(2, 0, 1)
        assert np.allclose(made["front_point_cloud"], points, atol=1e-5)
        assert torch.equal(made["action"], before["action"])
        assert made["obs"]["front_rgb"].dtype == torch.float32


def test_epochs_reach_workers_that_run(template: Path, tmp_path: Path) -> None:
    ours = Wrapped(template, recipe_file(tmp_path, PAINT))
    loader = DataLoader(
        ours,
        batch_size=None,
        num_workers=2,
        persistent_workers=True,
        multiprocessing_context="fork",
    )
    for epoch in range(2):
        ours.set_epoch(epoch)
        for index, image in enumerate(loader):
            assert torch.equal(image, ours[index])
            assert ours.inner.wrapper.epoch == epoch


class Wrapped:
    """The wrapped dataset's images alone, with functions that can be sent to a spawned process."""

    def __init__(self, root: Path, recipe: Path) -> None:
        self.inner = wrap(
            Theirs(root), root, recipe, episode=episode_of, frame=frame_of, cameras={"front": "obs/front_rgb"}
        )  # fmt: skip
        self.set_epoch = self.inner.set_epoch

    def __len__(self) -> int:
        return 4

    def __getitem__(self, index: int) -> torch.Tensor:
        return self.inner[3 * index]["obs"]["front_rgb"]


def test_what_a_spawned_worker_gets_holds_no_images(template: Path, tmp_path: Path) -> None:
    ours = Wrapped(template, recipe_file(tmp_path, PAINT)).inner
    image = ours[3]["obs"]["front_rgb"]
    sent = pickle.dumps(ours)
    assert len(sent) < 20_000
    assert torch.equal(pickle.loads(sent)[3]["obs"]["front_rgb"], image)  # noqa: S301  # our own


def episode_of(sample: dict[str, Any]) -> str:
    return sample["where"][0]


def frame_of(sample: dict[str, Any]) -> int:
    return sample["where"][1]


def test_stacked_bytes_of_half_the_size(template: Path, tmp_path: Path) -> None:
    """RDT-like: a history of images, channels last, as numpy bytes, made smaller; no picture for the other camera."""

    def small(t: int) -> np.ndarray:
        image = RLBench().read(template, KEYS[0]).views["overhead"].rgb(t)
        return cv2.resize(image, (48, 40), interpolation=cv2.INTER_AREA)

    sample = {
        "cam_high": np.stack([small(2), small(3)]),
        "cam_wrist": np.zeros((2, 0, 0, 3), np.uint8),
    }
    ours = wrap(
        [sample], template, recipe_file(tmp_path, PAINT), episode=lambda s: 0, frame=lambda s: [2, 3],
        cameras={"overhead": "cam_high", "front": "cam_wrist"},
    )  # fmt: skip
    made = ours[0]
    assert made["cam_high"].dtype == np.uint8
    assert made["cam_high"].shape == (2, 40, 48, 3)
    changed = (made["cam_high"] != sample["cam_high"]).any(-1)
    assert 0.002 < changed.mean() < 0.2
    assert made["cam_wrist"] is sample["cam_wrist"]


def test_batches_are_edited_row_by_row(template: Path, tmp_path: Path) -> None:
    recipe, theirs = recipe_file(tmp_path, PAINT), Theirs(template)
    one = wrapped(template, recipe)
    rows = [theirs[i] for i in (2, 11)]
    batch = {
        "where": [row["where"] for row in rows],
        "front_rgb": torch.stack([row["obs"]["front_rgb"] for row in rows]),
    }
    ours = wrap(
        [batch], template, recipe, episode=lambda s: [key for key, _ in s["where"]],
        frame=lambda s: [t for _, t in s["where"]], cameras={"front": "front_rgb"},
    )  # fmt: skip
    wanted = torch.stack([one[i]["obs"]["front_rgb"] for i in (2, 11)])
    assert torch.equal(ours[0]["front_rgb"], wanted)
    assert not torch.equal(wanted, batch["front_rgb"])


def test_iterators_are_wrapped_too(template: Path, tmp_path: Path) -> None:
    class Stream(IterableDataset):
        def __iter__(self) -> Iterator[Any]:
            yield from (Theirs(template)[i] for i in (0, 5))

    ours = wrapped(template, recipe_file(tmp_path, PAINT), Stream())
    made = list(ours)
    assert len(made) == 2
    assert torch.equal(
        made[1]["obs"]["front_rgb"], wrapped(template, tmp_path / "r.yaml")[5]["obs"]["front_rgb"]
    )


def test_what_is_not_augmented_is_the_sample_itself(template: Path, tmp_path: Path) -> None:
    ours = wrapped(template, recipe_file(tmp_path, PAINT), schedule=Schedule(probability=0.0))
    assert torch.equal(ours[3]["obs"]["front_rgb"], Theirs(template)[3]["obs"]["front_rgb"])


def test_a_sample_of_another_frame_or_episode_is_refused(template: Path, tmp_path: Path) -> None:
    recipe = recipe_file(tmp_path, PAINT)
    for episode, frame in (
        (lambda s: 1, frame_of),
        (episode_of, lambda s: (s["where"][1] + 3) % 6),
    ):
        ours = wrap(
            Theirs(template), template, recipe, episode=episode, frame=frame, cameras={"front": "obs/front_rgb"}
        )  # fmt: skip
        with pytest.raises(Unsupported, match="another image"):
            ours[2]


def test_wrong_names_are_told(template: Path, tmp_path: Path) -> None:
    recipe = recipe_file(tmp_path, PAINT)
    with pytest.raises(Unsupported, match="no camera is called 'side'; there are: front, overhead"):
        wrapped(template, recipe, cameras={"side": "obs/front_rgb"})[0]
    with pytest.raises(Unsupported, match="no 'obs/rgb'; there are: front_rgb"):
        wrapped(template, recipe, cameras={"front": "obs/rgb"})[0]
    with pytest.raises(Unsupported, match="found 'colour'"):
        wrapped(template, recipe, cameras={"front": {"colour": "obs/front_rgb"}})
    for episode, text in ((lambda s: 7, "0 to 1"), (lambda s: "x", "episodes/episode0")):
        ours = wrap(
            Theirs(template),
            template,
            recipe,
            episode=episode,
            frame=frame_of,
            cameras={"front": "obs/front_rgb"},
        )
        with pytest.raises(Unsupported, match=text):
            ours[0]
