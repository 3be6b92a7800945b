"""Detectors: an image and a few words, and boxes around what the words mean, with masks where the model gives them.

The offline default knows roles, colors, shapes and relations and needs a scene: `rpaug.scene.targets.targets`.
`GroundingDino`, `Owlv2` and `Sam3` are the real models, by a folder or by an id of the hub.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rpaug.providers.models import CLIP, STANDARD, Loaded, load, picture, sigmoid, tokenizer
from rpaug.providers.segment import Box

KINDS = {
    "grounding-dino": "GroundingDinoForObjectDetection",
    "mm-grounding-dino": "MMGroundingDinoForObjectDetection",
    "owlv2": "Owlv2ForObjectDetection",
    "sam3": "Sam3Model",
    "sam3_video": "Sam3Model",  # the same network beside its tracker, which is left
}


@dataclass(frozen=True, eq=False)
class Detection:
    """A box (left, top, right, bottom in pixels, centres at integers), how sure the detector is, 0..1, and a mask from
    those that segment as well."""

    box: Box
    score: float
    mask: Bool[np.ndarray, "h w"] | None = None


class Detector(Protocol):
    """Finds what some words mean in an image; the surest first, none if there is nothing."""

    def __call__(self, image: UInt8[np.ndarray, "h w 3"], words: str) -> list[Detection]: ...


class GroundingDino:
    """Grounding DINO (Liu et al. 2023, arXiv 2303.05499) or MM-Grounding-DINO (Zhao et al. 2024, arXiv 2401.02361)."""

    sides = (800, 1333)  # pixels: of the shorter side, and at most of the longer one

    def __init__(self, loaded: Loaded, threshold: float = 0.25) -> None:
        self._model = loaded.model
        self._words, self._threshold = tokenizer(loaded.folder), threshold

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
    """OWLv2 (Minderer et al. 2023, arXiv 2306.09683)."""

    def __init__(self, loaded: Loaded, threshold: float = 0.1) -> None:
        self._model = loaded.model
        self._words, self._threshold = tokenizer(loaded.folder), threshold

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


class Sam3:
    """SAM 3 (Carion et al. 2025, arXiv 2511.16719) asked for a concept: every instance with its mask."""

    tokens = 32  # of a phrase

    def __init__(self, loaded: Loaded, threshold: float = 0.3) -> None:
        self._model = loaded.model
        self._words, self._threshold = tokenizer(loaded.folder), threshold

    def __call__(self, image: UInt8[np.ndarray, "h w 3"], words: str) -> list[Detection]:
        """All instances whose score, times that of there being any, is above the threshold."""
        import torch

        height, width = image.shape[:2]
        side = int(self._model.config.vision_config.image_size)
        shown = picture(image, (side, side), (side, side), STANDARD)
        text = self._words(
            words.lower(),
            padding="max_length",
            max_length=self.tokens,
            truncation=True,
            return_tensors="pt",
        )
        with torch.inference_mode():
            found = self._model(
                pixel_values=torch.from_numpy(shown).to(self._model.device),
                input_ids=text["input_ids"].to(self._model.device),
                attention_mask=text["attention_mask"].to(self._model.device),
            )
        scores = sigmoid(found.pred_logits[0].float().cpu().numpy())
        if found.presence_logits is not None:
            scores = scores * sigmoid(found.presence_logits[0].float().cpu().numpy())
        boxes = found.pred_boxes[0].float().cpu().numpy()
        centred = np.concatenate(
            [(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]], 1
        )
        logits = found.pred_masks[0].float().cpu().numpy()
        masks = [
            cv2.resize(np.ascontiguousarray(one), (width, height), interpolation=cv2.INTER_LINEAR)
            > 0
            for one in logits[scores > self._threshold]
        ]
        kept = scores > self._threshold
        return _detections(centred[kept], scores[kept], width, height, self._threshold, masks)


def _detections(
    boxes: Float32[np.ndarray, "n 4"],
    scores: Float32[np.ndarray, "n"],
    width: int,
    height: int,
    threshold: float,
    masks: Sequence[Bool[np.ndarray, "h w"]] = (),
) -> list[Detection]:
    """From shares of an image of this size (centre and sides, its edges at 0 and 1) to pixels, surest first."""
    out = []
    for i in np.argsort(-scores, kind="stable"):
        if scores[i] <= threshold:
            break
        x, y, wide, high = map(float, boxes[i])
        left, right = (x - wide / 2) * width - 0.5, (x + wide / 2) * width - 0.5
        top, bottom = (y - high / 2) * height - 0.5, (y + high / 2) * height - 0.5
        mask = masks[i] if len(masks) else None
        out.append(Detection((left, top, right, bottom), float(scores[i]), mask))
    return out


def detector(name: str, device: str = "cpu") -> Detector:
    """The detector of that name: a folder, or an id of the hub. Raises Unsupported, MissingExtra."""
    loaded = load(name, KINDS, "a detector (models: text)", device)
    if loaded.kind == "owlv2":
        return Owlv2(loaded)
    return Sam3(loaded) if loaded.kind.startswith("sam3") else GroundingDino(loaded)
