"""Segmenters: an image and a box in it, and the mask of the thing that the box is about.

`GrabCut` needs no weights. `Sam` and `Sam2` are the real models, by a folder or by an id of the hub.
"""

from typing import Any, Protocol

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rpaug.providers import grabcut
from rpaug.providers.models import IMAGENET, STANDARD, Loaded, load, picture

GRABCUT = "grabcut"
KINDS = {
    "sam": "SamModel",
    "sam2": "Sam2Model",
    "sam2_video": "Sam2Model",
    "sam3_tracker": "Sam3TrackerModel",
    "sam3_video": "Sam3TrackerModel",
    "edgetam": "EdgeTamModel",
    "edgetam_video": "EdgeTamModel",
}
Box = tuple[float, float, float, float]
"""Left, top, right, bottom in pixels, edges of the box; pixel centres lie at integer coordinates."""


class Segmenter(Protocol):
    """Finds the mask of what a box holds. `within` marks the pixels that can belong to it at all."""

    def __call__(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        box: Box,
        within: Bool[np.ndarray, "h w"] | None = None,
    ) -> Bool[np.ndarray, "h w"]: ...


class GrabCut:
    """GrabCut (Rother et al. 2004) in the box and a margin around it, enlarged so that small things have pixels.

    What lies in the box is foreground if its colors are unlike those around the box. The same input gives the
    same mask.
    """

    margin = 0.75  # of the box's sides, looked at on each side of it
    least = 96  # pixels across the box that it is enlarged to, at most four times
    rounds = 5

    def __call__(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        box: Box,
        within: Bool[np.ndarray, "h w"] | None = None,
    ) -> Bool[np.ndarray, "h w"]:
        """The mask; empty if the box lies outside the image or nothing in it stands out."""
        height, width = image.shape[:2]
        out = np.zeros((height, width), bool)
        left, top, right, bottom = whole_pixels(box, width, height)
        if left >= right or top >= bottom:
            return out
        wide, high = right - left, bottom - top
        around = int(np.ceil(self.margin * max(wide, high))) + 2
        rows = slice(max(0, top - around), min(height, bottom + around))
        columns = slice(max(0, left - around), min(width, right + around))
        grown = int(np.clip(self.least // max(wide, high, 1), 1, 4))
        known = np.full((height, width), grabcut.BEHIND, np.uint8)
        known[top:bottom, left:right] = grabcut.MAYBE_THING
        if within is not None:
            known[~within] = grabcut.BEHIND
        inside = known[rows, columns]
        if (inside != grabcut.BEHIND).any() and (inside == grabcut.BEHIND).any():
            out[rows, columns] = _largest(
                grabcut.cut(image[rows, columns], inside, grown, self.rounds)
            )
        return out


def whole_pixels(box: Box, width: int, height: int) -> tuple[int, int, int, int]:
    """The pixels whose centres lie in the box, as bounds of slices: first and one past the last."""
    left, top, right, bottom = box
    return (
        int(np.clip(np.ceil(left), 0, width)),
        int(np.clip(np.ceil(top), 0, height)),
        int(np.clip(np.floor(right) + 1, 0, width)),
        int(np.clip(np.floor(bottom) + 1, 0, height)),
    )


def _largest(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The largest connected piece."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count < 2:
        return mask
    return labels == 1 + int(facts[1:, cv2.CC_STAT_AREA].argmax())


class Sam:
    """Segment Anything (Kirillov et al. 2023, arXiv 2304.02643)."""

    def __init__(self, loaded: Loaded) -> None:
        self._model = loaded.model

    def __call__(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        box: Box,
        within: Bool[np.ndarray, "h w"] | None = None,
    ) -> Bool[np.ndarray, "h w"]:
        """The mask that the model trusts most, cut to `within`."""
        side = int(self._model.config.vision_config.image_size)
        scale = side / max(image.shape[:2])  # the longer side fills the square, the rest is zeros
        high, wide = (max(1, round(scale * edge)) for edge in image.shape[:2])
        pixels = picture(image, (high, wide), (side, side))
        logits = _best(self._model, pixels, [scale * edge for edge in box])
        logits = cv2.resize(logits, (side, side), interpolation=cv2.INTER_LINEAR)
        return _cut(logits[:high, :wide], image, within)


class Sam2:
    """SAM 2 (Ravi et al. 2024, arXiv 2408.00714), SAM 3's tracker, which takes boxes as it does, and EdgeTAM (Zhou et
    al. 2025, arXiv 2501.07256)."""

    def __init__(self, loaded: Loaded) -> None:
        self._model = loaded.model
        self._norm = STANDARD if loaded.kind.startswith("sam3") else IMAGENET

    def __call__(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        box: Box,
        within: Bool[np.ndarray, "h w"] | None = None,
    ) -> Bool[np.ndarray, "h w"]:
        """The mask that the model trusts most, cut to `within`."""
        side = int(self._model.config.prompt_encoder_config.image_size)
        height, width = image.shape[:2]  # SAM 2 squeezes every image into its square
        pixels = picture(image, (side, side), (side, side), self._norm)
        scale = (side / width, side / height) * 2
        logits = _best(self._model, pixels, [s * edge for s, edge in zip(scale, box, strict=True)])
        return _cut(logits, image, within)


def _best(
    model: Any, pixels: Float32[np.ndarray, "1 3 s s"], box: list[float]
) -> Float32[np.ndarray, "a b"]:
    """Logits of the mask with the highest predicted overlap. The models shift the box to pixel centres themselves."""
    import torch

    with torch.inference_mode():
        found = model(
            pixel_values=torch.from_numpy(pixels).to(model.device),
            input_boxes=torch.tensor([[box]], dtype=torch.float32, device=model.device),
            multimask_output=True,
        )
    scores = found.iou_scores[0, 0].float().cpu().numpy()
    return found.pred_masks[0, 0].float().cpu().numpy()[scores.argmax()]


def _cut(
    logits: Float32[np.ndarray, "a b"],
    image: UInt8[np.ndarray, "h w 3"],
    within: Bool[np.ndarray, "h w"] | None,
) -> Bool[np.ndarray, "h w"]:
    """Where resized logits are positive."""
    size = (image.shape[1], image.shape[0])
    mask = cv2.resize(np.ascontiguousarray(logits), size, interpolation=cv2.INTER_LINEAR) > 0
    return mask if within is None else mask & within


def segmenter(name: str = GRABCUT, device: str = "cpu") -> Segmenter:
    """The segmenter of that name: `grabcut`, a folder, or an id of the hub. Raises Unsupported, MissingExtra."""
    if name == GRABCUT:
        return GrabCut()
    loaded = load(name, KINDS, "a segmenter (grabcut, or models: instances)", device)
    return Sam(loaded) if loaded.kind == "sam" else Sam2(loaded)
