"""The user's own images: found, checked, decoded."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rpaug import BadInput
from rpaug.assets.textures import folder
from rpaug.core.files import encode_png


@pytest.fixture
def images(tmp_path: Path) -> Path:
    ramp = np.linspace(0, 255, 48).astype(np.uint8).reshape(4, 4, 3)
    (tmp_path / "a.png").write_bytes(encode_png(ramp))
    (tmp_path / "b.jpg").write_bytes(cv2.imencode(".jpg", np.full((16, 8, 3), 90, np.uint8))[1])
    (tmp_path / "grey.png").write_bytes(encode_png(np.full((3, 3), 7, np.uint8)))
    (tmp_path / "notes.txt").write_text("not an image")
    return tmp_path


def test_images_are_found_and_decoded(images: Path) -> None:
    assert folder.names(images) == ["a.png", "b.jpg", "grey.png"]
    assert folder.image(images, "a.png").shape == (4, 4, 3)
    assert np.abs(folder.image(images, "b.jpg").astype(int) - 90).max() <= 2
    assert folder.image(images, "b.jpg").shape == (16, 8, 3)
    assert (folder.image(images, "grey.png") == 7).all()
    assert folder.digest(images, "a.png") != folder.digest(images, "b.jpg")


def test_what_is_elsewhere_or_damaged_is_refused(images: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"one of: a\.png"):
        folder.image(images, "../a.png")
    whole = (images / "b.jpg").read_bytes()
    (images / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInput, match="end marker"):
        folder.image(images, "cut.jpg")
    huge = bytearray(whole)
    at = whole.index(b"\xff\xc0")
    huge[at + 5 : at + 9] = b"\xff\xff\xff\xff"
    (images / "huge.jpg").write_bytes(bytes(huge))
    with pytest.raises(BadInput, match="65535"):
        folder.image(images, "huge.jpg")
    (images / "fake.png").write_bytes(b"GIF89a")
    with pytest.raises(BadInput, match="PNG"):
        folder.image(images, "fake.png")


def test_a_folder_without_images_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no image"):
        folder.names(tmp_path)
    with pytest.raises(BadInput, match="no such folder"):
        folder.names(tmp_path / "missing")
