"""Light beyond white: edits that scale it start from what it came to, and end at what the picture allows."""

import numpy as np

from rpaug.core.types import Surface
from rpaug.operators.light_color import Gain
from rpaug.operators.recolor import AlbedoRatio, LabShift
from rpaug.render.composite import composite

ALBEDO, LIGHT = (0.8, 0.8, 0.8), 2.0
RECORDED = np.full((2, 2, 3), 255, np.uint8)
RADIANCE = np.full((2, 2, 3), ALBEDO[0] * LIGHT, np.float32)
IDS = np.ones((2, 2), np.int32)


class Nowhere:
    """Surfaces of which nothing is known."""

    mirrored = None


def edited(*edits: object, radiance: np.ndarray | None = RADIANCE) -> np.ndarray:
    def surfaces(rows: np.ndarray) -> Surface:
        return Nowhere()  # type: ignore[return-value]

    return composite(RECORDED, IDS, edits, False, surfaces, radiance)  # type: ignore[arg-type]


def painted(*rgb: float) -> AlbedoRatio:
    return AlbedoRatio(frozenset([1]), ALBEDO, (rgb[0], rgb[1], rgb[2]), plain=True)


def test_what_was_cut_off_counts() -> None:
    dimmed = edited(Gain((0.25, 0.5, 1.0)))
    assert np.array_equal(dimmed[0, 0], [102, 204, 255])  # of 0.8 under twice the light
    assert np.array_equal(edited(Gain((0.25, 0.5, 1.0)), radiance=None)[0, 0], [64, 128, 255])
    assert np.array_equal(edited(painted(0.1, 0.3, 0.9))[0, 0], [51, 153, 255])


def test_edits_in_a_row_keep_it() -> None:
    row = edited(painted(0.6, 0.6, 0.6), Gain((0.5, 0.5, 0.5)))
    assert np.array_equal(row[0, 0], [153, 153, 153])  # 0.6 under the light of 1


def test_a_picture_gets_no_brighter_than_it_was_seen() -> None:
    seen = np.full((2, 2, 3), 0.5, np.float32)
    pictured = (seen * 255).round().astype(np.uint8)

    def surfaces(rows: np.ndarray) -> Surface:
        return Nowhere()  # type: ignore[return-value]

    edit = Gain((0.9, 0.9, 0.4))
    out = composite(pictured, IDS, [edit], False, surfaces, seen * 2)
    assert np.abs(out[0, 0].astype(int) - [128, 128, 102]).max() <= 1


def test_other_edits_see_what_was_recorded() -> None:
    shift = LabShift(frozenset([1]), ALBEDO, (0.2, 0.3, 0.8))
    assert np.array_equal(edited(shift), edited(shift, radiance=None))


def test_without_headroom_nothing_changes() -> None:
    color = np.full((2, 2, 3), 100, np.uint8)
    known = color.astype(np.float32) / np.float32(255)

    def surfaces(rows: np.ndarray) -> Surface:
        return Nowhere()  # type: ignore[return-value]

    edits = [painted(0.3, 0.2, 0.9), Gain((0.5, 0.7, 0.9))]
    plain = composite(color, IDS, edits, False, surfaces)
    assert np.array_equal(composite(color, IDS, edits, False, surfaces, known), plain)
