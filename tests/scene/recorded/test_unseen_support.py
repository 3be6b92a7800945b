"""What is painted behind removed things where depth was worked out from images."""

import numpy as np

from rpaug.render.zbuffer import Rendered
from rpaug.scene.recorded import unseen

TABLE, FLOOR, H, W = 2, 1, 40, 50
GONE = np.s_[15:25, 20:30]


def drawn(depth: float, edge: bool = False) -> tuple[Rendered, np.ndarray]:
    """A table before a camera, whose thing is gone: another frame shows `depth` there."""
    ids, far = np.full((H, W), TABLE, np.int32), np.full((H, W), 1.0, np.float32)
    if edge:
        ids[:20], far[:20] = FLOOR, 2.0
    source = np.zeros((H, W), np.int16)
    recorded = ids.copy()
    recorded[GONE], source[GONE], far[GONE] = 7, 3, depth
    plain = np.zeros((H, W), bool)
    return Rendered(
        np.zeros((H, W, 3), np.float32), far, ids, source, plain, plain.copy()
    ), recorded


def test_nothing_is_seen_through_a_support() -> None:
    view, recorded = drawn(1.6)
    made, painted = unseen.closed(view, recorded, frozenset([TABLE]))
    assert painted[GONE].all()
    assert painted.sum() == painted[GONE].sum()
    np.testing.assert_allclose(made.depth[GONE], 1.0, atol=1e-3)
    assert (made.ids[GONE] == TABLE).all()


def test_what_nobody_saw_of_the_support_is_painted_from_it() -> None:
    view, recorded = drawn(0.0)
    view.hole[GONE], view.source[GONE] = True, -1
    view.rgb[:] = 0.5
    view.rgb[GONE] = 0
    made, painted = unseen.closed(view, recorded, frozenset([TABLE]))
    assert painted[GONE].all()
    assert not made.hole.any()
    np.testing.assert_allclose(made.rgb[GONE], 0.5, atol=0.02)


def test_what_another_frame_shows_of_the_support_stays() -> None:
    view, recorded = drawn(1.02)
    assert not unseen.closed(view, recorded, frozenset([TABLE]))[1].any()


def test_beyond_the_supports_outline_the_floor_is_seen() -> None:
    view, recorded = drawn(2.0, edge=True)
    _, painted = unseen.closed(view, recorded, frozenset([TABLE]))
    assert painted[20:25, 20:30].all()
    assert not painted[:20].any()


def test_without_a_support_nothing_is_closed() -> None:
    view, recorded = drawn(1.6)
    assert unseen.closed(view, recorded, frozenset())[0] is view
