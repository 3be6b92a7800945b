"""A model of depth, named by path, in the place of a depth that was never recorded."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rgb_only_tables import episode, image

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.pipeline import copies as pipeline
from rpaug.pipeline import recipe
from rpaug.pipeline.prepare import ground, prepare_scene
from rpaug.providers.depth import depth
from rpaug.providers.models_settings import Models
from rpaug.scene.build import find, sources
from rpaug.scene.instances.by_models import AskedModels


class Slope(torch.nn.Module):
    """A table that rises away from the camera: rows farther up are farther."""

    def __init__(self, inverse: bool) -> None:
        super().__init__()
        self.inverse = inverse

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        down = torch.linspace(0, 1, image.shape[2], device=image.device)
        near = (0.6 + 0.8 * down)[None, :, None].expand(image.shape[0], -1, image.shape[3])
        return 10 * near if self.inverse else 1 / near


def by_depth(name: str) -> AskedModels:
    return AskedModels(Models(depth=name))


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("depth")
    for inverse in (False, True):
        torch.jit.script(Slope(inverse)).save(str(folder / f"slope_{inverse}.pt"))
    return folder


@pytest.mark.parametrize(
    ("kind", "file"), [("torchscript", "slope_False.pt"), ("torchscript-inverse", "slope_True.pt")]
)
def test_the_support_becomes_level(models: Path, kind: str, file: str) -> None:
    scene = find(episode(), sources(tuple, by_depth(f"{kind}:{models / file}"))).scene()
    view = scene.episode.views["image_0"]
    points = geometry.world_points(view.depth(3).astype(float), view.camera, 3)
    table = np.isin(view.ids(3), list(scene.roles["table"]))
    assert np.abs(points[table][:, 2]).max() < 0.01
    assert view.camera.cam_to_world[0, 2, 3] > 0.1


def test_a_camera_may_move_a_little_and_nothing_of_the_model_is_written(models: Path) -> None:
    given = {
        "version": 1,
        "models": {"depth": f"torchscript:{models / 'slope_False.pt'}"},
        "edits": [{"op": "camera_pose", "camera": ["image_0"], "shift": 0.02, "turn": 0.02}],
    }
    asked = recipe.build(given)
    scene, plan = prepare_scene(episode(), asked, 0)
    ground(scene, asked)
    edited, draws = pipeline.draw(scene, asked, 1)
    made = pipeline.render(edited, draws, plan).episode.views["image_0"]
    assert made.depth is None
    assert made.ids is None
    off = np.abs(made.rgb(0).astype(int) - image(0)).mean()
    assert 0.5 < off < 40
    assert any("guessed by a model" in one for one in plan.assumed)


def test_what_is_no_model_is_refused(models: Path, tmp_path: Path) -> None:
    (tmp_path / "junk.pt").write_bytes(b"no model")
    for name, reason in (
        ("nothing", "nothing: no model there"),
        (f"torchscript:{tmp_path / 'none.pt'}", "none.pt"),
        (f"torchscript:{tmp_path / 'junk.pt'}", "no TorchScript model of depth"),
    ):
        with pytest.raises(Unsupported, match=reason):
            depth(name)
    with pytest.raises(Unsupported, match="views: \\[image_0\\]"):
        find(
            episode(views=2),
            sources(tuple, by_depth(f"torchscript:{models / 'slope_False.pt'}")),
        )
