"""The user's own images as textures: found by name in a folder, checked before they are decoded."""

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from rpaug.core.errors import BadInput
from rpaug.core.files import decode_image, read_bytes

ENDINGS = frozenset({".png", ".jpg", ".jpeg"})


def names(folder: Path) -> list[str]:
    """Names of the images in a folder, in order. Raises BadInput if there are none."""
    if not folder.is_dir():
        raise BadInput(folder, "textures", found="no such folder", expected="a folder of images")
    found = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not found:
        raise BadInput(
            folder,
            "textures",
            found="no image",
            expected=f"files ending in {', '.join(sorted(ENDINGS))}",
        )
    return found


def digest(folder: Path, name: str) -> str:
    """What tells one content of an image file from another."""
    return hashlib.blake2b(read_bytes(folder / name), digest_size=8).hexdigest()


@lru_cache(8)
def image(folder: Path, name: str) -> UInt8[np.ndarray, "h w 3"]:
    """One of the folder's images. Raises BadInput for what is damaged, too large, or elsewhere."""
    if name not in names(folder):
        raise BadInput(
            folder, "texture", found=repr(name), expected=f"one of: {', '.join(names(folder))}"
        )
    found = decode_image(folder / name)
    return found if found.ndim == 3 else np.repeat(found[..., None], 3, axis=2)
