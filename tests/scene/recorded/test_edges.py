"""Where flat things end is known beyond the pixels that show it."""

import numpy as np

from rpaug.core import geometry
from rpaug.render.holes import Witness, fill
from rpaug.render.zbuffer import Rendered, Source
from rpaug.scene.recorded.edges import straight

FLOOR, SKY = 3, 0
EDGE = 2.0  # metres: the floor ends at x = 2
K = np.array([[60.0, 0, 47.5], [0, 60.0, 31.5], [0, 0, 1]])
SIZE = (64, 96)


def looking(slope: float) -> Source:
    """The floor z = 0 and the sky behind its edge, from 1 m above, looking down by `slope` towards larger x."""
    ahead = np.array([1.0, 0.1, -slope]) / np.linalg.norm([1.0, 0.1, -slope])
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
    pose[:3, 3] = 0, 0, 1
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    rays = geometry.rays(columns, rows, K) @ pose[:3, :3].T
    depth = np.divide(-1.0, rays[..., 2], out=np.full(SIZE, np.inf), where=rays[..., 2] < 0)
    depth = np.where(depth * rays[..., 0] <= EDGE, depth, np.inf)
    floor = np.isfinite(depth)
    rgb = np.where(floor[..., None], 200, 90).astype(np.uint8).repeat(3, 2)
    ids = np.where(floor, FLOOR, SKY).astype(np.int32)
    return Source(K, pose, rgb, depth.astype(np.float32), ids, distant=True)


def test_the_edge_of_a_floor_is_found_where_it_is():
    found = straight([looking(0.6)], frozenset({FLOOR}))
    assert set(found.instance_ids.tolist()) == {FLOOR}
    np.testing.assert_allclose(np.abs(found.faces[:, 2]), 1, atol=1e-3)
    away = np.abs(found.sides - [-1, 0, 0, -EDGE]).max(1)
    assert away.min() < 0.04  # half a pixel there
    assert not len(straight([looking(0.6)], frozenset({9})).instance_ids)
    assert not len(found.without(frozenset({FLOOR})).instance_ids)


def test_an_edge_goes_on_straight_into_what_nobody_recorded():
    """The view is wider than the recording: the line between floor and sky goes on to the view's border."""
    whole = looking(0.6)
    hole = np.ones(SIZE, bool)
    hole[14:50, 24:72] = False
    cut = Source(
        K - [[0, 0, 24], [0, 0, 14], [0, 0, 0]], whole.cam_to_world,
        *(image[14:50, 24:72] for image in (whole.rgb, whole.depth, whole.ids)), distant=True,
    )  # fmt: skip
    depth = np.where(hole | ~np.isfinite(whole.depth), 0, whole.depth).astype(np.float32)
    view = Rendered(
        rgb=np.where(hole[..., None], 0, whole.rgb / 255).astype(np.float32), depth=depth,
        ids=np.where(hole, 0, whole.ids).astype(np.int32), source=np.where(hole, -1, 0).astype(np.int16),
        hole=hole, rough=hole,
    )  # fmt: skip
    ends = straight([cut], frozenset({FLOOR}))
    wrong = [
        (fill(view, Witness(cut, K, whole.cam_to_world, *known)).ids != whole.ids).mean()
        for known in ((), (ends,))
    ]
    assert wrong[1] < 0.01
    assert wrong[1] < wrong[0] / 2
