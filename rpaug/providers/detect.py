"""Detectors: an image and a few words, and boxes around what the words mean.

The offline default knows roles, colors, shapes and relations and needs a scene: `rpaug.scene.targets.targets`.
`GroundingDino` and `Owlv2` are the real models, loaded from a folder that you name.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float32, UInt8

from rpaug.core.errors import Unsupported
from rpaug.providers.models import CLIP, load, picture, sigmoid, tokenizer
from rpaug.providers.segment import Box


@dataclass(frozen=True)
class Detection:
    """A box (left, top, right, bottom in pixels, centres at integers) and how sure the detector is, 0..1."""

    box: Box
    score: float


class Detector(Protocol):
    """Finds what some words mean in an image; the surest first, none if there is nothing."""

    def __call__(self, image: UInt8[np.ndarray, "h w 3"], words: str) -> list[Detection]: ...


class GroundingDino:
    """Grounding DINO (Liu et al. 2023, arXiv 2303.05499) from a local folder in transformers' layout.

    Raises MissingExtra without transformers, Unsupported for a folder that holds no such model.
    """

    sides = (800, 1333)  # pixels: of the shorter side, and at most of the longer one

    def __init__(self, folder: Path | str, threshold: float = 0.25, device: str = "cpu") -> None:
        kind, flag = "GroundingDinoForObjectDetection", "detector: dino:FOLDER"
        self._model = load(kind, folder, flag, device)
        self._words, self._threshold = tokenizer(folder), threshold

    def __call__(self, image: UInt8[np.ndarray, "h w 3"], words: str) -> list[Detection]:
        """All boxes whose score for any of the words is above the threshold."""
        import torch

        height, width = image.shape[:2]
        grown = min(self.sides[0] / min(height, width), self.sides[1] / max(height, width))
        size = max(1, round(grown * height)), max(1, round(grown * width))
        text = self._words(words.lower().strip(" .") + ".", return_tensors="pt")
        with torch.inference_mode():
            found = self._model(
                pixel_values=torch.from_numpy(picture(image, size, size)).to(self._model.device),
                **{name: value.to(self._model.device) for name, value in text.items()},
            )
        scores = sigmoid(found.logits[0].float().cpu().numpy()).max(-1)
        boxes = found.pred_boxes[0].float().cpu().numpy()
        return _detections(boxes, scores, width, height, self._threshold)


class Owlv2:
    """OWLv2 (Minderer et al. 2023, arXiv 2306.09683) from a local folder in transformers' layout. Raises as above."""

    def __init__(self, folder: Path | str, threshold: float = 0.1, device: str = "cpu") -> None:
        self._model = load("Owlv2ForObjectDetection", folder, "detector: owlv2:FOLDER", device)
        self._words, self._threshold = tokenizer(folder), threshold

    def __call__(self, image: UInt8[np.ndarray, "h w 3"], words: str) -> list[Detection]:
        """All boxes whose score for the words is above the threshold."""
        import torch

        config = self._model.config
        side, longest = config.vision_config.image_size, max(image.shape[:2])
        size = tuple(max(1, round(side * edge / longest)) for edge in image.shape[:2])
        most = config.text_config.max_position_embeddings
        text = self._words(
            words.lower(),
            padding="max_length",
            max_length=most,
            truncation=True,
            return_tensors="pt",
        )
        shown = picture(image, (size[0], size[1]), (side, side), CLIP, fill=0.5)
        with torch.inference_mode():
            found = self._model(
                pixel_values=torch.from_numpy(shown).to(self._model.device),
                input_ids=text["input_ids"].to(self._model.device),
                attention_mask=text["attention_mask"].to(self._model.device),
            )
        scores = sigmoid(found.logits[0].float().cpu().numpy()).max(-1)
        boxes = found.pred_boxes[0].float().cpu().numpy()
        return _detections(boxes, scores, longest, longest, self._threshold)


def _detections(
    boxes: Float32[np.ndarray, "n 4"],
    scores: Float32[np.ndarray, "n"],
    width: int,
    height: int,
    threshold: float,
) -> list[Detection]:
    """From shares of an image of this size (centre and sides, its edges at 0 and 1) to pixels, surest first."""
    out = []
    for i in np.argsort(-scores, kind="stable"):
        if scores[i] <= threshold:
            break
        x, y, wide, high = map(float, boxes[i])
        left, right = (x - wide / 2) * width - 0.5, (x + wide / 2) * width - 0.5
        top, bottom = (y - high / 2) * height - 0.5, (y + high / 2) * height - 0.5
        out.append(Detection((left, top, right, bottom), float(scores[i])))
    return out


def detector(name: str) -> Detector:
    """The detector that a recipe names: `dino:FOLDER` or `owlv2:FOLDER`. Raises Unsupported."""
    kind, _, folder = name.partition(":")
    made: dict[str, Any] = {"dino": GroundingDino, "owlv2": Owlv2}
    if kind not in made or not folder:
        raise Unsupported(
            f"no detector is called {name!r}; there are: dino:FOLDER, owlv2:FOLDER (offline, words are enough)"
        )
    return made[kind](folder)
