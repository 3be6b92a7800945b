"""Models in transformers' layout, each loaded whole or refused, and images as they take them.

What a folder holds is told by its own `config.json`, never by its name. Pictures are resized and normalised here, so
that no image processor (and no torchvision) is needed.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.providers import hub

EXTRA = "models"
AUTO = "auto"  # device: a GPU where there is one
IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # mean, standard deviation
STANDARD = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)
CLIP = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)

VOCABULARIES = "tokenizer.json", "vocab.txt", "vocab.json", "spiece.model", "tokenizer.model"


@dataclass(frozen=True)
class Loaded:
    """A model ready to be asked, the folder it came from, and what its configuration calls its kind."""

    model: Any
    folder: Path
    kind: str


def transformers(extra: str = EXTRA) -> Any:
    """The package. Raises MissingExtra."""
    try:
        import transformers as package
    except ImportError:
        raise MissingExtra("transformers", extra) from None
    package.utils.logging.disable_progress_bar()
    return package


def load(name: Path | str, kinds: Mapping[str, str], flag: str, device: str = "cpu") -> Loaded:
    """The model of that name, of the class that `kinds` gives for its `model_type`; `flag` is what names it in recipes.

    Raises MissingExtra without transformers, Unsupported for what is not there, is another kind of model, or lacks
    weights of that kind or has others: a network with random parts is sure of itself, too.
    """
    folder = hub.folder(str(name))
    kind = str(hub.config(folder).get("model_type", ""))
    if kind not in kinds:
        raise Unsupported(
            f"{name}: its config.json says model_type {kind or 'nothing'!r}; {flag} takes {', '.join(sorted(kinds))}"
        )
    package = transformers()
    made = getattr(package, kinds[kind], None)
    if made is None:
        raise Unsupported(
            f"{name}: transformers {package.__version__} has no {kinds[kind]}: a newer one has"
        )
    return Loaded(_whole(package, made, folder, str(name)).to(chosen(device)), folder, kind)


def _whole(package: Any, made: Any, folder: Path, name: str) -> Any:
    """The model with all of its weights. Raises Unsupported."""
    logging = package.utils.logging
    said = logging.get_verbosity()
    logging.set_verbosity_error()  # what it would warn of is refused below
    try:
        model, found = made.from_pretrained(
            str(folder), local_files_only=True, use_safetensors=True, output_loading_info=True
        )
    except Exception as error:  # whatever a spoilt configuration or file brings about in there
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise Unsupported(f"{name}: not a {made.__name__} that can be loaded: {reason}") from None
    finally:
        logging.set_verbosity(said)
    for words, keys in (
        ("lacks weights of", found.get("missing_keys")),
        ("has weights that are none of", found.get("unexpected_keys")),
        ("has weights of another shape than", found.get("mismatched_keys")),
    ):
        if keys:
            some = ", ".join(sorted(map(str, keys))[:3])
            raise Unsupported(
                f"{name}: {words} a {made.__name__}: {len(keys)} of them ({some}): it would answer at random"
            )
    return model.eval()


def chosen(device: str) -> str:
    """The device itself; for "auto" the GPU if torch sees one."""
    if device != AUTO:
        return device
    import torch

    return "cuda" if torch.cuda.is_available() else "cpu"


def preprocessor(folder: Path) -> dict[str, Any]:
    """What a model's `preprocessor_config.json` says of its images; empty without one that can be read."""
    try:
        made = json.loads((folder / "preprocessor_config.json").read_text())
    except (OSError, ValueError, RecursionError):
        return {}
    return made if isinstance(made, dict) else {}


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
