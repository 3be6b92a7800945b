"""What no tint of its own tells: a small thing that the instruction names, and one of its surroundings' colors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rgb_only_tables import BLOCK, PLATE, episode, image

from rpaug.core.errors import TargetError
from rpaug.core.types import Episode, Scene
from rpaug.scene.build import build
from rpaug.scene.instances.grouping import MOVING
from rpaug.scene.targets.targets import Target, find

LENGTH = 12
DOT = (slice(31, 33), slice(30, 34))
WAY = (slice(44, 54), slice(26, 40))


def drawn(words: str, paint: Callable[[np.ndarray, int], None]) -> Episode:
    def frame(t: int) -> np.ndarray:
        out = image(t)
        paint(out, t)
        return out

    frames = [frame(t) for t in range(LENGTH)]
    bare = episode(LENGTH)
    view = replace(bare.views["image_0"], rgb=frames.__getitem__)
    return replace(bare, views={"image_0": view}, descriptions=(words,))


def dotted(words: str) -> Scene:
    def paint(out: np.ndarray, t: int) -> None:
        out[DOT] = BLOCK

    return build(drawn(words, paint), with_bodies=True)


def slid() -> Scene:
    """A drawer of the plate's color comes out of it from the sixth frame on."""

    def paint(out: np.ndarray, t: int) -> None:
        out[44:54, 40 - 2 * max(0, t - 4) : 40] = PLATE

    return build(drawn("open it", paint), with_bodies=True)


def test_a_named_color_makes_a_few_pixels_a_thing() -> None:
    scene = dotted("push the red button")
    ids = scene.episode.views["image_0"].ids(0)
    (instance_id,) = scene.roles["manipulated"]
    assert (ids[DOT] == instance_id).all()
    assert (ids == instance_id).sum() == 8
    assert find(scene, Target(role="manipulated")) == {instance_id}


@pytest.mark.parametrize("words", ["push the button", "push the blue button"])
def test_a_color_that_is_not_named_makes_none(words: str) -> None:
    assert "manipulated" not in dotted(words).roles


def test_of_several_none_is_guessed() -> None:
    def paint(out: np.ndarray, t: int) -> None:
        out[DOT] = BLOCK
        out[56:58, 30:34] = BLOCK

    scene = build(drawn("push the red button", paint), with_bodies=True)
    assert "manipulated" not in scene.roles


def test_what_has_its_surroundings_colors_is_refused_with_the_reason() -> None:
    scene = slid()
    with pytest.raises(TargetError, match="what was moved has its surroundings' colors"):
        find(scene, Target(role="manipulated"))
    last = scene.episode.views["image_0"].ids(LENGTH - 1)[WAY]
    assert (last == MOVING).mean() > 0.6
