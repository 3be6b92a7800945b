"""New instance ids are free in every recorded mask and fit into the file that keeps them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.core import instance_ids
from rpaug.core.errors import Unsupported
from rpaug.core.types import Episode, Scene

MOST = 31
TAKEN = st.lists(st.integers(0, MOST), min_size=4, max_size=24)


def scene(taken: list[int], most: int = MOST) -> Scene:
    """A scene of two frames whose masks hold these ids, the last of them in the last frame alone."""
    masks = np.zeros((2, 4, 6), np.int32)
    masks[0].flat[: len(taken) - 1] = taken[:-1]
    masks[1, 0, 0] = taken[-1]
    episode = Episode.from_arrays(np.zeros((2, 4, 6, 3), np.uint8), masks=masks)
    views = {name: replace(view, most_id=most) for name, view in episode.views.items()}
    episode = replace(episode, views=views)
    return Scene(episode, {}, (), {}, False, ())


@given(TAKEN, st.integers(1, 6))
def test_new_ids_are_free_and_fit(taken: list[int], count: int) -> None:
    try:
        new = instance_ids.free(scene(taken), count)
    except Unsupported:
        runs = "".join("x" if one in taken or not one else "." for one in range(MOST + 1))
        assert "." * count not in runs
        return
    assert len(set(new)) == count
    assert not set(new) & {0, *taken}
    assert 0 < min(new) <= max(new) <= MOST
    if max(taken) + count <= MOST:
        assert new[0] == max(taken) + 1


def test_a_stray_id_at_the_end_of_the_range_leaves_room_below() -> None:
    assert instance_ids.free(scene([9, 2**24 - 1], 2**24 - 1), 2) == [10, 11]


def test_masks_without_room_are_refused() -> None:
    with pytest.raises(Unsupported, match="hold ids up to 3, and 2 in a row"):
        instance_ids.free(scene([2, 2], 3), 2)
