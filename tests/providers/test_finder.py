"""What words mean in an image: outlines from a file, and a detector with a segmenter."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny_models

from rpaug.core.errors import BadInput
from rpaug.providers.detect import Detection
from rpaug.providers.finder import AskedImage, DetectedOutlines, finder, overlap, plain
from rpaug.providers.models_settings import Models

IMAGE = np.zeros((40, 60, 3), np.uint8)
SQUARE = [[10, 5], [19, 5], [19, 14], [10, 14]]


def drawn(tmp_path: Path, tree: Any) -> Path:
    path = tmp_path / "outlines.json"
    path.write_text(json.dumps(tree))
    return path


def test_outlines_are_masks_of_whole_pixels(tmp_path: Path) -> None:
    ring = {"words": "the  Red cup", "polygons": [SQUARE, [[40, 20], [45, 20], [45, 30]]]}
    path = drawn(tmp_path, {"e/0": {"front": {"3": [ring], "99": []}}})
    made = finder(Models(text=f"outlines:{path}"))
    assert list(made.frames("e/0", "front", 10)) == [3]
    assert list(made.frames("e/0", "left", 10)) == []
    (found,) = made(AskedImage("e/0", "front", 3, IMAGE), "a red cup")
    assert found.mask is not None
    assert found.mask[5:15, 10:20].all()
    assert found.mask[21, 44]
    assert not found.mask[:, :10].any()
    assert found.box == (10, 5, 45, 30)
    assert made(AskedImage("e/0", "front", 3, IMAGE), "cup") == []
    assert made(AskedImage("e/0", "front", 4, IMAGE), "red cup") == []
    assert made.knows("e/0", "Red cup")
    assert not made.knows("e/0", "cup")
    assert not made.knows("e/1", "red cup")


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        ([], "the file: a list"),
        ({"e": {"front": {"x": []}}}, "a frame 'x'"),
        ({"e": {"front": {"0": [{"words": "cup"}]}}}, "no polygon of three corners"),
        ({"e": {"front": {"0": [{"words": 3, "polygon": SQUARE}]}}}, "without words"),
        ({"e": {"front": {"0": [{"words": "cup", "polygon": [[1, 2], [3, "x"], [1, 1]]}]}}}, "corners"),
        ({"e": {"front": {"0": [{"words": "cup", "polygon": [[1, 2], [3, 1e9], [1, 1]]}]}}}, "beyond"),
        ({"e": {"front": {"0": {"words": "cup"}}}}, "no polygon|an outline|a str"),
    ],
)  # fmt: skip
def test_what_is_no_outline_is_named(tree: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=said):
        finder(Models(text=f"outlines:{drawn(tmp_path, tree)}"))
    with pytest.raises(BadInput, match="nothing"):
        finder(Models(text=f"outlines:{tmp_path / 'none.json'}"))


def test_of_boxes_on_one_thing_the_surest_is_kept() -> None:
    def detect(image: np.ndarray, words: str) -> list[Detection]:
        boxes = ((10, 5, 20, 15), 0.9), ((10.2, 5.1, 20.4, 15.2), 0.7), ((40, 20, 50, 30), 0.4)
        return [Detection(box, score) for box, score in boxes]

    def segment(image: np.ndarray, box: Any, within: Any = None) -> np.ndarray:
        mask = np.zeros(image.shape[:2], bool)
        left, top, right, bottom = map(round, box)
        mask[top:bottom, left:right] = True
        return mask

    found = DetectedOutlines("x", detect, segment)(AskedImage("e", "front", 0, IMAGE), "cup")
    assert [one.score for one in found] == [0.9, 0.4]
    assert all(one.mask is not None for one in found)


def test_the_real_classes_go_together(tmp_path: Path) -> None:
    text = tiny_models.saved("grounding-dino", tmp_path / "text")
    instances = tiny_models.saved("sam2", tmp_path / "instances")
    made = finder(Models(text=str(text), instances=str(instances)))
    image = np.random.default_rng(0).integers(0, 255, IMAGE.shape).astype(np.uint8)
    found = made(AskedImage("e", "front", 0, image), "red cup")
    assert all(one.mask is not None and one.mask.shape == (40, 60) for one in found)
    assert made.name == finder(Models(text=str(text), instances=str(instances))).name
    assert made.name != finder(Models(text=str(text))).name
    assert list(made.frames("e", "front", 3)) == [0, 1, 2]


def test_words_and_masks_are_compared() -> None:
    assert plain(" The  RED cup. ") == "red cup"
    one = np.array([[True, True, False]])
    assert overlap(one, ~one) == 0
    assert overlap(one, one) == 1
    assert overlap(one & False, one & False) == 0
    assert overlap(one, np.array([[True, False, False]])) == 0.5
