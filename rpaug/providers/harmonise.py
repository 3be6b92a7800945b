"""Whether a pasted thing suits its picture: libcom's networks, from a folder of their weights that you name."""

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8

from rpaug.core.errors import BadInput, RpaugError, Unsupported

SCENE, LIBCOM = "scene", "libcom:"
MODEL = "PCTNet"  # Guerreiro et al. 2023 (arXiv 2305.15265), in bcmi/libcom

Harmonise = Callable[[np.ndarray, np.ndarray], np.ndarray]


def check(method: str) -> None:
    """Raises RpaugError unless it is `scene`, or `libcom:FOLDER` with a folder that is there."""
    if method == SCENE:
        return
    if not method.startswith(LIBCOM):
        raise RpaugError(f"no harmoniser is called {method!r}; there are: {SCENE}, {LIBCOM}FOLDER")
    if not Path(method.removeprefix(LIBCOM)).is_dir():
        raise BadInput(
            method.removeprefix(LIBCOM), "weights", found="nothing", expected="a folder of libcom's weights"
        )  # fmt: skip


def ready(method: str) -> None:
    """Raises RpaugError if the method cannot be used here, saying what to install or set."""
    check(method)
    if method != SCENE:
        _network(method.removeprefix(LIBCOM))


def harmonised(
    method: str, picture: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture with what the mask marks in colors that suit the rest. Raises RpaugError."""
    network = _network(method.removeprefix(LIBCOM))
    # libcom takes OpenCV's order of channels and masks of 0 and 255.
    made = network(np.ascontiguousarray(picture[..., ::-1]), mask.astype(np.uint8) * 255)
    made = np.asarray(made)
    if made.shape != picture.shape:
        raise Unsupported(f"libcom: made an image of shape {made.shape} of one of {picture.shape}")
    return np.where(mask[..., None], made[..., ::-1], picture).astype(np.uint8)


@lru_cache(1)
def _network(folder: str) -> Harmonise:
    os.environ["LIBCOM_MODEL_DIR"] = str(Path(folder).resolve())  # where it looks for weights
    try:
        from libcom import ImageHarmonizationModel
    except ImportError:
        raise Unsupported(
            f"libcom is not installed: `pip install libcom` brings it, and {LIBCOM}FOLDER names its weights "
            f"({MODEL}.pth of Libcom_pretrained_models)"
        ) from None
    try:
        return ImageHarmonizationModel(device="cpu", model_type=MODEL)
    except Exception as error:  # whatever its loaders raise
        raise Unsupported(f"{folder}: libcom cannot load {MODEL} from there: {error}") from None
