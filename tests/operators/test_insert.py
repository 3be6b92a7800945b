"""Inserted things stand on the table, apart from all others, hidden by what is nearer; the rest stays bit for bit."""

import numpy as np
import pytest
from tabletop import instance_id, scene, take

from rpaug.assets import library
from rpaug.compose import inserted
from rpaug.core import color_space
from rpaug.core.errors import BadRecipe, TargetError, Unsupported
from rpaug.operators.distractors import Distractors
from rpaug.operators.insert import Insert
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.placement import free_space
from rpaug.scene.targets.targets import Target
from rpaug.twin import tabletop

pytestmark = pytest.mark.gl


class TestInsert(OperatorContract):
    def operator(self):
        return Insert(asset="mug_red")

    def scene(self):
        return scene()


class TestDistractors(OperatorContract):
    def operator(self):
        return Distractors(count=3)

    def scene(self):
        return scene()


@pytest.fixture(scope="module")
def edited():
    operator = Distractors(count=4)
    return operator.apply(scene(), operator.sample(scene(), np.random.default_rng(2)))


def test_everything_else_stays_bit_for_bit(edited):
    new = [instance_id for body in inserted.bodies(edited) for instance_id in body.instance_ids]
    after = shown(edited)
    for name, view in after.views.items():
        before = scene().episode.views[name]
        for t in (0, 8):
            rest = ~np.isin(view.ids(t), new)
            np.testing.assert_array_equal(view.rgb(t)[rest], before.rgb(t)[rest])
            np.testing.assert_array_equal(view.depth(t)[rest], before.depth(t)[rest])
            np.testing.assert_array_equal(view.ids(t)[rest], before.ids(t)[rest])
            assert (view.depth(t)[~rest] < before.depth(t)[~rest]).all()


def test_they_stand_on_the_table_and_keep_their_distance(edited):
    middles = []
    for body in inserted.bodies(edited):
        points = body.mesh.points @ body.to_world[0, :3, :3].T + body.to_world[0, :3, 3]
        assert points[:, 2].min() == pytest.approx(tabletop.TABLE, abs=0.002)
        middles.append((points[:, :2].min(0) + points[:, :2].max(0)) / 2)
    others = [
        pose[0, :2, 3] for name, pose in take().poses.items() if name not in ("cabinet", "drawer")
    ]
    for k, middle in enumerate(middles):
        for other in (*middles[:k], *others):
            assert np.linalg.norm(middle - other) > free_space.MARGIN + 0.02


def test_the_light_falls_from_above(edited):
    light = np.array(edited.ambience.light)
    faces = np.array([[0, 0, 1], [0, 0, -1]], np.float32)
    up, down = inserted.irradiance.shading(inserted.irradiance.basis(faces), light)
    assert 0.85 < up <= 1.01
    assert down < 0.8 * up


def test_a_place_may_be_given_and_must_be_free():
    pad = take().poses["pad"][0, :2, 3]
    with pytest.raises(Unsupported, match="there is no room at"):
        Insert(asset="die", at=tuple(pad)).sample(scene(), np.random.default_rng(0))


def test_a_query_draws_only_what_fits():
    rng = np.random.default_rng(0)
    drawn = {Insert(category="mug").sample(scene(), rng)["things"][0]["asset"] for _ in range(3)}
    assert drawn <= {"mug_red", "mug_blue"}
    with pytest.raises(TargetError, match="no asset is called 'piano'"):
        Insert(asset="piano").sample(scene(), rng)


def test_what_the_library_lacks_in_a_color_or_size_is_painted_or_scaled():
    rng = np.random.default_rng(0)
    wish = Insert(category="mug", color="purple", size=(0.05, 0.06))
    edit = wish.sample(scene(), rng)
    (thing,) = edit["things"]
    assert color_space.nearest(np.array(thing["color"])) == "purple"
    assert 0.05 <= thing["scale"] * library.get(thing["asset"]).largest <= 0.06 + 1e-9
    assert wish.says(edit)[0].color == "purple"
    for color in ("red", "blue"):  # what there is in that color is taken as it is
        assert "color" not in Insert(category="mug", color=color).sample(scene(), rng)["things"][0]
    for unknown in ({"category": "piano"}, {"category": "mug", "color": "plaid"}):
        with pytest.raises(TargetError):
            Insert(**unknown).sample(scene(), rng)


def test_a_thing_can_be_painted_after_it_was_inserted(edited):
    assert library.get("mug_red").color in ("red", "maroon", "crimson")
    new = [instance_id for body in inserted.bodies(edited) for instance_id in body.instance_ids]
    assert edited.instance_ids >= set(new)


def test_a_thing_stands_near_another():
    pad = take().poses["pad"][0, :2, 3]
    wish = Insert(asset="die", near=Target(handle=instance_id("pad")), within=0.1)
    spots = [
        np.array(wish.sample(scene(), np.random.default_rng(k))["things"][0]["pose"])[:2, 3]
        for k in range(4)
    ]
    assert max(np.linalg.norm(spot - pad) for spot in spots) < 0.3
    assert min(np.linalg.norm(spot - pad) for spot in spots) > 0.05
    with pytest.raises(BadRecipe, match="not both"):
        Insert(asset="die", at=(0, 0), near=Target(handle=1))
