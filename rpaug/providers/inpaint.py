"""Paint the part of an image that nobody saw: OpenCV's ways, a package's, or a LaMa network from a TorchScript file."""

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from rpaug.core import pixels, registry
from rpaug.core.errors import BadInput, RpaugError

LAMA = "lama:"
LAMA_STEP = 8  # pixels: the network's strides need sides that are multiples of this

Paint = Callable[[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]], UInt8[np.ndarray, "h w 3"]]


def check(method: str) -> None:
    """Raises RpaugError unless the method is one that `paint` knows, its file there."""
    if method.startswith(LAMA):
        if not Path(method.removeprefix(LAMA)).is_file():
            raise BadInput(
                method.removeprefix(LAMA), "weights", found="nothing", expected="a TorchScript file"
            )
    elif method not in (*METHODS, *registry.painters()):
        known = ", ".join((*METHODS, *registry.painters(), f"{LAMA}FILE"))
        raise RpaugError(f"no inpainting is called {method!r}; there are: {known}")


def paint(
    method: str, rgb: UInt8[np.ndarray, "h w 3"], hole: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The image with its hole painted and every other pixel as it was.

    `fsr` is frequency-selective reconstruction (Genser et al., PCS 2018), `shiftmap` shift-map editing (Pritch et al.,
    ICCV 2009), `telea` fast marching (Telea 2004), `smooth` push-pull (Gortler et al., SIGGRAPH 1996, section 4.2),
    `lama:FILE` a traced LaMa (Suvorov et al., WACV 2022); packages add theirs under `rpaug.inpaint`. Raises RpaugError.
    """
    check(method)
    if not hole.any() or hole.all():
        return rgb
    painted = _way(method)(rgb, hole)
    if painted.shape != rgb.shape or painted.dtype != np.uint8:
        found = f"{painted.dtype} {painted.shape}"
        raise RpaugError(f"inpaint {method}: gave {found}; expected uint8 {rgb.shape}")
    return np.where(hole[..., None], painted, rgb)


def _way(method: str) -> Paint:
    if method.startswith(LAMA):
        return partial(_lama, path=method.removeprefix(LAMA))
    return METHODS[method] if method in METHODS else registry.painter(method)


def _fsr(
    rgb: UInt8[np.ndarray, "h w 3"], hole: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    return _photo(rgb, hole, cv2.xphoto.INPAINT_FSR_BEST)


def _shiftmap(
    rgb: UInt8[np.ndarray, "h w 3"], hole: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """Copies patches by their differences, which OpenCV asks to be taken in CIELAB."""
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2Lab)
    return cv2.cvtColor(_photo(lab, hole, cv2.xphoto.INPAINT_SHIFTMAP), cv2.COLOR_Lab2RGB)


def _photo(image: np.ndarray, hole: np.ndarray, kind: int) -> np.ndarray:
    known = np.where(hole, 0, 255).astype(np.uint8)
    out = np.zeros_like(image)
    cv2.xphoto.inpaint(np.ascontiguousarray(image), known, out, kind)
    return out


def _telea(
    rgb: UInt8[np.ndarray, "h w 3"], hole: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    return cv2.inpaint(np.ascontiguousarray(rgb), hole.astype(np.uint8), 3, cv2.INPAINT_TELEA)


def _smooth(
    rgb: UInt8[np.ndarray, "h w 3"], hole: Bool[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    painted = pixels.smoothed(rgb.astype(np.float32), ~hole)
    return np.rint(np.clip(painted, 0, 255)).astype(np.uint8)


METHODS: Mapping[str, Paint] = {
    "fsr": _fsr,
    "shiftmap": _shiftmap,
    "smooth": _smooth,
    "telea": _telea,
}


def _lama(
    rgb: UInt8[np.ndarray, "h w 3"], hole: Bool[np.ndarray, "h w"], path: str
) -> UInt8[np.ndarray, "h w 3"]:
    """The traced network takes an image in 0..1 and a mask of 0 and 1, and gives an image in 0..1."""
    import torch  # only here: it takes a second to load

    height, width = hole.shape
    pad = ((0, -height % LAMA_STEP), (0, -width % LAMA_STEP))
    image = np.pad(rgb, (*pad, (0, 0)), mode="edge").transpose(2, 0, 1)[None] / np.float32(255)
    mask = np.pad(hole, pad)[None, None].astype(np.float32)
    with torch.inference_mode():
        out = _network(path)(torch.from_numpy(image), torch.from_numpy(mask))
    painted = out[0].permute(1, 2, 0).numpy()[:height, :width]
    return np.rint(np.clip(painted, 0, 1) * 255).astype(np.uint8)


@lru_cache(1)
def _network(path: str):
    import torch

    try:
        return torch.jit.load(path, map_location="cpu").eval()
    except RuntimeError as error:
        line = str(error).strip().splitlines()[0]
        raise BadInput(path, "weights", found=line, expected="a TorchScript LaMa") from None
