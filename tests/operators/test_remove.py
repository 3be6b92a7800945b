"""A removed thing uncovers what others saw; what nobody saw is painted alike for all; what the robot holds stays."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from analytic import BOX, TABLE, scene

from rpaug.core import pixels
from rpaug.core.errors import BadRecipe, TargetError, Unsupported
from rpaug.operators.remove import Remove
from rpaug.pipeline import recipe
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.recorded import surfels
from rpaug.scene.targets.targets import Target

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "back": (-0.2, 0.9, 0.8)}


def recorded():
    return scene(EYES, length=2, ball=False)


class TestRemove(OperatorContract):
    def operator(self):
        return Remove(target=Target(handle=BOX))

    def scene(self):
        return recorded()


@pytest.fixture(scope="module")
def after():
    operator = Remove(target=Target(handle=BOX))
    before = recorded()
    return shown(operator.apply(before, operator.sample(before, np.random.default_rng(0))))


@pytest.mark.parametrize("name", EYES)
def test_the_box_is_gone_and_the_table_lies_where_it_does(after, name):
    view, camera = after.views[name], recorded().cameras[name]
    was = recorded().episode.views[name].ids(0) == BOX
    rows, columns = np.nonzero(was)
    local = np.stack(
        [(columns - camera.K[0, 2]) / camera.K[0, 0], (rows - camera.K[1, 2]) / camera.K[1, 1], np.ones(len(rows))], -1
    )  # fmt: skip
    pose = camera.cam_to_world[0]
    table = -pose[2, 3] / (local @ pose[:3, :3].T)[:, 2]
    spot = pose[:3, 3] + table[:, None] * (local @ pose[:3, :3].T)
    on = (table > 0) & (np.abs(spot[:, :2]) < 0.75).all(1)
    assert not (view.ids(0) == BOX).any()
    assert (view.ids(0)[was][on] == TABLE).mean() > 0.98
    off = np.abs(view.depth(0)[was][on] - table[on])
    assert np.median(off) < 1e-4
    assert np.quantile(off, 0.95) < 2e-3
    np.testing.assert_array_equal(view.rgb(0)[~was], recorded().episode.views[name].rgb(0)[~was])


def test_what_is_painted_is_the_same_place_in_all_views(after):
    """Points of the footprint, which nobody saw, look alike from all sides."""
    x, y = np.meshgrid(np.linspace(-0.06, 0.06, 9), np.linspace(-0.04, 0.04, 7))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], -1)
    seen = []
    for name, camera in recorded().cameras.items():
        local = (points - camera.cam_to_world[0, :3, 3]) @ camera.cam_to_world[0, :3, :3]
        pixel = np.rint((local / local[:, 2:]) @ camera.K.T).astype(int)
        seen.append(after.views[name].rgb(0)[pixel[:, 1], pixel[:, 0]].astype(float))
    assert np.abs(seen[0] - seen[1]).mean() < 8
    assert np.abs(seen[0] - seen[2]).mean() < 8


def test_where_outlines_are_anti_aliased_no_rim_of_the_thing_is_left(after):
    """Pixels beside the box show half of it, as anti-aliasing mixes them."""
    before = recorded()
    box = {name: view.ids(0) == BOX for name, view in before.episode.views.items()}
    beside = {
        name: pixels.grown(box[name], 1) & (view.ids(0) == TABLE)
        for name, view in before.episode.views.items()
    }

    def mixed(name, view):
        half = (view.rgb(0) + view.rgb(0)[box[name]].mean(0)) / 2
        image = np.where(beside[name][..., None], half, view.rgb(0)).astype(np.uint8)
        return replace(view, rgb=lambda t: image)

    views = {name: mixed(name, view) for name, view in before.episode.views.items()}
    smooth = replace(before, episode=replace(before.episode, views=views), antialiased=True)
    operator = Remove(target=Target(handle=BOX))
    made = shown(operator.apply(smooth, operator.sample(smooth, np.random.default_rng(0))))
    for name, rim in beside.items():
        table = after.views[name].rgb(0)[rim].astype(float)
        towards = before.episode.views[name].rgb(0)[box[name]].mean(0) - table
        share = ((made.views[name].rgb(0)[rim] - table) * towards).sum() / (towards**2).sum()
        assert abs(share) < 0.3  # of the box's color; half of it was there, and paint is not exact
        away = ~pixels.grown(box[name], 1)
        np.testing.assert_array_equal(made.views[name].rgb(0)[away], views[name].rgb(0)[away])


def test_what_the_robot_moves_is_refused_with_the_reason():
    held = replace(recorded(), roles={"manipulated": frozenset({BOX}), "table": frozenset({TABLE})})
    with pytest.raises(Unsupported, match="is moved by the robot; the recorded actions"):
        Remove(target=Target(handle=BOX)).sample(held, np.random.default_rng(0))
    with pytest.raises(Unsupported, match="is the table, which carries the rest"):
        Remove(target=Target(handle=TABLE)).sample(held, np.random.default_rng(0))
    with pytest.raises(TargetError, match="no such instance"):
        Remove(target=Target(handle=5)).sample(held, np.random.default_rng(0))


def test_what_touches_the_thing_that_is_moved_is_refused():
    rolling = scene(EYES, length=8)
    held = replace(rolling, roles={"manipulated": frozenset({TABLE})})
    with pytest.raises(Unsupported, match="touched by the robot or by what it moves"):
        Remove(target=Target(handle=BOX)).sample(held, np.random.default_rng(0))


def test_a_network_of_ones_own_paints_what_nobody_saw(tmp_path):
    class Grey(torch.nn.Module):
        def forward(self, image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            return image * (1 - mask) + 0.7 * mask

    path = tmp_path / "lama.pt"
    torch.jit.script(Grey()).save(str(path))
    operator = Remove(target=Target(handle=BOX), inpaint=f"lama:{path}")
    base = recorded()
    after = operator.apply(base, operator.sample(base, np.random.default_rng(0)))
    for patch in surfels.build(after).patches:
        painted = np.unique(patch.rgb[patch.use], axis=0)
        assert len(painted) <= len(np.unique(patch.ids[patch.use]))  # one grey for each surface
    with pytest.raises(BadRecipe, match="TorchScript"):
        recipe.build(
            {
                "version": 1,
                "edits": [{"op": "remove", "target": {"handle": 1}, "inpaint": "lama:no"}],
            }
        )
