"""Instance ids of what an edit puts in: free in every recorded mask, and small enough to be kept there."""

import numpy as np

from rpaug.core import memo
from rpaug.core.errors import Unsupported
from rpaug.core.types import Episode, Scene


def free(scene: Scene, count: int) -> list[int]:
    """So many ids in a row that neither the scene nor a recorded mask has: after the highest taken one, or, where masks
    have no room above that, after the next lower one. Raises Unsupported where masks have no such room at all.
    """
    taken = scene.instance_ids | _recorded(scene.episode)
    most = min(view.most_id for view in scene.episode.views.values())
    for start in sorted((one + 1 for one in taken | {0}), reverse=True):
        fresh = range(start, start + count)
        if fresh[-1] <= most and taken.isdisjoint(fresh):
            return list(fresh)
    raise Unsupported(f"the masks hold ids up to {most}, and {count} in a row are not free there")


@memo.of_episode
def _recorded(episode: Episode) -> frozenset[int]:
    """All ids in all recorded masks: some show in a few frames only, and stand for no instance of the scene."""
    found: set[int] = set()
    for view in episode.views.values():
        if view.ids is None or view.inferred:
            continue
        for t in range(episode.length):
            ids = view.ids(t)
            starts = np.diff(ids, axis=1, prepend=-1) != 0  # of runs in a row: few of many pixels
            found.update(np.unique(ids[starts]).tolist())
    return frozenset(found)
