"""A page's frame, and its pictures: everything is inside the one file."""

import base64
import html
from collections.abc import Iterable, Mapping
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Int32, UInt8

from rpaug.core.files import encode_png
from rpaug.core.pixels import grown
from rpaug.core.visible import visible

FOLDER = Path(__file__).parent
QUALITY = 92  # of JPEG; equal blocks are encoded equally, so what did not change looks so
LOSSLESS = 101  # OpenCV's word for it: qualities of WebP that lose something end at 100
ROLES = {  # display sRGB, apart to the color-blind too (Okabe and Ito 2008)
    "manipulated": (230, 159, 0),
    "receiver": (0, 114, 178),
    "robot": (204, 121, 167),
    "table": (0, 158, 115),
    "background": (86, 180, 233),
}
OTHERS = (
    (213, 94, 0),
    (240, 228, 66),
    (120, 94, 240),
    (0, 200, 200),
    (220, 38, 127),
    (160, 160, 160),
)


def document(title: str, body: str, script: str = "") -> bytes:
    """The page. `body` is HTML; whoever makes it escapes the marks of what came out of files. What cannot be seen is
    spelled out here."""
    style = (FOLDER / "style.css").read_text()
    return visible(
        "<!doctype html><html lang=en><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width,initial-scale=1'>"
        f"<title>{html.escape(title)}</title><style>{style}</style><main>{body}</main>{script}</html>\n"
    ).encode()


def jpeg(image: UInt8[np.ndarray, "h w 3"]) -> str:
    """A photograph as a data URL."""
    settings = [
        cv2.IMWRITE_JPEG_QUALITY,
        QUALITY,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), settings)[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"


def png(image: np.ndarray, level: int = 6) -> str:
    """Exact pixels as a data URL: (h, w) or (h, w, 3) uint8."""
    return f"data:image/png;base64,{base64.b64encode(encode_png(image, level)).decode()}"


def webp(image: np.ndarray) -> str:
    """The same, packed better and in more time: frames beside each other repeat what rests."""
    shown = image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])
    data = cv2.imencode(".webp", shown, [cv2.IMWRITE_WEBP_QUALITY, LOSSLESS])[1].tobytes()
    return f"data:image/webp;base64,{base64.b64encode(data).decode()}"


def figure(source: str, alternative: str, caption: str) -> str:
    """A picture with a line below it."""
    return (
        f"<figure><img alt='{html.escape(alternative, quote=True)}' src='{source}'>"
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def color_of(number: int, role: str) -> tuple[int, int, int]:
    """The outline color of an instance: its role's, else one of a few by its number."""
    return ROLES.get(role) or OTHERS[number % len(OTHERS)]


def outlined(
    image: UInt8[np.ndarray, "h w 3"],
    ids: Int32[np.ndarray, "h w"],
    names: Mapping[int, tuple[str, tuple[int, int, int]]],
    scale: int = 1,
) -> UInt8[np.ndarray, "..."]:
    """The image, `scale` times as large, with the outline and the name of every instance in its color."""
    big = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    labels = np.kron(ids, np.ones((scale, scale), ids.dtype))
    for instance_id, (_, color) in names.items():
        big[_edge(labels == instance_id)] = color
    for instance_id, (name, color) in names.items():
        if name and (where := _middle(labels == instance_id)) is not None:
            _label(big, name, where, color)
    return big


def _edge(inside: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    return inside & grown(~inside, 1)


def _middle(inside: Bool[np.ndarray, "h w"]) -> tuple[int, int] | None:
    """The place farthest from the outline, None for what is too small to be named."""
    if inside.sum() < 12:
        return None
    deep = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 3)
    row, column = np.unravel_index(int(deep.argmax()), deep.shape)
    return int(column) - 1, int(row) - 1


def _label(
    image: UInt8[np.ndarray, "h w 3"], name: str, at: tuple[int, int], color: tuple[int, int, int]
) -> None:
    """Write a name there, kept within the image, on a dark ground in a light tint of its color."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.5
    (width, height), _ = cv2.getTextSize(name, font, size, 1)
    x = int(np.clip(at[0] - width // 2, 1, max(1, image.shape[1] - width - 1)))
    y = int(np.clip(at[1] + height // 2, height + 1, image.shape[0] - 2))
    image[max(0, y - height - 3) : y + 4, max(0, x - 3) : x + width + 3] = 20
    light = tuple((channel + 255) // 2 for channel in color)
    cv2.putText(image, name, (x, y), font, size, light, 1, cv2.LINE_AA)


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """Key facts in a line or two: each with its name."""
    return (
        "<ul class=facts>"
        + "".join(
            f"<li><span class=soft>{html.escape(name)}</span> <b>{html.escape(str(value))}</b>"
            for name, value in pairs
        )
        + "</ul>"
    )
