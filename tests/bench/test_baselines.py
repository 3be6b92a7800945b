"""The baselines do what their names say, and no more."""

from dataclasses import replace

import numpy as np
from analytic import scene

from rpaug.core.types import Episode
from tools.bench.harness import baselines


def episode() -> Episode:
    return scene({"front": (1.6, 0.3, 1.0)}, length=2).episode


def test_lab_paints_the_mask_and_nothing_else():
    recorded = episode()
    view = recorded.views["front"]
    instance_id = int(view.ids(0).max())
    color = (0.2, 0.3, 0.8)
    made = baselines.lab(recorded, {instance_id: ((0.5, 0.5, 0.5), color)}).views["front"]
    mine = view.ids(0) == instance_id
    np.testing.assert_array_equal(made.rgb(0)[~mine], view.rgb(0)[~mine])
    assert (made.rgb(0)[mine] != view.rgb(0)[mine]).any()
    # A pixel that has the old color gets the new one.
    flat = replace(view, rgb=lambda t: np.full_like(view.rgb(t), 128))
    painted = baselines.lab(
        replace(recorded, views={"front": flat}), {instance_id: ((128 / 255,) * 3, color)}
    )
    found = painted.views["front"].rgb(0)[mine]
    assert np.abs(found - 255 * np.array(color)).max() <= 1


def test_lab_of_the_whole_image_turns_white_into_the_new_light():
    recorded = episode()
    view = recorded.views["front"]
    white = replace(view, rgb=lambda t: np.full_like(view.rgb(t), 255))
    light = (0.9, 0.6, 0.3)
    made = baselines.lab(
        replace(recorded, views={"front": white}), {None: ((1.0, 1.0, 1.0), light)}
    )
    assert np.abs(made.views["front"].rgb(1) - 255 * np.array(light)).max() <= 1


def test_jitter_is_one_draw_for_all_images():
    recorded = episode()
    first, again, other = (baselines.jitter(recorded, seed).views["front"] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.rgb(0), again.rgb(0))
    assert (first.rgb(0) != other.rgb(0)).any()
    assert (first.rgb(0) != recorded.views["front"].rgb(0)).any()
    assert first.depth is recorded.views["front"].depth
