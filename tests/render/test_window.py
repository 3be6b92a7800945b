"""A piece of a view drawn from the parts that show it is the piece of the whole view."""

import numpy as np
import pytest
from analytic import BOX, scene

from rpaug.render import window, zbuffer
from rpaug.scene.recorded.plates import among, source_at

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "back": (-0.2, 0.9, 0.8)}


@pytest.mark.parametrize("name", EYES)
def test_the_piece_is_that_of_the_whole(name):
    recorded = scene(EYES, length=2, ball=False)
    camera, views = recorded.cameras[name], recorded.episode.views
    every = [
        source_at(views[other], 0, carved=other != name) for other in (name, *(set(EYES) - {name}))
    ]
    gone = views[name].ids(0) == BOX
    piece = window.around(gone, camera.K, camera.cam_to_world[0])

    def drawn(K, size, sources):
        lifted = [zbuffer.lift(source) for source in sources]
        cut = [
            zbuffer.replace(source, use=~among(source.ids, frozenset({BOX}))) for source in lifted
        ]
        return zbuffer.render(K, camera.cam_to_world[0], size, cut, witness=lifted[0])

    whole = drawn(camera.K, (camera.width, camera.height), every)
    parts = [piece.of(every[0]), *filter(None, map(piece.part, every[1:]))]
    small = drawn(piece.own, piece.size, parts)
    at = np.s_[piece.rows, piece.columns]
    inside = gone[at]
    np.testing.assert_array_equal(small.ids[inside], whole.ids[at][inside])
    np.testing.assert_array_equal(small.hole[inside], whole.hole[at][inside])
    np.testing.assert_allclose(small.depth[inside], whole.depth[at][inside], rtol=1e-6)
    np.testing.assert_allclose(small.rgb[inside], whole.rgb[at][inside], atol=1e-5)


def test_nothing_marked_is_no_window_and_what_is_elsewhere_is_no_part():
    recorded = scene(EYES, length=2, ball=False)
    camera = recorded.cameras["front"]
    assert window.around(np.zeros((4, 4), bool), camera.K, camera.cam_to_world[0]) is None
    away = camera.cam_to_world[0] @ np.diag([-1.0, 1, -1, 1])
    piece = window.around(np.ones((8, 8), bool), camera.K, away)
    assert piece.part(source_at(recorded.episode.views["front"], 0)) is None


@pytest.mark.parametrize("name", EYES)
def test_a_recording_trimmed_to_what_is_used_shows_the_same(name):
    recorded = scene(EYES, length=2, ball=False)
    camera, views = recorded.cameras["front"], recorded.episode.views
    whole = zbuffer.lift(source_at(views[name], 0))
    whole = zbuffer.replace(whole, use=among(whole.ids, frozenset({BOX})))
    small = window.trimmed(whole)
    assert small.depth.size < 0.5 * whole.depth.size
    size = camera.width, camera.height
    first, second = (
        zbuffer.render(camera.K, camera.cam_to_world[0], size, [source])
        for source in (whole, small)
    )
    np.testing.assert_array_equal(second.ids, first.ids)
    np.testing.assert_allclose(second.depth, first.depth, rtol=1e-6)
    np.testing.assert_allclose(second.rgb, first.rgb, atol=1e-5)
    nothing = zbuffer.replace(whole, use=np.zeros_like(whole.use))
    assert window.trimmed(nothing) is nothing
