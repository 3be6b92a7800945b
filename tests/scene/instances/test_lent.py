"""Gaussians of color images alone: on the stage, and on the depth that a scripted network gives."""

import numpy as np
import pytest
import torch
from rgb_only_tables import SIZE, episode, image

from rpaug.core.errors import Unsupported
from rpaug.gaussians import fit_static_rgb, gaussian_view, untracked_gaussians
from rpaug.pipeline import copies as pipeline
from rpaug.pipeline import fit, recipe
from rpaug.pipeline.prepare import ground, prepare_scene

RED = {"op": "recolor", "target": {"text": "the red thing"}, "color": "green"}
MOVE = {"op": "camera_pose", "camera": ["image_0"], "shift": 0.02, "turn": 0.01}


class Net(torch.nn.Module):
    """A small convolutional network, scripted: rows farther up are farther, whatever the colors say."""

    def __init__(self) -> None:
        super().__init__()
        self.first = torch.nn.Conv2d(3, 4, 3, padding=1)
        self.last = torch.nn.Conv2d(4, 1, 3, padding=1)
        with torch.no_grad():
            self.last.weight.mul_(1e-3)
            self.last.bias.zero_()

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        down = torch.linspace(0.0, 1.0, image.shape[2])[None, None, :, None]
        learned = self.last(torch.relu(self.first(image)))
        return (1 / (0.6 + 0.8 * down) + 0.01 * learned)[:, 0]


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> str:
    torch.manual_seed(0)
    file = tmp_path_factory.mktemp("model") / "net.pt"
    torch.jit.script(Net()).save(str(file))
    return f"torchscript:{file}"


def asked(*edits: dict, **given) -> recipe.Recipe:
    return recipe.build({"version": 1, "edits": list(edits), **given})


@pytest.fixture(scope="module")
def on_stage():
    return prepare_scene(episode(), asked(RED), 3)


def db(one: np.ndarray, other: np.ndarray) -> float:
    return 10 * np.log10(255**2 / ((one.astype(float) - other) ** 2).mean())


def test_they_show_every_frame_what_moves_included(on_stage) -> None:
    scene, plan = on_stage
    assert set(plan.representations.values()) == {3}
    for t in (0, 6, 11):
        assert db(gaussian_view.blended(scene, "image_0", t)[0], image(t)) > 26
    assert plan.fit["train_db"] > 26
    assert plan.fit["held_out_db"] is None
    assert not np.isin(scene.gaussians.ids, sorted(untracked_gaussians.unsteady(scene))).any()


def test_edits_of_them_are_shown_and_no_depth_is_written(on_stage) -> None:
    scene, plan = on_stage
    ground(scene, asked(RED))
    edited, draws = pipeline.draw(scene, asked(RED), 1)
    made = pipeline.render(edited, draws, plan).episode.views["image_0"]
    red, green, _ = np.moveaxis(made.rgb(5)[38:42, 16:20].astype(int), -1, 0)
    assert (green > red + 40).all()
    assert made.depth is None
    assert made.ids is None


def test_a_camera_does_not_move_on_a_stage(on_stage) -> None:
    with pytest.raises(Unsupported, match=r"camera_pose: .*--models depth=NAME"):
        ground(on_stage[0], asked(MOVE))


def test_a_camera_moves_a_little_on_the_depth_of_a_model(model: str) -> None:
    given = asked(MOVE, models={"depth": model})
    scene, plan = prepare_scene(episode(), given, 3)
    ground(scene, given)
    edited, draws = pipeline.draw(scene, given, 1)
    made = pipeline.render(edited, draws, plan).episode.views["image_0"]
    recorded = scene.episode.views["image_0"].camera
    assert not np.array_equal(edited.cameras["image_0"].cam_to_world, recorded.cam_to_world)
    assert 0.5 < np.abs(made.rgb(5).astype(int) - image(5)).mean() < 40
    assert (made.rgb(5)[:20].max(-1) < 60).sum() > 100  # the arm is there, and dark
    given = "\n".join(plan.assumed)
    assert "guessed by a model" in given
    assert f"focal length of {1.2 * SIZE:.0f} px assumed" in given


def test_cameras_that_do_not_know_of_one_another_are_refused() -> None:
    with pytest.raises(Unsupported, match="Gaussians could not be shown in all of them alike"):
        prepare_scene(episode(views=2), asked(RED), 3)


def test_a_scene_with_recorded_depth_is_fitted_as_it_is() -> None:
    scene, _ = prepare_scene(episode(), asked(RED), 0)
    views = {name: type(view)(view.camera, view.rgb) for name, view in scene.episode.views.items()}
    plain = type(scene.episode)(
        "k", views, scene.episode.robot, scene.episode.descriptions, scene.episode.length
    )
    bare = type(scene)(plain, scene.cameras, scene.bodies, {}, False, ())
    assert fit_static_rgb.fitted(bare, lambda one: (one, {"same": one is bare}))[1] == {
        "same": True
    }


def test_fit_stores_and_finds_them_again(tmp_path) -> None:
    from rpaug.gaussians.descent import FitSettings

    settings = FitSettings(steps=20)
    first = fit.fit_episode(episode(), tmp_path, settings=settings)
    again = fit.fit_episode(episode(), tmp_path, settings=settings)
    assert (first["found_in_store"], again["found_in_store"]) == (False, True)
    assert first["scene"] == again["scene"]
    assert first["train_db"] == again["train_db"]
