"""The colors that paint shows in photographs."""

from dataclasses import replace

import numpy as np
import pytest
from rgb_only_tables import episode

from rpaug.core import color_space
from rpaug.core.types import Episode
from rpaug.operators.fields import Palette
from rpaug.operators.recolor import Recolor
from rpaug.scene.build import build
from rpaug.scene.lighting import gamut
from rpaug.scene.targets.targets import Target


def lit(level: tuple[float, float, float]) -> Episode:
    """The drawn table with a white wall, in light of this color."""
    bare = episode()

    def seen(t: int) -> np.ndarray:
        out = bare.views["image_0"].rgb(t).copy()
        out[:8] = 235
        return np.clip(out * np.array(level), 0, 255).astype(np.uint8)

    return replace(bare, views={"image_0": replace(bare.views["image_0"], rgb=seen)})


@pytest.mark.parametrize("word", list(color_space.NAMES))
@pytest.mark.parametrize("level", [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5), (1.0, 0.95, 0.9)])
def test_paint_goes_by_its_name_and_is_no_pure_color(
    word: str, level: tuple[float, float, float]
) -> None:
    pure = color_space.NAMES[word]
    shown = gamut.painted(lit(level), pure)
    names = color_space.nearest(np.array(shown)), word
    assert color_space.means(*names) or color_space.means(*reversed(names))
    if level == (1.0, 1.0, 1.0):
        assert min(shown) > 0.03
        assert max(shown) < 0.95


def test_paint_is_as_bright_as_the_light() -> None:
    bright, dim = (gamut.painted(lit((one,) * 3), (1.0, 0.0, 0.0)) for one in (1.0, 0.8))
    assert max(dim) < max(bright) < 235 / 255


def test_an_exact_color_stays_as_it_is() -> None:
    scene = build(episode(), with_bodies=True)
    pure = (0.0, 0.0, 1.0)
    rng = np.random.default_rng(0)

    def drawn(palette: Palette) -> list[float]:
        target = Target(text="the red block")
        return Recolor(target=target, color=palette).sample(scene, rng)["color"]

    assert drawn(Palette((pure,), exact=True)) == list(pure)
    assert drawn(Palette((pure,))) == list(gamut.painted(scene.episode, pure))
