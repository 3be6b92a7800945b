"""Images that are held between copies come back as they were decoded."""

import numpy as np
import pytest
from rpaug_adapters.shared.held import KEPT_FRAMES, HeldImages

FRAMES = 3 * KEPT_FRAMES


@pytest.mark.parametrize(
    ("dtype", "most"), [(np.int32, 200), (np.int32, 2**20), (np.float32, 9), (np.uint8, 9)]
)
def test_an_image_is_decoded_for_the_first_copy_alone(dtype: type, most: int) -> None:
    decoded: list[int] = []

    def decode(t: int) -> np.ndarray:
        decoded.append(t)
        return np.full((2, 3), most * (t % 2) + t, dtype)

    image = HeldImages().of(decode)
    for _ in range(4):  # reading, building, and two copies
        for t in range(FRAMES):
            found = image(t)
            assert found.dtype == dtype
            assert (found == np.full((2, 3), most * (t % 2) + t, dtype)).all()
    assert len(decoded) == 2 * FRAMES


def test_what_is_asked_for_once_is_not_held_and_no_more_than_fits_is() -> None:
    decoded: list[int] = []

    def decode(t: int) -> np.ndarray:
        decoded.append(t)
        return np.zeros(4, np.uint8)

    held = HeldImages(most=4 * 5)
    image = held.of(decode)
    for _ in range(3):
        for t in range(FRAMES):
            image(t)
    assert len(decoded) == 2 * FRAMES + FRAMES - 5
