"""Encoded images of an episode, one a step: looked at before they are believed, decoded when asked for, encoded anew.

`blobs` are the images of one camera; `place(t)` says where in the dataset each lies.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from rpaug_adapters.shared.held import HeldImages

from rpaug import BadInput, CameraView, files

CAMERA_BYTES = 24 << 20  # of decoded images that are held
JPEG = b"\xff\xd8"
Place = Callable[[int], str]
Frame = Callable[[int], np.ndarray]


def image_size(blobs: Sequence[bytes], place: Place) -> tuple[int, int]:
    """Width and height that all images of a camera share; there is at least one. Raises BadInput."""
    sizes = [files.check_image(place(t), data) for t, data in enumerate(blobs)]
    odd = next((t for t, one in enumerate(sizes) if one != sizes[0]), None)
    if odd is not None:
        found, first = ("{}x{}".format(*sizes[t]) for t in (odd, 0))
        raise BadInput(place(odd), "size", found=found, expected=f"{first} as in the first")
    return sizes[0]


def lazy_colors(
    blobs: Sequence[bytes], place: Place
) -> Callable[[int], UInt8[np.ndarray, "h w 3"]]:
    """A camera's images as they are asked for, grey ones with three equal channels."""

    return HeldImages(CAMERA_BYTES).of(
        lambda t: three_channels(files.decode_image(place(t), blobs[t]))
    )


def three_channels(image: UInt8[np.ndarray, "h w ..."]) -> UInt8[np.ndarray, "h w 3"]:
    """Color as it is, and gray with three equal channels."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, 2)


def luma(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w"]:
    """Gray of a color image (ITU-R BT.601); gray that has three equal channels stays as it is."""
    return cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)


def lazy_depth(stored: Frame, unit: float) -> Callable[[int], Float32[np.ndarray, "h w"]]:
    """Depth in metres, 0 where the sensor saw nothing; `unit` is metres of one that is stored."""

    return lambda t: np.nan_to_num(
        np.asarray(stored(t)).astype(np.float32) * np.float32(unit), posinf=0, neginf=0
    )


def reencoded(blobs: Sequence[bytes], view: CameraView, before: CameraView) -> list[bytes]:
    """A camera's images with those that changed encoded anew, as they were encoded: gray ones gray."""
    images = list(blobs)
    for t, data in enumerate(blobs):
        image = view.rgb(t)
        if not np.array_equal(image, before.rgb(t)):
            images[t] = _like_jpeg(image, data) if data[:2] == JPEG else _like_png(image, data)
    return images


def _like_jpeg(image: UInt8[np.ndarray, "h w 3"], data: bytes) -> bytes:
    gray = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return files.encode_jpeg(luma(image)[..., None] if gray.ndim == 2 else image)


def _like_png(image: UInt8[np.ndarray, "h w 3"], data: bytes) -> bytes:
    """A PNG with the channels of the recorded one: transparency stays as it was."""
    whole = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if whole.ndim == 2:
        return files.encode_png(luma(image))
    if whole.shape[2] == 4:
        whole[..., :3] = image[..., ::-1]
        return cv2.imencode(".png", whole)[1].tobytes()
    return files.encode_png(image)
