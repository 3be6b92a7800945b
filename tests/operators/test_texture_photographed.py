"""Textures in color images alone: a support that no proxy knows the shape of keeps the light on it."""

from dataclasses import replace

import numpy as np
import pytest
from rgb_only_tables import SIZE, TABLE, episode, image

import rpaug
from rpaug.core import registry
from rpaug.core.types import Episode
from rpaug.operators.table_texture import TableTexture
from rpaug.pipeline.contracts import shown
from rpaug.scene.build import build
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


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.9, 0.72, 0.54)])
def test_an_image_is_laid_in_the_light_of_the_photograph(light: tuple) -> None:
    """White tiles look as white things there do; of recorded masks images are as they are."""
    bare = episode()
    view = bare.views["image_0"]

    def rgb(t: int) -> np.ndarray:
        out = view.rgb(t).copy()
        out[2:14, 40:62] = 230  # a white wall
        return np.rint(out * light).astype(np.uint8)

    scene = rgb_episode.find(replace(bare, views={"image_0": replace(view, rgb=rgb)})).scene()
    edit = TableTexture(texture="white").sample(scene, np.random.default_rng(0))
    np.testing.assert_allclose(edit["white"], np.minimum(np.array(light) * 230 / 255 / 0.9, 1), atol=0.05)  # fmt: skip
    plain, laid = (
        shown(TableTexture(texture="gray").apply(scene, edit | {"texture": "gray", "white": white}))
        for white in ([1.0, 1.0, 1.0], edit["white"])
    )
    before, after = (one.views["image_0"].rgb(0).astype(float) for one in (plain, laid))
    painted = np.abs(before - scene.episode.views["image_0"].rgb(0)).max(-1) > 20
    assert painted.mean() > 0.2
    ratio = (after / np.maximum(before, 1))[painted]
    np.testing.assert_allclose(np.median(ratio, 0), edit["white"], atol=0.03)


def test_of_recorded_masks_an_image_is_laid_as_it_is() -> None:
    scene = build(registry.read(registry.SAMPLE, None), with_bodies=True)
    assert "white" not in TableTexture(texture="oak").sample(scene, np.random.default_rng(0))
