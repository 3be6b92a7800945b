"""What changes in a fixed camera, by colour alone."""

from dataclasses import replace

import boxes
import numpy as np

from rpaug.scene.segmentation import colour


def test_what_moves_is_told_from_what_rests():
    world = boxes.pick_and_place()
    truth = world.episode()
    views = {name: replace(view, ids=None, depth=None) for name, view in truth.views.items()}
    found = colour.masked(replace(truth, views=views))
    both = either = 0
    for name, view in truth.views.items():
        assert found.views[name].inferred
        for t in range(truth.length):
            moves = np.isin(view.ids(t), [boxes.HAND])
            got = found.views[name].ids(t) == colour.MOVING
            # The block rests in some frames, where colour alone cannot know it.
            unsure = view.ids(t) == boxes.BLOCK
            both += (moves & got & ~unsure).sum()
            either += ((moves | got) & ~unsure).sum()
    assert both / either > 0.6


def test_with_depth_it_is_left_to_motion():
    episode = boxes.still(3).episode(masks=False)
    found = colour.masked(episode)
    assert all(view.ids is None for view in found.views.values())
