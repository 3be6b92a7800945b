"""Segmenters: GrabCut on known shapes, and the real SAM classes with tiny random weights from disk."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.torch
import tiny_models
import torch
import transformers

from rpaug.core.errors import Unsupported
from rpaug.providers import models
from rpaug.providers.detect import detector
from rpaug.providers.segment import Box, GrabCut, Sam, Sam2, segmenter, whole_pixels


def disc(radius: float = 6.0, size: int = 64) -> tuple[np.ndarray, np.ndarray, Box]:
    """A dark disc on a light, uneven ground, its mask and a box around it."""
    rows, columns = np.mgrid[:size, :size]
    inside = (rows - 30.2) ** 2 + (columns - 34.6) ** 2 < radius**2
    ground = 200 + 20 * np.sin(columns / 5) + np.random.default_rng(0).normal(0, 4, (size, size))
    image = np.where(inside, 60, ground)[..., None] + np.array([0, 5, 10])
    box = (34.6 - radius - 1, 30.2 - radius - 1, 34.6 + radius + 1, 30.2 + radius + 1)
    return np.clip(image, 0, 255).astype(np.uint8), inside, box


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("radius", [3.0, 6.0, 14.0])
def test_grabcut_finds_what_stands_out_in_the_box(radius: float) -> None:
    image, inside, box = disc(radius)
    found = GrabCut()(image, box)
    assert iou(found, inside) > (0.7 if radius < 5 else 0.9)
    np.testing.assert_array_equal(GrabCut()(image, box), found)


def test_grabcut_stays_within() -> None:
    image, inside, box = disc()
    half = np.zeros_like(inside)
    half[:, :35] = True
    assert not (GrabCut()(image, box, half) & ~half).any()
    assert not GrabCut()(image, box, np.zeros_like(inside)).any()


@pytest.mark.parametrize("box", [(-20, -20, -5, -5), (70, 10, 90, 20), (10, 10, 9, 9)])
def test_a_box_outside_the_image_holds_nothing(box: Box) -> None:
    image, _, _ = disc()
    assert not GrabCut()(image, box).any()


def test_a_box_over_the_whole_image_is_no_error() -> None:
    image, _, _ = disc()
    assert GrabCut()(image, (-1, -1, 64, 64)).shape == (64, 64)


def test_boxes_hold_the_pixels_whose_centres_lie_in_them() -> None:
    assert whole_pixels((0.5, 1.0, 3.4, 3.0), 10, 10) == (1, 1, 4, 4)
    assert whole_pixels((-5, -5, 50, 50), 10, 8) == (0, 0, 10, 8)


def test_names() -> None:
    assert isinstance(segmenter("grabcut"), GrabCut)
    with pytest.raises(Unsupported, match=r"sam: no model there: expected a folder .* or an id"):
        segmenter("sam")


KINDS = ("sam", "sam2", "sam2_video", "sam3_tracker", "sam3_video")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {kind: tiny_models.saved(kind, tmp_path_factory.mktemp(kind)) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(48, 64), (100, 50)])
def test_the_real_classes_give_a_mask_of_the_images_size(
    kind: str, shape: tuple[int, int], folders: dict[str, Path]
) -> None:
    model = segmenter(str(folders[kind]))
    assert isinstance(model, Sam if kind == "sam" else Sam2)
    image = np.random.default_rng(1).integers(0, 255, (*shape, 3)).astype(np.uint8)
    box = (10.0, 12.0, 30.0, 40.0)
    mask = model(image, box)
    assert mask.shape == shape
    assert mask.dtype == bool
    np.testing.assert_array_equal(model(image, box), mask)
    within = np.zeros(shape, bool)
    within[:20] = True
    np.testing.assert_array_equal(model(image, box, within), mask & within)


@pytest.mark.parametrize(
    ("kind", "norm"),
    [("Sam", models.IMAGENET), ("Sam2", models.IMAGENET), ("Sam3", models.STANDARD)],
)
def test_pictures_have_the_colors_of_the_models_own_processor(kind: str, norm: Any) -> None:
    """The reference: the mean and deviation that transformers' processors state, which need torchvision to run."""
    source = Path(transformers.__file__).parent / "models" / kind.lower()
    (text,) = (
        path.read_text() for path in source.glob("image_processing_*.py") if "pil" not in path.name
    )
    default = "IMAGENET_DEFAULT_MEAN" if norm is models.IMAGENET else "IMAGENET_STANDARD_MEAN"
    assert f"image_mean = {default}" in text
    stated = getattr(transformers.image_utils, default)
    np.testing.assert_allclose(norm[0], stated)


def test_a_folder_without_its_model_is_refused(tmp_path: Path, folders: dict[str, Path]) -> None:
    with pytest.raises(Unsupported, match=r"no config.json"):
        segmenter(str(tmp_path))
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(Unsupported, match=r"model_type 'nothing'.*a segmenter.*takes .*sam2"):
        segmenter(str(tmp_path))
    with pytest.raises(Unsupported, match=r"model_type 'sam2'; a detector .* takes grounding-dino"):
        detector(str(folders["sam2"]))


@pytest.mark.parametrize("spoil", ["fewer", "others", "shapes", "cut", "pickle"])
def test_weights_that_are_not_all_its_own_are_refused(
    spoil: str, tmp_path: Path, folders: dict[str, Path]
) -> None:
    shutil.copytree(folders["sam2"], tmp_path, dirs_exist_ok=True)
    path = tmp_path / "model.safetensors"
    held = safetensors.torch.load_file(path)
    first = next(name for name in sorted(held) if name.startswith("mask_decoder"))
    if spoil == "fewer":
        del held[first]
    elif spoil == "others":
        held = {f"x.{name}": value for name, value in held.items()}
    elif spoil == "shapes":
        held[first] = torch.zeros(3, 5, 7)
    if spoil == "cut":
        path.write_bytes(path.read_bytes()[:-100])
    elif spoil == "pickle":
        torch.save(held, tmp_path / "pytorch_model.bin")
        path.unlink()
    else:
        safetensors.torch.save_file(held, path, {"format": "pt"})
    with pytest.raises(Unsupported, match=str(tmp_path)) as caught:
        segmenter(str(tmp_path))
    assert "\n" not in str(caught.value)
