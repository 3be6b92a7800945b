"""Models in transformers' layout, loaded from a local folder only, and images as they take them.

Pictures are resized and normalised here, so that no image processor (and no torchvision) is needed.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from rpaug.core.errors import MissingExtra, Unsupported

EXTRA = "models"
IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # mean, standard deviation
CLIP = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)

VOCABULARIES = "tokenizer.json", "vocab.txt", "vocab.json", "spiece.model", "tokenizer.model"


def transformers(extra: str = EXTRA) -> Any:
    """The package. Raises MissingExtra."""
    try:
        import transformers as package
    except ImportError:
        raise MissingExtra("transformers", extra) from None
    package.utils.logging.disable_progress_bar()
    return package


def load(kind: str, folder: Path | str, flag: str, device: str = "cpu") -> Any:
    """A model of the class `kind`, ready to be asked. `flag` is what names the folder in a recipe.

    Raises MissingExtra without transformers, Unsupported for a folder that holds no such model.
    """
    package, folder = transformers(), Path(folder)
    if not (folder / "config.json").is_file():
        raise Unsupported(
            f"{folder}: no model there (no config.json); {flag} takes a folder with a {kind} in transformers' layout"
        )
    try:
        model = getattr(package, kind).from_pretrained(str(folder), local_files_only=True)
    except (OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise Unsupported(f"{folder}: not a {kind} that can be loaded: {reason}") from None
    return model.eval().to(device)


def tokenizer(folder: Path | str) -> Any:
    """The tokenizer beside a model. Raises Unsupported if there is none."""
    if Path(folder).is_dir() and not any((Path(folder) / name).is_file() for name in VOCABULARIES):
        raise Unsupported(
            f"{folder}: no tokenizer beside the model: none of {', '.join(VOCABULARIES)}"
        )
    try:
        return transformers().AutoTokenizer.from_pretrained(str(folder), local_files_only=True)
    except (OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise Unsupported(f"{folder}: no tokenizer beside the model: {reason}") from None


def picture(
    image: UInt8[np.ndarray, "h w 3"],
    size: tuple[int, int],
    canvas: tuple[int, int],
    norm: tuple[Sequence[float], Sequence[float]] = IMAGENET,
    fill: float | None = None,
) -> Float32[np.ndarray, "1 3 a b"]:
    """The image resized to `size` (height, width), in the corner of a `canvas`, normalised.

    Beside the image the canvas holds zeros, or `fill` (0..1) normalised like the image.
    """
    smaller = size[0] < image.shape[0] or size[1] < image.shape[1]
    way = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    resized = cv2.resize(image, size[::-1], interpolation=way).astype(np.float32) / 255
    mean, spread = (np.array(part, np.float32) for part in norm)
    out = np.zeros((*canvas, 3), np.float32)
    if fill is not None:
        out[:] = (fill - mean) / spread
    out[: size[0], : size[1]] = (resized - mean) / spread
    return np.ascontiguousarray(out.transpose(2, 0, 1)[None])


def sigmoid(logits: Float32[np.ndarray, "..."]) -> Float32[np.ndarray, "..."]:
    """1 / (1 + e^-x), without overflow."""
    return 0.5 * (1 + np.tanh(0.5 * logits))
