"""Gaussians from a file: as a scene's own, and as one more thing in it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from boxes import BLOCK, World
from clouds import some

from rpaug.core import geometry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Scene
from rpaug.gaussians import gaussian_files, gaussian_view, gaussians, semantic
from rpaug.gaussians.seeds import seeds


@pytest.mark.parametrize("named", [True, False])
def test_an_exported_scene_comes_back(
    tmp_path: Path, placed: tuple[World, Scene], named: bool
) -> None:
    scene = replace(placed[1], gaussians=seeds(placed[1]))
    world = gaussians.placed(scene, 16)  # the block is in the air
    ids = world.ids if named else np.zeros_like(world.ids)
    gaussian_files.write(tmp_path / "a.ply", replace(world, ids=ids))
    made = semantic.from_ply(placed[1], tmp_path / "a.ply", t=16)
    assert made.gaussians is not None
    assert scene.gaussians is not None
    assert len(made.gaussians) == len(scene.gaussians)
    block = made.gaussians.means[made.gaussians.ids == BLOCK]
    own = scene.gaussians.means[scene.gaussians.ids == BLOCK]
    assert len(block) == pytest.approx(len(own), rel=0.25)  # some were hidden from all cameras
    assert np.abs(np.median(block, 0) - np.median(own, 0)).max() < 0.01
    for t in (0, 16):
        view = scene.episode.views["left"]
        assert view.ids is not None
        shown = gaussian_view.render_view(made, "left", t)[2]
        true = view.ids(t)
        share = ((shown == BLOCK) & (true == BLOCK)).sum() / (true == BLOCK).sum()
        assert share > 0.8, t


def test_gaussians_without_handles_need_masks(placed: tuple[World, Scene]) -> None:
    bare = replace(placed[1], episode=placed[0].episode(masks=False))
    plain = replace(some(5), ids=np.zeros(5, np.int32))
    with pytest.raises(Unsupported, match="no instance ids and the episode no masks"):
        semantic.adopted(bare, plain)


def test_an_asset_stands_where_it_is_put(placed: tuple[World, Scene]) -> None:
    scene = replace(placed[1], gaussians=some(20))
    pose = geometry.rigid(np.array([0.0, 0.0, 0.3]), np.array([0.2, 0.1, 0.4]))
    asset = some(8, bands=4, seed=2)
    made = semantic.added(scene, asset, pose)
    assert made.gaussians is not None
    assert made.gaussians.sh.shape == (28, 4, 3)
    new = made.gaussians.ids[20:]
    assert len(set(new.tolist())) == 1
    assert new[0] not in scene.instance_ids
    np.testing.assert_allclose(
        made.gaussians.means[20:], geometry.transform(pose, asset.means), atol=1e-6
    )
    assert new[0] in made.instance_ids
    with pytest.raises(TargetError, match="is taken"):
        semantic.added(scene, asset, pose, instance_id=BLOCK)
    with pytest.raises(Unsupported, match="no Gaussians"):
        semantic.added(placed[1], asset, pose)
