"""The support of a video: one surface in all frames, and nothing that is put there or carried past it."""

from dataclasses import replace

import numpy as np
import pytest

from rpaug.scene.instances import color_clusters
from rpaug.scene.video import believed, instances, supports
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.instances import BACKGROUND, FIRST, InstanceMap, Support

TAN, RED = (190, 150, 90), (200, 20, 30)
H, W = 60, 80
TABLE, THING = FIRST, FIRST + 1
RIGHT = np.s_[15:45, 50:70]


def above(right: tuple[int, int, int], depth: float = 1.0) -> PosedFrame:
    """A camera that looks straight down at a tan table at z = 0, from a metre, and at a patch of another color."""
    rgb = np.full((H, W, 3), TAN, np.uint8)
    rgb[RIGHT] = right
    far = np.full((H, W), 1.0, np.float32)
    far[RIGHT] = depth
    K = np.array([[W, 0, (W - 1) / 2], [0, W, (H - 1) / 2], [0, 0, 1.0]])
    down = np.diag([1.0, -1, -1, 1])
    down[2, 3] = 1.0
    return PosedFrame(rgb, far, K, down)


def mapped(look: PosedFrame, named: np.ndarray) -> InstanceMap:
    """The instances of one frame, by the cells that it fills."""
    cell = 0.01
    keys = np.floor(look.points / cell).astype(np.int64).reshape(-1, 3)
    codes, first = np.unique(instances._packed(keys), return_index=True)
    ids, color = (
        named.ravel()[first].astype(np.int32),
        color_clusters.weighted(np.array(TAN, np.uint8)),
    )
    known = ids >= FIRST
    support = Support(frozenset([TABLE]), color.astype(np.float32))
    return InstanceMap(cell, codes[known], ids[known], 2, (support,), 0.0)


def nothing() -> InstanceMap:
    """No cell is known, but what the support looks like is."""
    table = mapped(above(TAN), np.full((H, W), TABLE))
    return replace(table, codes=table.codes[:0], instance_ids=table.instance_ids[:0])


def test_what_lies_in_the_plane_and_has_the_color_is_the_support_though_no_cell_is_known() -> None:
    found = nothing().rough(above(RED))
    assert (found[RIGHT] == BACKGROUND).mean() > 0.9
    found[RIGHT] = TABLE
    assert (found == TABLE).mean() > 0.95


def test_what_has_the_color_above_the_plane_is_no_support() -> None:
    darker = tuple(round(0.93 * one) for one in TAN)
    look = above((darker[0], darker[1], darker[2]), depth=0.5)
    if len(np.unique(look.segments)) == 1:
        look = above((215, 150, 60), depth=0.5)
    assert (nothing().rough(look)[RIGHT] == BACKGROUND).mean() > 0.9


def test_what_is_put_on_the_support_is_none_of_it() -> None:
    look = above(RED)
    table = mapped(look, np.full((H, W), TABLE))
    named = table.rough(look)
    assert (named == TABLE).all()
    found = table.of(look, named)
    assert (found[RIGHT] == BACKGROUND).mean() > 0.9
    found[RIGHT] = TABLE
    assert (found == TABLE).mean() > 0.9


def test_a_thing_that_one_frame_loses_is_what_the_frames_beside_it_show_there() -> None:
    look, table = above(RED), mapped(above(RED), np.full((H, W), TABLE))
    lost, known = np.full((H, W), TABLE), np.full((H, W), TABLE)
    lost[RIGHT], known[RIGHT] = BACKGROUND, THING
    alone = table.of(look, lost.astype(np.int32))
    beside = table.of(look, lost.astype(np.int32), [(look, known.astype(np.int32))] * 2)
    assert (alone[RIGHT] == BACKGROUND).mean() > 0.9
    assert (beside[RIGHT] == THING).mean() > 0.9


@pytest.mark.parametrize(("color", "support"), [((184, 146, 90), {TABLE, THING}), (RED, {TABLE})])
def test_a_part_that_one_frame_alone_shows_apart_is_the_support_if_it_has_its_color(
    color: tuple[int, int, int], support: set[int]
) -> None:
    named = np.full((H, W), TABLE)
    named[RIGHT] = THING
    found = replace(mapped(above(TAN), named), supports=())
    looks = [above(TAN) for _ in range(12)] + [above(color)]
    looks[-1].__dict__["segments"] = (named == THING).astype(np.int32)
    assert supports.with_supports(found, looks, 0.0, 1).support == support


def beside(height: float, piece: int = 0) -> PosedFrame:
    """A table with a patch of its color at its right, whose depth was filled in, and of which points were measured at a
    height below the table's."""
    look = above((184, 146, 90))
    look.__dict__["segments"] = np.zeros((H, W), np.int32)
    look.segments[RIGHT] = 1
    flat = look.points[::7, ::7].reshape(-1, 3)
    row, column, _ = look.sees(flat)
    inner = np.zeros((H, W), bool)
    inner[RIGHT] = True
    flat[inner[row, column]] *= 1 - height
    flat[inner[row, column], 2] = height
    return replace(look, sighted=flat, piece=piece)


@pytest.mark.parametrize(("height", "support"), [(0.0, {TABLE, THING}), (-0.5, {TABLE})])
def test_what_was_measured_to_lie_lower_is_no_table_though_its_depth_was_filled_in(
    height: float, support: set[int]
) -> None:
    named = np.full((H, W), TABLE)
    named[RIGHT] = THING
    looks = [beside(height) for _ in range(4)]
    for look in looks:
        look.__dict__["segments"] = (named == THING).astype(np.int32)
    found = supports.with_supports(replace(mapped(above(TAN), named), supports=()), looks, 0.0, 1)
    assert found.support == support
    (one,) = found.supports
    assert one is not None
    assert one.measured > 0.95
    belief, told = believed.table(found, [(0, 3)]), believed.told(found, [(0, 3)], 1.0)
    assert belief is not None
    assert belief.confidence > 0.9
    assert ["3 (50 cm below it)" in said for said in told] == [True] * (height < 0)


def test_a_support_that_frames_do_not_agree_on_is_doubted() -> None:
    looks = [above(TAN) for _ in range(4)]
    masks = [np.full((H, W), k % 2 == 0) for k in range(4)]
    assert supports._disputed(looks, masks) > 0.5
    assert supports._disputed(looks, [np.ones((H, W), bool)] * 4) == 0


def test_a_thing_takes_what_its_color_says_is_left_of_it() -> None:
    """A segment that mixes thing and support leaves a corner of the thing outside."""
    look, small = above(TAN), np.s_[20:29, 30:39]
    look.rgb[small] = RED
    named = np.full((H, W), TABLE, np.int32)
    named[20:27, 32:39] = THING
    found = mapped(look, named)._joined(look, named)
    assert (found[small] == THING).all()
    found[small] = TABLE
    assert (found == TABLE).all()


def test_a_large_surface_ends_where_its_color_does() -> None:
    """Its segments end in its shade, and one of another thing that stands before it lies in its cells."""
    rgb = np.full((120, 160, 3), (70, 72, 75), np.uint8)
    light = np.linspace(0.75, 1.0, 80)[:, None, None]
    rgb[40:] = (light * [170, 30, 40]).astype(np.uint8)
    rgb[90:, 100:130] = (150, 120, 80)
    named = np.full(rgb.shape[:2], FIRST + 1, np.int32)
    named[55:] = FIRST  # a dark strip of the red is part of the gray segment above
    patch = named.copy()
    patch[90:, 100:130] = 0
    look = PosedFrame(
        rgb, np.ones(rgb.shape[:2], np.float32), np.eye(3), np.eye(4), segmented=lambda shown: patch
    )
    none = np.zeros(0, np.int32)
    found = InstanceMap(1.0, none.astype(np.int64), none, 2).of(look, named)
    assert (found[42:88] == FIRST).all()
    assert (found[:40] == FIRST + 1).all()
    assert (found[93:, 103:127] == BACKGROUND).all()
