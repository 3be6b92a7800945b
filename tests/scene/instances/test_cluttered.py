"""Surroundings of many colors: nothing tells what stands there from support and surroundings."""

from dataclasses import replace

import numpy as np
import pytest
from rgb_only_tables import FLOOR, SIZE, episode

from rpaug.core.errors import TargetError
from rpaug.core.types import Episode
from rpaug.scene.build import build
from rpaug.scene.instances import rgb_things
from rpaug.scene.placement import placing
from rpaug.scene.targets import settled
from rpaug.scene.targets.targets import BACKGROUND, TABLE, find

DULL = ((40, 42, 48), (75, 70, 62), (160, 155, 150), (205, 203, 200), (120, 118, 140), FLOOR)


def cluttered() -> Episode:
    """The drawn table before stripes of six dull colors, as wide as each other."""
    plain = episode()
    view = plain.views["image_0"]

    def shown(t: int) -> np.ndarray:
        out = view.rgb(t).copy()
        floor = np.linalg.norm(out.astype(float) - FLOOR, axis=-1) < 20
        stripe = np.arange(SIZE) * len(DULL) // SIZE
        out[floor] = np.broadcast_to(np.array(DULL, np.uint8)[stripe][:, None], out.shape)[floor]
        return out

    return replace(plain, views={"image_0": replace(view, rgb=shown)})


def test_surroundings_of_one_color_are_plain() -> None:
    assert rgb_things.find(episode()).plainness == 1.0


def test_among_many_colors_neither_table_nor_background_is_a_target() -> None:
    scene = build(cluttered(), with_bodies=True)
    for target in (TABLE, BACKGROUND):
        with pytest.raises(TargetError, match="walls and a floor of few colors"):
            find(scene, target)
    with pytest.raises(TargetError, match=r"color alone does not tell the table.*nowhere to put"):
        placing.find_free_space(scene)


def test_a_person_may_settle_the_table_there() -> None:
    scene = build(cluttered(), with_bodies=True)
    (support,) = scene.beliefs["table"].instance_ids
    told, wrong = settled.settle(scene, {"table": settled.SettledRole(handle=support)})
    assert not wrong
    assert find(told, TABLE) == {support}
