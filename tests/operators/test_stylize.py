"""Stylising: the contract, what stays bit for bit, what two cameras agree on, and what is refused."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import vgg
from analytic import BOX
from pydantic import TypeAdapter, ValidationError
from styled import stripes, with_gaussians

from rpaug.core import geometry
from rpaug.core.errors import BadInput, Unsupported
from rpaug.core.files import encode_png
from rpaug.core.types import Scene
from rpaug.operators.stylize import Stylize
from rpaug.pipeline import plan, prepare, recipe
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.providers import features


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights and a style picture."""
    made = tmp_path_factory.mktemp("style")
    vgg.saved(made)
    (made / "stripes.png").write_bytes(encode_png(stripes()))
    return made


def stylize(folder: Path, **given: object) -> Stylize:
    fields = {
        "target": {"handle": BOX}, "style": "stripes.png", "textures": str(folder), "steps": 10,
        "weights": str(folder / "vgg16.pth"), **given,
    }  # fmt: skip
    return TypeAdapter(Stylize).validate_python(fields)


@cache
def recorded() -> Scene:
    return with_gaussians()


class TestContract(OperatorContract):
    @pytest.fixture(autouse=True)
    def _folder(self, folder: Path) -> None:
        self.folder = folder

    def operator(self) -> Stylize:
        return stylize(self.folder, steps=2)

    def scene(self) -> Scene:
        return recorded()


@pytest.fixture(scope="module")
def styled(folder: Path) -> Scene:
    operator = stylize(folder)
    return operator.apply(recorded(), operator.sample(recorded(), np.random.default_rng(0)))


def test_outside_the_target_every_pixel_stays(styled):
    after = shown(styled)
    for name, view in recorded().episode.views.items():
        changed = (after.views[name].rgb(1) != view.rgb(1)).any(-1)
        assert not changed[view.ids(1) != BOX].any()
        assert changed[view.ids(1) == BOX].mean() > 0.9


def test_one_place_is_of_one_color_in_both_cameras(styled):
    """A point's color beside its old one depends on the place alone: the pattern is the same from both sides."""
    after = shown(styled)
    front, side = (recorded().episode.views[name] for name in ("front", "side"))
    points = geometry.world_points(front.depth(0), front.camera, 0)
    at, _ = geometry.project(points, side.camera, 0)
    column, row = np.rint(np.nan_to_num(at, nan=-1)).astype(int).reshape(-1, 2).T
    inside = (column >= 0) & (column < side.camera.width) & (row >= 0) & (row < side.camera.height)
    flat = points.reshape(-1, 3)
    there = geometry.world_points(side.depth(0), side.camera, 0)
    apart = np.full(len(flat), np.inf)
    apart[inside] = np.linalg.norm(there[row[inside], column[inside]] - flat[inside], axis=-1)
    same = (apart < 0.002) & (front.ids(0).ravel() == BOX)
    assert same.sum() > 20
    mine = after.views["front"].rgb(0).reshape(-1, 3)[same].astype(float)
    other = after.views["side"].rgb(0)[row[same], column[same]].astype(float)
    was = front.rgb(0).reshape(-1, 3)[same].astype(float)
    also = side.rgb(0)[row[same], column[same]].astype(float)
    # Points are up to 2 mm apart, of pixels that are 13 mm wide: the pattern changes by a little over that.
    assert np.median(np.abs(mine - other)) <= np.median(np.abs(was - also)) + 6
    assert np.median(np.abs(mine - was)) > 20  # and it is another color


def test_gaussians_alone_show_it_too(styled):
    flat = shown(styled, tier=3).views["front"].rgb(0).astype(float)
    fixed = shown(styled).views["front"].rgb(0).astype(float)
    box = recorded().episode.views["front"].ids(0) == BOX
    before = recorded().episode.views["front"].rgb(0)
    near, far = (np.abs(flat - other)[box].mean() for other in (fixed, before))
    assert near < 0.5 * far


def test_it_plans_for_gaussians_and_shows_recorded_pixels(folder):
    made = plan.make([stylize(folder)], recorded().episode)
    assert made.gaussians
    assert made.bodies
    assert set(made.representations.values()) == {0}
    assert set(plan.settle(made, recorded()).representations.values()) == {0}
    assert made.cost(recorded().episode, 1)["seconds"] > plan.SECONDS_FIT


def test_what_is_missing_is_said_before_anything_is_made(folder, tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    with pytest.raises(Unsupported, match="Gaussians"):
        stylize(folder).sample(replace(recorded(), gaussians=None), rng)
    monkeypatch.setattr(features, "default", lambda: tmp_path / "none.pth")
    with pytest.raises(BadInput, match="put https:"):
        stylize(folder, weights=None).ready()
    with pytest.raises(BadInput, match="put https:"):
        stylize(folder, weights=None).sample(recorded(), rng)
    made = {"target": {"handle": BOX}, "style": "paint"}
    steps = recipe.build({"version": 1, "edits": [{"op": "stylize", **made}]})
    with pytest.raises(BadInput, match="put https:"):
        prepare.prepare_scene(recorded().episode, steps, 0)  # before anything is fitted
    with pytest.raises(ValidationError, match="no texture is called"):
        stylize(folder, textures=None, style="nothing")


def test_a_replay_needs_the_weights_and_the_picture_of_the_draw(folder, tmp_path):
    operator = stylize(folder)
    edit = operator.sample(recorded(), np.random.default_rng(0))
    assert edit["weights"] == {
        "origin": "vgg16.pth", "digest": features.load(folder / "vgg16.pth").digest,
    }  # fmt: skip
    other = stylize(folder, weights=str(vgg.saved(tmp_path, seed=1)))
    with pytest.raises(BadInput, match="as this edit was drawn with"):
        other.apply(recorded(), edit)
    (tmp_path / "stripes.png").write_bytes(encode_png(stripes()[::-1, :24]))
    with pytest.raises(BadInput, match="another image"):
        stylize(folder, textures=str(tmp_path)).apply(recorded(), edit)
