"""Textures in color images alone: a support that no proxy knows the shape of keeps the light on it."""

from dataclasses import replace

import numpy as np
import pytest
from rgb_only_tables import SIZE, TABLE, episode, image

import rpaug
from rpaug.core.types import Episode
from rpaug.operators.table_texture import TableTexture
from rpaug.scene.instances import ground_plane, rgb_episode

SHADE = 1 - 0.12 * (np.arange(SIZE) // 4 % 3)  # by column: as floor and walls of a basin


def shaded() -> Episode:
    """The drawn table, one tint, under light that changes with the faces of a basin."""
    bare = episode()
    view = bare.views["image_0"]

    def rgb(t: int) -> np.ndarray:
        out = view.rgb(t).astype(float)
        mask = np.abs(image(t, noise=0).astype(int) - TABLE).max(-1) == 0
        return np.rint(np.where(mask[..., None], out * SHADE[:, None], out)).astype(np.uint8)

    return replace(bare, views={"image_0": replace(view, rgb=rgb)})


def test_a_basin_keeps_its_shade_under_a_texture() -> None:
    recorded = shaded()
    wanted = {"version": 1, "edits": [{"op": "table_texture", "texture": "gray", "scale": 0.3}]}
    made = rpaug.augment(recorded, wanted)
    edited, before = made.views["image_0"].rgb(1), recorded.views["image_0"].rgb(1)
    table = np.abs(image(1, noise=0).astype(int) - TABLE).max(-1) == 0
    painted = table & (np.abs(edited.astype(int) - before).max(-1) > 8)
    assert painted[table].mean() > 0.8
    columns = np.flatnonzero(painted.sum(0) > 10)
    light = np.array([edited[painted[:, k], k].mean() for k in columns])
    bright, middle, dark = (light[SHADE[columns] == one].mean() for one in np.unique(SHADE)[::-1])
    assert abs(middle / bright - 0.88) < 0.04
    assert abs(dark / bright - 0.76) < 0.04


class Level:
    """A model of depth that sees the level support that an unplaced camera is taken to look at."""

    relative = False

    def __call__(self, image: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        whole = np.ones(image.shape[:2], bool)
        return ground_plane.of(episode().views["image_0"].camera, whole, ~whole).depth


def striped() -> Episode:
    """The drawn table with fine stripes: a pattern, which no lamp makes."""
    bare = episode()
    view = bare.views["image_0"]

    def rgb(t: int) -> np.ndarray:
        out = view.rgb(t).astype(float)
        mask = np.abs(image(t, noise=0).astype(int) - TABLE).max(-1) == 0
        stripes = 1 - 0.15 * (np.arange(SIZE) // 2 % 2)
        return np.rint(np.where(mask[..., None], out * stripes[:, None], out)).astype(np.uint8)

    return replace(bare, views={"image_0": replace(view, rgb=rgb)})


@pytest.mark.parametrize("model", [None, Level()])
def test_a_models_depth_tells_the_old_pattern_from_the_light(model: Level | None) -> None:
    scene = rgb_episode.find(striped(), model).scene()
    edit = TableTexture(texture="gray").sample(scene, np.random.default_rng(0))
    (surface,) = edit["surfaces"]
    assert (surface["smooth"] is not None) == (model is not None)
