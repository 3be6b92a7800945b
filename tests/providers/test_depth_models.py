"""Depth networks of the real classes with tiny random weights, and how their answers become metres."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny_models
import torch

from rpaug.core.errors import Unsupported
from rpaug.providers import depth as module
from rpaug.providers.depth import FARTHEST, Transformer, depth
from rpaug.providers.models import Loaded

IMAGE = np.random.default_rng(0).integers(0, 255, (42, 63, 3)).astype(np.uint8)


@pytest.mark.parametrize("kind", ["depth_anything", "prompt_depth_anything"])
def test_the_real_classes_give_metres_of_the_images_size(kind: str, tmp_path: Path) -> None:
    model = depth(str(tiny_models.saved(kind, tmp_path)))
    assert not model.relative
    found = model(IMAGE)
    assert found.shape == IMAGE.shape[:2]
    assert found.dtype == np.float32
    np.testing.assert_array_equal(model(IMAGE), found)


def test_a_sensors_depth_is_shown_to_the_model_that_takes_it(tmp_path: Path) -> None:
    model = depth(str(tiny_models.saved("prompt_depth_anything", tmp_path)))
    known = np.linspace(0.5, 2, IMAGE[..., 0].size, dtype=np.float32).reshape(IMAGE.shape[:2])
    assert np.abs(model(IMAGE, known) - model(IMAGE)).max() > 1e-3
    np.testing.assert_array_equal(model(IMAGE, np.zeros_like(known)), model(IMAGE))


class Answers(torch.nn.Module):
    """A network that answers what it was told, in the place of a trained one."""

    device = torch.device("cpu")

    def __init__(self, answer: np.ndarray, **config: Any) -> None:
        super().__init__()
        self.answer, self.shown = torch.from_numpy(answer)[None], (0, 0)
        self.config = type("Config", (), {"patch_size": 14, **config})()
        self.view: torch.Tensor | None = None

    def forward(self, pixel_values: torch.Tensor) -> Any:
        self.shown = tuple(pixel_values.shape[2:])
        return type("Out", (), {"predicted_depth": self.answer, "field_of_view": self.view})()


def test_relative_depth_is_the_inverse_of_what_the_network_says(tmp_path: Path) -> None:
    said = np.array([[2.0, 1.0], [0.5, 0.0]], np.float32)
    model = Transformer(
        Loaded(Answers(said, depth_estimation_type="relative"), tmp_path, "depth_anything")
    )
    assert model.relative
    image = np.zeros((2, 2, 3), np.uint8)
    np.testing.assert_allclose(model(image), [[0.5, 1], [2, FARTHEST / 2]])


def test_depth_pro_is_metric_by_its_field_of_view(tmp_path: Path) -> None:
    """Depth Pro says width / (focal length x depth): with 90 degrees the focal length is half of the width."""
    network = Answers(np.full((2, 2), 0.25, np.float32))
    network.view = torch.tensor([90.0])
    model = Transformer(Loaded(network, tmp_path, "depth_pro"))
    np.testing.assert_allclose(model(np.zeros((2, 2, 3), np.uint8)), 2.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("size", "keeps", "shown"),
    [
        ((518, 518), True, (518, 686)),
        ((518, 518), False, (518, 518)),
        ((70, 140), True, (112, 140)),
    ],
)
def test_images_have_the_sides_that_stand_beside_the_weights(
    size: tuple[int, int], keeps: bool, shown: tuple[int, int], tmp_path: Path
) -> None:
    """DPT's rule: of the two scales the one nearer to 1, and whole patches."""
    facts = {
        "size": {"height": size[0], "width": size[1]},
        "keep_aspect_ratio": keeps,
        "ensure_multiple_of": 14,
    }
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(facts))
    network = Answers(np.ones((4, 4), np.float32), depth_estimation_type="metric")
    Transformer(Loaded(network, tmp_path, "depth_anything"))(np.zeros((480, 640, 3), np.uint8))
    assert network.shown == shown


def test_no_numbers_and_no_models_are_refused(tmp_path: Path) -> None:
    network = Answers(np.full((2, 2), np.nan, np.float32), depth_estimation_type="metric")
    with pytest.raises(Unsupported, match="depths that are no numbers"):
        Transformer(Loaded(network, tmp_path, "depth_anything"))(IMAGE)
    with pytest.raises(
        Unsupported, match=r"model_type 'owlv2'; a model of depth .* takes .*zoedepth"
    ):
        depth(str(tiny_models.saved("owlv2", tmp_path)))
    assert set(module.FILES) == {"torchscript", "torchscript-inverse"}
