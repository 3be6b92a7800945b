"""Scenes kept in a folder: read back they draw what they drew, and damage is told."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from arm_files import panda_mjcf

from rpaug import BadInput
from rpaug.core import registry
from rpaug.scene.build import build
from rpaug.scene.recorded import surfels
from rpaug.training import AugmentedEpisodes, prepared

KEY = "roll_ball/all_variations/episodes/episode0"
MOVE = {"version": 1, "seed": 4, "edits": [{"op": "camera_pose", "camera": "front", "shift": 0.05}]}


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(MOVE))
    return path


def test_what_is_read_back_is_what_was_kept(template: Path, tmp_path: Path) -> None:
    episode = registry.adapter("rlbench").read(template, KEY)
    scene = build(episode, with_bodies=True)
    kept = surfels.recorded(scene)
    prepared.save(tmp_path / "scene.npz", scene, kept)
    found = prepared.load(tmp_path / "scene.npz", build(episode, with_bodies=False))
    assert found is not None
    again, surfels_again = found
    assert again.roles == scene.roles
    for one, other in zip(again.bodies, scene.bodies, strict=True):
        assert (one.instance_ids, one.motion, one.ambiguous) == (
            other.instance_ids,
            other.motion,
            other.ambiguous,
        )
        assert np.array_equal(one.to_world, other.to_world)
    assert surfels_again is not None
    assert surfels_again.noise == kept.noise
    assert len(kept.edges.instance_ids)
    for name, array in vars(kept.edges).items():
        assert np.array_equal(array, vars(surfels_again.edges)[name])
    assert prepared.size(surfels_again) == prepared.size(kept) > 0
    for t in (0, 3):
        one, other = (surfels.view(each, scene, "front", t) for each in (kept, surfels_again))
        assert np.array_equal(one.image, other.image)
        assert np.array_equal(one.depth, other.depth)


def test_a_folder_changes_nothing_but_the_time(
    template: Path, recipe: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = AugmentedEpisodes(template, recipe, frames=[1])[0]
    first = AugmentedEpisodes(template, recipe, frames=[1], scenes=tmp_path / "scenes")[0]
    monkeypatch.setattr(surfels, "recorded", None)  # what is kept is not looked for again
    again = AugmentedEpisodes(template, recipe, frames=[1], scenes=tmp_path / "scenes")[0]
    for kind, image in alone["cameras"]["front"].items():
        assert torch.equal(image, first["cameras"]["front"][kind])
        assert torch.equal(image, again["cameras"]["front"][kind])
    assert len(list((tmp_path / "scenes").glob("*.npz"))) == 1


def test_a_scene_with_an_arm_by_its_file_is_prepared_each_time(
    template: Path, recipe: Path, tmp_path: Path
) -> None:
    """What is kept of a scene does not hold the arm's shape."""
    (tmp_path / "panda.xml").write_text(panda_mjcf())
    recipe.write_text(json.dumps(MOVE | {"arms": [str(tmp_path / "panda.xml")]}))
    episodes = AugmentedEpisodes(template, recipe, frames=[1], scenes=tmp_path / "scenes")
    assert episodes[0]["cameras"]["front"]
    assert not [*(tmp_path / "scenes").glob(f"*{prepared.ENDING}")]


@pytest.mark.parametrize("spoil", ["cut", "noise", "version"])
def test_a_damaged_file_is_told(template: Path, recipe: Path, tmp_path: Path, spoil: str) -> None:
    AugmentedEpisodes(template, recipe, frames=[1], scenes=tmp_path / "scenes")[0]
    (path,) = (tmp_path / "scenes").glob("*.npz")
    data = path.read_bytes()
    if spoil == "version":
        np.savez(path, facts=np.array(json.dumps({"version": 99})))
    else:
        path.write_bytes(data[: len(data) // 2] if spoil == "cut" else b"no archive at all")
    with pytest.raises(BadInput, match=path.name):
        AugmentedEpisodes(template, recipe, frames=[1], scenes=tmp_path / "scenes")[0]
