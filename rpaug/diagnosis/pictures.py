"""Key frames as a vision model is shown them, and as a report embeds them."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core.files import encode_png
from rpaug.diagnosis.evaluation import Rollout
from rpaug.diagnosis.reference import Reference

SIDE = 512  # pixels, of the longer side of what a model is shown
MOST = 6  # pictures in one question


def camera_of(rollout: Rollout, reference: Reference | None) -> str:
    """The camera that shows the rollout best: one that the recordings have too, if there is any."""
    shared = [name for name in (reference.plates if reference else ()) if name in rollout.shots]
    return (shared or sorted(rollout.shots))[0]


def embedded(image: UInt8[np.ndarray, "h w 3"]) -> str:
    """The picture as a data URL."""
    h, w = image.shape[:2]
    scale = SIDE / max(h, w)
    if scale < 1:
        size = (max(1, round(w * scale)), max(1, round(h * scale)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return f"data:image/png;base64,{base64.b64encode(encode_png(image)).decode()}"


def gallery(
    rollout: Rollout, frames: Sequence[int], reference: Reference | None
) -> list[tuple[str, UInt8[np.ndarray, "h w 3"]]]:
    """What each picture is, and the picture: how a recording begins, then the rollout's moments."""
    camera = camera_of(rollout, reference)
    out = []
    usual = {} if reference is None else reference.of(rollout.instruction)
    if camera in usual:
        out.append(("training recording", usual[camera].firsts[0].image))
    shots = rollout.shots[camera]
    out += [(f"attempt, frame {t}", shots[t].image()) for t in frames if t in shots]
    return out[:MOST]


def parts(
    question: str, pictures: Sequence[tuple[str, UInt8[np.ndarray, "h w 3"]]]
) -> list[Mapping[str, Any]]:
    """A question with its pictures, in the form of OpenAI's chat completions."""
    images = [{"type": "image_url", "image_url": {"url": embedded(image)}} for _, image in pictures]
    return [{"type": "text", "text": question}, *images]
