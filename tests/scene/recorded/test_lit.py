"""Cast shadows that wander are told from the pattern that they fall on."""

from collections.abc import Callable

import numpy as np
import pytest
from analytic import TABLE, scene, seen_by
from jaxtyping import Float32, UInt8

from rpaug import Scene
from rpaug.operators.table_texture import TableTexture
from rpaug.pipeline.contracts import shown
from rpaug.scene.recorded import lit
from rpaug.scene.targets.targets import Target

EYE = {"front": (1.6, 0.3, 1.0)}
LENGTH = 12
FAINT = 0.8  # a shadow within the contrast of the pattern


def light(t: int, shape: tuple[int, ...]) -> Float32[np.ndarray, "h w"]:
    """A band of shadow that wanders over the image, its own width a frame."""
    out = np.ones(shape, np.float32)
    width = shape[1] // LENGTH
    out[:, t * width : (t + 1) * width] = FAINT
    return out


def striped(falls: Callable[[int, tuple[int, ...]], np.ndarray]) -> Scene:
    """A table of stripes, under this light."""

    def paint(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        stripes = np.where(np.arange(ids.shape[0])[:, None] // 3 % 2, 0.5, 0.9) * np.ones(ids.shape)
        gray = (200 * stripes * falls(t, ids.shape)).round()[..., None].repeat(3, 2)
        return np.where((ids == TABLE)[..., None], gray, rgb).astype(np.uint8), depth, ids

    return seen_by(scene(EYE, length=LENGTH), paint)


def textured(recorded: Scene, t: int) -> UInt8[np.ndarray, "h w 3"]:
    operator = TableTexture(target=Target(handle=TABLE), texture="gray", albedo=(0.7, 0.7, 0.7))
    edit = operator.sample(recorded, np.random.default_rng(0))
    return shown(operator.apply(recorded, edit)).views["front"].rgb(t)


@pytest.mark.parametrize("t", [3, 7])
def test_a_faint_shadow_that_wanders_stays_under_a_new_texture(t: int) -> None:
    dark = striped(light)
    ids = dark.episode.views["front"].ids
    assert ids is not None
    pixels = ids(t) == TABLE
    after = textured(dark, t).max(2)[pixels].astype(float)
    fell = light(t, pixels.shape)[pixels] < 1
    assert np.median(after[fell]) / np.median(after[~fell]) == pytest.approx(FAINT, abs=0.05)


def test_what_stands_still_counts_as_lit_and_a_camera_that_moves_tells_nothing() -> None:
    still = striped(lambda _, shape: light(4, shape))
    told = lit.share(still.episode, "front", still.moving, 5)
    assert told is not None
    assert told.min() == 1
    moved = scene(EYE, length=LENGTH, moving="front")
    assert lit.share(moved.episode, "front", moved.moving, 0) is None


def test_what_moves_is_not_compared_with_itself_elsewhere() -> None:
    """Pixels of a thing that moves show other places of it at other times."""
    recorded = striped(light)
    ids = recorded.episode.views["front"].ids
    assert ids is not None
    told = lit.share(recorded.episode, "front", frozenset([TABLE]), 5)
    assert told is not None
    assert (told[ids(5) == TABLE] == 1).all()
