"""Which pictures and words are alike to CLIP (Radford et al. 2021, arXiv 2103.00020), from a folder of your own."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch.nn import functional

from rpaug.providers import models

MEAN, DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)


@dataclass(frozen=True)
class Clip:
    """A `transformers.CLIPModel`, shown pictures as it was trained on them."""

    model: Any
    folder: Path | None = None

    @classmethod
    def load(cls, folder: Path) -> "Clip":
        """The model saved in a folder; nothing is downloaded. Raises Unsupported or MissingExtra."""
        return cls(models.load(folder, {"clip": "CLIPModel"}, "CLIP").model, folder)

    def pixels(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[torch.Tensor, "1 3 s s"]:
        """A picture's middle square as the model is shown it, of its own size."""
        size = self.model.config.vision_config.image_size
        pixels = torch.from_numpy(image.astype(np.float32) / 255).permute(2, 0, 1)[None]
        factor = size / min(image.shape[:2])
        shape = [round(side * factor) for side in image.shape[:2]]
        pixels = functional.interpolate(pixels, shape, mode="bicubic", antialias=True).clamp(0, 1)
        top, left = ((side - size) // 2 for side in shape)
        pixels = pixels[:, :, top : top + size, left : left + size]
        mean, deviation = (pixels.new_tensor(v)[:, None, None] for v in (MEAN, DEVIATION))
        return (pixels - mean) / deviation

    def embed(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "d"]:
        """The unit vector that stands for a picture."""
        with torch.no_grad():
            seen = self.model.vision_model(pixel_values=self.pixels(image))
            found = self.model.visual_projection(seen.pooler_output)[0].double()
        return (found / found.norm()).numpy()

    def closest(self, image: UInt8[np.ndarray, "h w 3"], texts: Sequence[str]) -> int:
        """Which of the texts suits the picture best. Raises Unsupported without a tokenizer beside the model."""
        assert self.folder is not None
        asked = models.tokenizer(self.folder)(list(texts), padding=True, return_tensors="pt")
        with torch.no_grad():
            read = self.model.text_model(
                input_ids=asked["input_ids"], attention_mask=asked["attention_mask"]
            ).pooler_output
            found = self.model.text_projection(read).double().numpy()
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        return int((found @ self.embed(image)).argmax())
