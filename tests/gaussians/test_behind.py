"""New Gaussians behind a removed thing: all others stay, and they show what surfels show there."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BOX, TABLE, scene

from rpaug.compose import views
from rpaug.gaussians import fill_gaussians
from rpaug.gaussians.gaussian_view import seen
from rpaug.gaussians.seeds import seeds
from rpaug.operators.remove import Remove
from rpaug.scene.recorded import surfels
from rpaug.scene.targets.targets import Target

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "back": (-0.2, 0.9, 0.8)}


@pytest.fixture(scope="module")
def after():
    recorded = scene(EYES, length=2, ball=False)
    recorded = replace(recorded, gaussians=seeds(recorded))
    operator = Remove(target=Target(handle=BOX))
    return operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0)))


@pytest.fixture(scope="module")
def patched(after):
    return fill_gaussians.patched(after)


def test_only_gaussians_near_the_hole_are_new(after, patched):
    before, now = after.gaussians, patched.scene.gaussians
    # New ones may lie where old ones did, but the fit gave them their own opacities.
    same = {row.tobytes() for row in np.c_[now.means, now.opacities]}
    kept = np.array([row.tobytes() in same for row in np.c_[before.means, before.opacities]])
    assert 0.5 < kept.mean() < 1
    count = int(kept.sum())
    for name in ("means", "quats", "scales", "opacities", "sh", "ids"):
        np.testing.assert_array_equal(getattr(now, name)[:count], getattr(before, name)[kept])
    assert 0 < patched.painted < len(now) - count
    assert (before.ids[~kept] != BOX).all()  # those of the box are left out when it is drawn


@pytest.mark.parametrize("name", EYES)
def test_they_show_what_surfels_show(after, patched, name):
    was = after.episode.views[name].ids(0) == BOX
    true = surfels.view(surfels.build(after), after, name, 0)
    rgb, depth, ids, index = seen(patched.scene, name, 0)
    assert (ids[was] == true.ids[was]).mean() > 0.95
    table = was & (ids == TABLE) & (true.ids == TABLE)
    assert np.median(np.abs(depth - true.depth)[table]) < 2e-3
    off = (rgb[was].astype(float) - true.image[was]) / 255
    assert -10 * np.log10((off**2).mean()) > 28
    assert patched.invented(0, index)[was].mean() > 0.2
    assert patched.invented(0, index)[~was].mean() < 0.05


def test_the_edited_episode_shows_them_and_marks_the_paint(after):
    marked = {}

    def watch(shown):
        marked[shown.camera] = shown.hole

    made = views.edited(after, dict.fromkeys(EYES, 3), watch)
    was = after.episode.views["front"].ids(0) == BOX
    assert not (made.views["front"].ids(0) == BOX).any()
    assert marked["front"][was].any()
    assert (made.views["front"].depth(0)[was] > 0).all()


def test_what_was_not_taken_away_needs_none(after):
    plain = replace(after, recorded_bodies=None)
    assert fill_gaussians.patched(plain).scene is plain
    assert fill_gaussians.patched(replace(after, gaussians=None)).painted == 0
