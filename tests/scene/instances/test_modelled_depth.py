"""A model's depth of a still camera: one in time, on the support's plane, sharp at outlines, and how sure."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from rgb_only_tables import SIZE, still

from rpaug.core import geometry
from rpaug.core.errors import SourceLacks
from rpaug.core.types import Body, Camera, CameraView, Episode, ProxyGeometry, Robot, Scene
from rpaug.operators.recolor import Recolor
from rpaug.operators.remove import Remove
from rpaug.pipeline import plan
from rpaug.scene.instances import backdrop, ground_plane, modelled_depth
from rpaug.scene.placement import placing
from rpaug.scene.placement.free_space import MARGIN, FreeSpace

LENGTH = 10
TABLE, THING, ROOM = 1, 2, 3
NEARER = 0.94  # a thing's depth over that of the table behind it


def placed() -> Camera:
    everything = np.ones((SIZE, SIZE), bool)
    stands = ground_plane.of(still(LENGTH), everything, ~everything).camera
    return replace(stands, assumed=False)


@dataclass
class Bent:
    """A model whose scale drifts and whose depth is bent smoothly, by what is painted in red."""

    truth: np.ndarray
    bend: np.ndarray
    relative: bool = False
    asked: int = 0

    def __call__(self, image: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
        self.asked += 1
        drift = 1 + 0.05 * np.sin(3.0 * self.asked)
        made = self.truth * self.bend * drift
        return 1 / (3 / made + 0.2) if self.relative else made


def shot(flat: bool = True) -> tuple[modelled_depth.StillCamera, np.ndarray, np.ndarray]:
    """A table with a thing on it; its true depth; and a smooth bend of 8 %."""
    camera = placed()
    rays = ground_plane.rays_of(camera)
    pose = camera.cam_to_world[0]
    truth = -pose[2, 3] / (rays @ pose[2, :3])
    resting = np.full((SIZE, SIZE), TABLE, np.int32)
    resting[:8] = ROOM
    resting[28:40, 26:40] = THING
    truth[resting == THING] *= NEARER
    rows, columns = np.indices(truth.shape) / SIZE
    bend = 1 + 0.08 * np.sin(2.5 * rows + 1) * np.cos(2 * columns)
    painted = {TABLE: (90, 140, 190), THING: (200, 30, 30), ROOM: (120, 118, 115)}
    colors = np.array([painted.get(one, (0, 0, 0)) for one in range(4)], np.uint8)[resting]
    images = [colors.copy() for _ in range(LENGTH)]
    for t, image in enumerate(images):
        image[10:20, 4 * t : 4 * t + 8] = 10
    view = CameraView(camera, images.__getitem__)
    drop = backdrop.find(view, LENGTH)
    support = [TABLE] if flat else []
    made = modelled_depth.StillCamera(view, LENGTH, drop, resting, support, lambda t: resting)
    return made, truth, bend


def share(found: np.ndarray, truth: np.ndarray, where: np.ndarray) -> float:
    return float(np.median(np.abs(found[where] / truth[where] - 1)))


@pytest.mark.parametrize("relative", [False, True])
def test_depth_is_bent_onto_the_support_and_things_on_it_follow(relative: bool) -> None:
    still_, truth, bend = shot()
    model = Bent(truth, bend, relative)
    made = modelled_depth.of(still_, model, still_.view.camera)
    table, thing = still_.resting == TABLE, still_.resting == THING
    assert share(made.resting, truth, table) < 1e-6
    assert share(made.resting, truth, thing) < 0.01
    assert share(truth * bend, truth, thing) > 0.02
    assert share(made.resting, truth, thing) < 3 * made.spread + 1e-3
    assert made.spread < 0.02


@pytest.mark.parametrize("reach", modelled_depth.REACHES)
def test_a_map_is_spread_without_growing_or_shrinking(reach: float) -> None:
    """A level map stays itself, another level or scale comes out as it went in, and far off holds the median."""
    rows, columns = np.indices((SIZE, SIZE)) / SIZE
    off = 0.3 + 0.1 * np.sin(2 * rows) + 0.05 * columns
    known = (np.abs(rows - 0.5) < 0.2) & (columns < 0.3)

    def spread(of: np.ndarray) -> np.ndarray:
        return modelled_depth._spread_out(of, known, reach)

    np.testing.assert_allclose(spread(np.full_like(off, 0.7)), 0.7)
    np.testing.assert_allclose(spread(3 * off - 2), 3 * spread(off) - 2, atol=1e-9)
    assert np.abs(spread(off) - off)[known].max() < 0.05
    assert np.abs(spread(off)[:, -1] - np.median(off[known])).max() < 0.05
    np.testing.assert_array_equal(spread(np.where(known, off, 99.0)), spread(off))


def test_a_drifting_scale_does_not_show_in_time() -> None:
    still_, truth, bend = shot()
    made = modelled_depth.of(still_, Bent(truth, bend), still_.view.camera)
    for t in range(LENGTH):
        same = ~still_.backdrop.changed(still_.view.rgb(t))
        assert (made.at(t)[same] == made.resting[same]).all()
        assert share(made.at(t), truth, ~same & (still_.resting == TABLE)) < 1e-6


def test_outlines_are_those_of_the_instances() -> None:
    still_, truth, bend = shot()
    smooth = Bent(
        1 / (np.apply_along_axis(np.convolve, 1, 1 / truth, np.ones(3) / 3, "same")), bend
    )
    made = modelled_depth.of(still_, smooth, still_.view.camera)
    rim = np.zeros(truth.shape, bool)
    rim[30:38, [26, 39]] = True
    assert share(made.resting, truth, rim) < 0.015


def test_a_wilder_bend_is_told_to_be_less_sure() -> None:
    still_, truth, bend = shot()
    rng = np.random.default_rng(0)
    wild = bend * np.exp(0.25 * np.kron(rng.normal(size=(8, 8)), np.ones((SIZE // 8, SIZE // 8))))
    calm = modelled_depth.of(still_, Bent(truth, bend), still_.view.camera)
    unsure = modelled_depth.of(still_, Bent(truth, wild), still_.view.camera)
    assert unsure.spread > 0.05 > calm.spread


def test_without_a_support_nothing_is_sure() -> None:
    still_, truth, bend = shot(flat=False)
    made = modelled_depth.of(still_, Bent(truth, bend), still_.view.camera)
    assert made.spread == np.inf


def scene(spread: float, stray: bool = False) -> Scene:
    """A camera whose depth a model gave. With `stray` a piece of the table was taken for the thing in one frame."""
    still_, truth, _ = shot()
    depth, wrong = truth.astype(np.float32), still_.resting.copy()
    wrong[56:60, 4:8] = THING
    views = {
        "front": replace(
            still_.view,
            depth=lambda t: depth,
            ids=lambda t: wrong if stray and t == 0 else still_.resting,
            inferred=True,
            proxy=ProxyGeometry(still_.view.camera, depth, modelled=True, spread=spread),
        )
    }
    robot = Robot(np.zeros((LENGTH, 0)), np.zeros((LENGTH, 0)), None, None)
    episode = Episode("drawn/0", views, robot, (), LENGTH)
    rest = np.tile(np.eye(4), (LENGTH, 1, 1))
    bodies = tuple(Body(frozenset([one]), rest, "static") for one in (TABLE, THING, ROOM))
    cameras = {name: view.camera for name, view in views.items()}
    return Scene(episode, cameras, bodies, {}, antialiased=False, descriptions=())


def test_what_was_outlined_once_elsewhere_is_no_part_of_a_thing() -> None:
    clean, spoilt = (placing.points_of(scene(0.01, stray=one), [THING]) for one in (False, True))
    assert np.ptp(spoilt, axis=0) == pytest.approx(np.ptp(clean, axis=0))


@pytest.mark.parametrize(
    ("spread", "words"), [(1.1 * MARGIN, "may be off by 55 mm"), (np.inf, "nothing tells how far")]
)
def test_edits_that_need_depth_are_refused_where_it_is_too_unsure(
    spread: float, words: str
) -> None:
    plan.check(Recolor(target={"handle": THING}, color="red"), scene(spread))
    plan.check(Remove(target={"handle": THING}), scene(0.9 * MARGIN))
    with pytest.raises(SourceLacks, match=words):
        plan.check(Remove(target={"handle": THING}), scene(spread))


def room(spread: float | None) -> FreeSpace:
    """The room beside a thing that moves; None for its line of sight alone, without a model's depth."""
    made = scene(spread or 0.0)
    view = made.episode.views["front"]
    if spread is None:
        view = replace(view, depth=None)
    bodies = tuple(
        replace(one, motion="unknown") if THING in one.instance_ids else one for one in made.bodies
    )
    roles = {"table": frozenset([TABLE]), "background": frozenset([ROOM])}
    episode = replace(made.episode, views={"front": view})
    return placing.find_free_space(replace(made, episode=episode, bodies=bodies, roles=roles))


def test_what_moves_takes_the_room_around_its_depth_and_not_all_of_its_line_of_sight() -> None:
    taken = [np.isfinite(room(spread).swept) for spread in (0.005, 0.03, None)]
    for less, more in itertools.pairwise(taken):
        assert (more | ~less).all()
        assert 0 < less.sum() < more.sum()


def test_the_world_of_a_placed_camera_has_its_support_at_zero() -> None:
    still_, truth, bend = shot()
    made = modelled_depth.of(still_, Bent(truth, bend), still_.view.camera)
    points = geometry.world_points(made.resting.astype(float), still_.view.camera, 0)
    assert np.abs(points[still_.resting == TABLE][:, 2]).max() < 1e-5
