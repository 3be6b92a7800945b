"""Decoded images that are kept while copies are drawn from them."""

from dataclasses import replace

import numpy as np
from rolling import demonstration

from rpaug.core.image_cache import held, shelved


def test_what_was_asked_for_last_is_kept() -> None:
    recorded, decoded = demonstration(6), []
    name, view = next(iter(recorded.views.items()))

    def rgb(t: int) -> np.ndarray:
        decoded.append(t)
        return view.rgb(t)

    episode = replace(recorded, views={name: replace(view, rgb=rgb)})
    kept = shelved(episode, 2 * view.rgb(0).nbytes).views[name]
    for t in (0, 1, 0, 2):  # the last throws out frame 1, which was not asked for again
        assert np.array_equal(kept.rgb(t), view.rgb(t))
    kept.rgb(0)
    kept.rgb(2)
    assert decoded == [0, 1, 2]
    kept.rgb(1)
    assert decoded == [0, 1, 2, 1]


def test_what_is_made_of_a_frame_is_made_once_while_it_fits() -> None:
    asked: list[tuple[str, int]] = []

    def made(name: str, t: int) -> np.ndarray:
        asked.append((name, t))
        return np.full(10, t, np.uint8)

    kept = held(made, most=20)
    for name, t in (("a", 0), ("a", 0), ("b", 0), ("a", 0)):
        np.testing.assert_array_equal(kept(name, t), np.full(10, t))
    assert asked == [("a", 0), ("b", 0)]
    kept("a", 1)
    kept("b", 0)
    assert asked == [("a", 0), ("b", 0), ("a", 1), ("b", 0)]
