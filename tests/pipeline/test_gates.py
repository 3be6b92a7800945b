"""Each figure says what it should of edits whose faults are known."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import pytest
from analytic import BALL, BOX
from analytic import scene as analytic_scene
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from rpaug import Scene
from rpaug.core import geometry
from rpaug.operators.camera_pose import CameraPose
from rpaug.operators.fields import Palette
from rpaug.operators.recolor import AlbedoRatio, Recolor
from rpaug.operators.sensor_noise import SensorNoise
from rpaug.pipeline import copies, plan
from rpaug.pipeline.gates import UNASKED, Figures, Gates, _still, beyond, described, measure
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.targets.targets import Target

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}
BLUE = (0.1, 0.2, 0.9)


EVERY = Gates().limits


def figures(scene: Scene, limits: Collection[str] = EVERY) -> Figures:
    """Of an edited scene, all its frames rendered."""
    made = copies.render(
        scene, (), plan.Plan(0, dict.fromkeys(scene.cameras, 0), True), counted=True
    )
    for view in made.episode.views.values():
        for t in range(scene.episode.length):
            view.rgb(t)
    outside = sum(made.tally.outside.values())
    return measure(
        made.scene,
        made.episode,
        made.plan.representations,
        outside,
        made.tally.holes,
        made.tally.moving,
        limits,
    )


def recorded(**changes: object) -> Scene:
    return replace(analytic_scene(EYES, length=4), **changes)  # type: ignore[arg-type]


def painted(scene: Scene) -> Scene:
    operator = Recolor(target=Target(handle=BOX), color=Palette((BLUE,)))
    return operator.apply(scene, operator.sample(scene, np.random.default_rng(0)))


@dataclass(frozen=True)
class Restless:
    """Its color depends on where the surface is in the world: a moving thing crawls, a still one does not."""

    instance_ids: frozenset[int]
    calls: list[int]

    def __call__(self, color, surface):  # type: ignore[no-untyped-def]
        self.calls.append(0)
        return np.clip(color + 0.1 * (len(self.calls) % 2), 0, 1).astype(np.float32)


def test_a_good_recoloring_passes_every_gate() -> None:
    found = figures(painted(recorded()))
    assert found.outside == 0
    assert found.holes is None
    assert found.reprojection is None  # its depth is the recorded one
    assert found.flicker is not None
    assert found.flicker < 0.5
    assert found.color is not None
    assert found.color < 5
    assert not Gates().faults(found)


def test_a_color_that_was_not_asked_for_is_told() -> None:
    @dataclass(frozen=True)
    class Mistaken(AlbedoRatio):
        @property
        def asked(self) -> tuple[float, float, float]:
            return (0.9, 0.2, 0.1)

    edit = Mistaken(frozenset({BOX}), (0.6, 0.6, 0.6), BLUE, plain=False)
    found = figures(recorded(appearance=(edit,)))
    assert found.color is not None
    assert found.color > 30
    assert Gates().faults(found)[0].startswith("color ")


def test_flicker_is_what_the_recording_lacks() -> None:
    found = figures(recorded(appearance=(Restless(frozenset({BOX}), []),)))
    assert found.flicker is not None
    assert found.flicker > 5


def test_what_rolls_on_is_not_still_and_what_it_uncovers_is() -> None:
    view = recorded().episode.views["overhead"]
    ids, then = view.ids(0), view.ids(1)  # type: ignore[misc]
    assert (ids != then).any()  # the ball went on
    still = _still(view, 0)
    assert not still[ids == BALL].any()
    assert still[(ids == BOX) & (then == BOX)].all()


def test_a_moved_camera_agrees_with_the_others_and_has_holes() -> None:
    scene = recorded()
    operator = CameraPose(camera="front", shift=0.15)
    edit = {"front": {"turn": [0.0, 0.0, 0.0], "shift": [0.15, 0.0, 0.0]}}
    found = figures(operator.apply(scene, edit))
    assert found.outside == 0
    assert found.reprojection is not None
    assert found.reprojection < 2
    assert found.holes is not None
    assert 0 < found.holes < 1


def test_what_moves_must_have_been_recorded_from_where_the_camera_is_now() -> None:
    """A ball rolls in over the border of the only camera: from further left there is more of it."""
    scene = analytic_scene({"front": (0.0, -0.8, 0.7)}, length=4)

    def of(shift: float) -> Figures:
        edit = {"front": {"turn": [0.0, 0.0, 0.0], "shift": [shift, 0.0, 0.0]}}
        return figures(CameraPose(camera="front").apply(scene, edit))

    little, far = of(-0.01), of(-0.12)
    assert little.moving is not None
    assert far.moving is not None
    assert little.moving < Gates().moving < far.moving  # type: ignore[operator]
    (fault,) = (fault for fault in Gates().faults(far) if fault.startswith("moving "))
    assert "arms: [FILE]" in fault
    assert figures(painted(recorded())).moving is None


def test_a_limit_that_is_off_is_not_measured() -> None:
    edit = {"front": {"turn": [0.0, 0.0, 0.0], "shift": [0.1, 0.0, 0.0]}}
    found = figures(CameraPose(camera="front").apply(recorded(), edit), UNASKED.limits)
    assert set(found.describe()) == {"holes", "moving", "torn"}


@pytest.mark.parametrize(
    ("edits", "gates", "held"),
    [
        ([{"op": "camera_pose", "camera": "front"}], {}, UNASKED),
        (
            [{"one_of": [{"op": "sensor_noise"}, {"op": "camera_pose", "camera": "front"}]}],
            {},
            UNASKED,
        ),
        ([{"op": "camera_pose", "camera": "front"}], {"gates": False}, None),
        ([{"op": "camera_pose", "camera": "front"}], {"gates": {"tries": 5}}, Gates(tries=5)),
        ([{"op": "sensor_noise"}], {}, None),
    ],
)
def test_a_recipe_that_moves_cameras_is_held_to_what_was_recorded(
    edits: list[dict[str, object]], gates: dict[str, object], held: Gates | None
) -> None:
    assert Recipe.from_dict({"version": 1, "edits": edits, **gates}).gates == held


def test_the_worst_camera_counts_for_what_moves() -> None:
    counts = {("front", 0): (1, 4), ("front", 1): (0, 6), ("side", 0): (3, 5), ("top", 0): (0, 0)}
    found = measure(recorded(), recorded().episode, {"front": 0}, 0, {}, counts, EVERY)
    assert found.moving == 0.6


def test_a_hand_that_is_whole_but_in_few_frames_is_torn() -> None:
    """Nine frames show all of it, one invents it; frames that show next to nothing of it say next to nothing."""
    whole = {("wrist", t): (0, 40) for t in range(9)}
    torn = {("wrist", 9): (36, 40), ("wrist", 10): (1, 1)}
    found = measure(recorded(), recorded().episode, {"wrist": 1}, 0, {}, whole | torn, EVERY)
    assert found.moving == pytest.approx(37 / 401)
    assert found.torn == pytest.approx(37 / 41)
    (fault,) = Gates(holes=None).faults(found)
    assert fault.startswith("torn 0.9")
    assert "arms: [FILE]" in fault


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1))
def test_the_worst_frames_are_no_better_than_all(pairs: list[tuple[int, int]]) -> None:
    counts = {("front", t): (min(pair), max(pair)) for t, pair in enumerate(pairs)}
    found = measure(recorded(), recorded().episode, {"front": 1}, 0, {}, counts, {"moving", "torn"})
    if found.moving is None:
        assert found.torn is None
    else:
        assert found.torn is not None
        assert found.moving - 1e-12 <= found.torn <= 1


def test_a_camera_that_is_not_where_it_says_disagrees() -> None:
    scene = recorded()
    edit = {"front": {"turn": [0.0, 0.0, 0.0], "shift": [0.02, 0.0, 0.0]}}
    moved = CameraPose(camera="front").apply(scene, edit)
    made = copies.render(moved, (), plan.Plan(0, dict.fromkeys(EYES, 0), True))
    view = made.episode.views["front"]
    lift = geometry.rigid(np.zeros(3), np.array([0.0, 0.0, -0.01]))
    wrong = replace(view.camera, cam_to_world=view.camera.cam_to_world @ lift)
    lying = replace(
        made.episode, views={**made.episode.views, "front": replace(view, camera=wrong)}
    )
    found = measure(moved, lying, made.plan.representations, 0, {}, {}, EVERY)
    assert found.reprojection is not None
    assert 5 < found.reprojection < 15


def test_with_sensor_effects_neither_flicker_nor_outside_is_told() -> None:
    scene = painted(recorded())
    noise = SensorNoise()
    noisy = noise.apply(scene, noise.sample(scene, np.random.default_rng(0)))
    found = figures(noisy)
    assert (found.flicker, found.outside) == (None, None)
    assert found.color == figures(scene).color


def test_pixels_beyond_the_edit_are_counted() -> None:
    scene = painted(recorded())
    ids = scene.episode.views["front"].ids(0)  # type: ignore[misc]
    before = scene.episode.views["front"].rgb(0)
    rows = np.argwhere(ids == BOX)
    after = before.copy()
    after[ids == BOX] ^= 1
    assert beyond(scene, before, after, ids) == 0
    beside = rows[rows[:, 1].argmin()] - [0, 1]
    after[tuple(beside)] ^= 1
    after[0, 0] ^= 1
    assert beyond(scene, before, after, ids) == 2
    assert beyond(replace(scene, antialiased=True), before, after, ids) == 1
    assert (
        beyond(replace(scene, appearance=()), before, after, ids) == (before != after).any(-1).sum()
    )


@given(st.floats(0, 100), st.floats(0, 100))
def test_a_gate_passes_what_does_not_exceed_its_limit(value: float, limit: float) -> None:
    faults = Gates(flicker=limit).faults(Figures(flicker=value))
    assert bool(faults) == (value > limit)
    assert not Gates(flicker=None).faults(Figures(flicker=value))
    assert not Gates(flicker=limit).faults(Figures())


def test_the_report_says_only_what_was_measured() -> None:
    found = described(Figures(outside=0, holes=0.123456), ["holes"], 2)
    assert found == {
        "passed": False,
        "attempt": 2,
        "figures": {"outside": 0, "holes": 0.1235},
        "faults": ["holes"],
    }


@pytest.mark.parametrize("fields", [{"tries": 0}, {"holes": -1}, {"psnr": 30}, {"tries": 2.5}])
def test_senseless_gates_are_refused(fields: dict) -> None:
    with pytest.raises(ValidationError):
        Gates(**fields)


def test_the_camera_with_most_holes_counts() -> None:
    recorded = analytic_scene({"front": (0.0, -0.9, 0.6)}, length=2)
    masks = {name: np.zeros((2, 2), bool) for name in ("a/0", "a/1", "b/0", "b/1")}
    masks["b/1"][0] = True
    shown = measure(recorded, recorded.episode, {"a": 1, "b": 1}, 0, masks, {}, {"holes"})
    assert shown.holes == 0.25  # of camera b, over its frames


def test_a_place_whose_depth_changes_is_not_still() -> None:
    view = analytic_scene({"front": (0.0, -0.9, 0.6)}, length=2).episode.views["front"]
    assert view.depth is not None
    depth = view.depth(0)
    nearer = depth.copy()
    nearer[3, 4] -= 0.2
    shown = replace(view, depth=lambda t: nearer if t else depth, ids=None)
    still = _still(shown, 0)
    assert not still[3, 4]
    assert still.sum() == still.size - 1


def test_a_ball_that_moves_does_not_flicker() -> None:
    operator = Recolor(target=Target(handle=BALL), color=Palette((BLUE,)))
    scene = recorded()
    found = figures(operator.apply(scene, operator.sample(scene, np.random.default_rng(0))))
    assert found.flicker is None or found.flicker < 2
