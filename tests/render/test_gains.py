"""Colors of one image brought to another's, thing by thing."""

from dataclasses import replace

import numpy as np
from analytic import BOX, TABLE, look, pinhole, shoot

from rpaug.render.gains import DARKEST, STRONGEST, matched
from rpaug.render.zbuffer import Source, lift, render


def seen(eye, factors=(1.0, 1.0)) -> Source:
    """A view whose table and box are brighter by these factors."""
    K, pose = pinhole(), look(eye, (0.0, 0.0, 0.1))
    rgb, depth, ids = shoot(K, pose, 96, 80)
    scale = np.select([ids == TABLE, ids == BOX], factors, 1.0)[..., None]
    rgb = np.clip(rgb * scale, 0, 255).astype(np.uint8)
    return lift(Source(K=K, cam_to_world=pose, rgb=rgb, depth=depth, ids=ids))


def gains(source):
    return dict(zip(source.gains.instance_ids.tolist(), source.gains.factors, strict=True))


def test_each_thing_has_its_own_factor():
    one, other = seen((0.0, -0.8, 0.7)), seen((0.25, -0.75, 0.75), factors=(0.8, 1.2))
    found = gains(matched(other, one, 0.006))
    np.testing.assert_allclose(found[TABLE], 1 / 0.8, rtol=0.03)
    np.testing.assert_allclose(found[BOX], 1 / 1.2, rtol=0.03)


def test_factors_are_bounded():
    one, other = seen((0.0, -0.8, 0.7)), seen((0.25, -0.75, 0.75), factors=(0.3, 1.0))
    found = gains(matched(other, one, 0.006))
    np.testing.assert_allclose(found[TABLE], STRONGEST)


def test_what_is_not_shared_stays():
    one = seen((0.0, -0.8, 0.7))
    other = seen((0.25, -0.75, 0.75), factors=(0.8, 1.2))
    apart = lift(replace(other, ids=other.ids + 1000, lifted=None))
    assert not gains(matched(apart, one, 0.006))


def test_drawn_colors_take_on_the_first_ones_light():
    one, other = seen((0.0, -0.8, 0.7)), seen((0.25, -0.75, 0.75), factors=(0.8, 1.2))
    pose = look((0.1, -0.78, 0.72), (0.0, 0.0, 0.1))
    plain, _, ids = shoot(pinhole(), pose, 96, 80)
    for source, most in ((matched(other, one, 0.006), 3), (other, None)):
        drawn = render(pinhole(), pose, (96, 80), [source])
        same = (drawn.ids == ids) & (ids > 0)
        off = np.median(np.abs(drawn.image.astype(int) - plain)[same])
        assert off <= most if most else off > 10


def test_several_that_show_a_place_are_averaged_where_the_first_does_not():
    """The first keeps its own colors; elsewhere three of four greys are averaged, in order of trust."""
    K, pose = pinhole(16, 12), np.eye(4)

    def wall(grey, use=None):
        return Source(
            K=K, cam_to_world=pose, rgb=np.full((12, 16, 3), grey, np.uint8),
            depth=np.ones((12, 16), np.float32), ids=np.ones((12, 16), np.int32), use=use,
        )  # fmt: skip

    left = np.zeros((12, 16), bool)
    left[:, :8] = True
    drawn = render(K, pose, (16, 12), [wall(10, left), wall(60), wall(90), wall(120), wall(255)])
    assert (drawn.image[:, :8] == 10).all()
    assert (drawn.image[:, 8:] == 90).all()


def test_factors_are_medians_of_what_both_show():
    """Twenty things, two of one instance id far apart, of two images from one place."""
    rng = np.random.default_rng(0)
    K, pose = pinhole(40, 40), np.eye(4)
    ids = (np.arange(40) // 2 % 19)[None].repeat(40, 0).astype(np.int32)
    wall = Source(K=K, cam_to_world=pose, rgb=rng.integers(0, 256, (40, 40, 3), np.uint8),
                  depth=np.ones((40, 40), np.float32), ids=ids)  # fmt: skip
    like = replace(wall, rgb=rng.integers(0, 256, (40, 40, 3), np.uint8))
    found = gains(matched(lift(wall), lift(like), 0.006))
    assert sorted(found) == list(range(19))
    here, there = (one.rgb[::2, ::2].astype(float) for one in (wall, like))
    told = (here >= DARKEST) & (there >= DARKEST)
    for thing in range(19):
        shown = ids[::2, ::2] == thing
        ratios = [(there / np.maximum(here, 1))[..., c][shown & told[..., c]] for c in range(3)]
        middle = np.clip(
            [np.median(each.astype(np.float32)) for each in ratios], 1 / STRONGEST, STRONGEST
        )
        np.testing.assert_allclose(found[thing], middle, rtol=1e-6)
