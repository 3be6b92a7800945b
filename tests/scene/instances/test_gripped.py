"""What a gripper closes on, in drawn recordings of color images alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from rgb_only_tables import BLOCK, FLOOR, PLATE, SIZE, TABLE, still

from rpaug.core.errors import TargetError
from rpaug.core.types import CameraView, Episode, Robot
from rpaug.scene.build import build
from rpaug.scene.instances import gripped, rgb_episode
from rpaug.scene.targets.targets import Target, find

LENGTH = 12
OVER = {"block": 26, "plate": 40, "table": 12}


def frame(t: int, ends: str, mirror: bool, block: tuple[int, int, int] = BLOCK) -> np.ndarray:
    """An arm comes down and stops over a thing."""
    out = np.empty((SIZE, SIZE, 3), float)
    out[:] = FLOOR
    out[16:60, 4:60] = TABLE
    out[40:49, 40:49] = PLATE
    out[36:46, 22:32] = block
    low = 4 + 4 * min(t, 10)
    left = OVER[ends]
    out[:low, left : left + 8] = (15, 15, 18)
    out += np.random.default_rng(t).normal(0, 1.5, out.shape)
    image = np.clip(np.rint(out), 0, 255).astype(np.uint8)
    return image[:, ::-1].copy() if mirror else image


def episode(
    ends: tuple[str, ...], opening: np.ndarray | None, block: tuple[int, int, int] = BLOCK
) -> Episode:
    images = [[frame(t, one, k > 0, block) for t in range(LENGTH)] for k, one in enumerate(ends)]
    views = {
        f"image_{k}": CameraView(still(LENGTH), shown.__getitem__) for k, shown in enumerate(images)
    }
    robot = Robot(np.zeros((LENGTH, 0)), np.zeros((LENGTH, 0)), None, opening)
    return Episode("drawn/0", views, robot, ("put the block on the plate",), LENGTH)


SHUTS = np.where(np.arange(LENGTH) < 10, 1.0, 0.4)


@pytest.mark.parametrize("cameras", [1, 2])
@pytest.mark.parametrize(("ends", "color"), [("block", "red"), ("plate", "green")])
def test_what_the_gripper_closes_on_is_manipulated(cameras: int, ends: str, color: str) -> None:
    scene = build(episode((ends,) * cameras, SHUTS), with_bodies=True)
    assert scene.roles["manipulated"] == find(scene, Target(text=f"the {color} thing"))
    assert "gripper closes" in scene.beliefs["manipulated"].reasons[0]


def test_cameras_that_disagree_tell_nothing() -> None:
    scene = build(episode(("block", "plate"), SHUTS), with_bodies=True)
    assert "manipulated" not in scene.roles


def test_what_lies_at_the_fingers_in_all_cameras_is_gripped_whatever_one_shows_beside_it() -> None:
    beside = drawn(None, 7)
    beside[38:41, 32:38] = 8
    hand = [np.where(drawn(32) == 1, 1, one) for one in (beside, drawn(None, 7))]

    def told_of(*cameras: tuple[np.ndarray, np.ndarray]) -> gripped.Gripped:
        resting = {str(k): one for k, (one, _) in enumerate(cameras)}
        return gripped.find(
            resting,
            lambda t: {str(k): pair[t > 0] for k, pair in enumerate(cameras)},
            start=2,
            last=3,
        )

    assert told_of((beside, hand[0])) == gripped.Gripped(rivals=frozenset({7, 8}))
    both = told_of((beside, hand[0]), (drawn(None, 7), hand[1]))
    assert (both.thing, both.rivals) == (7, frozenset())


def test_one_of_several_things_that_the_gripper_may_close_on_is_doubted() -> None:
    """What changed by color alone was a sink's patch beside the carrot that the gripper took."""
    seen = SimpleNamespace(
        roles={"manipulated": frozenset({12})},
        manipulated=frozenset({12}),
        gripped=gripped.Gripped(rivals=frozenset({11, 12})),
        plainness=1.0,
    )
    doubted = rgb_episode._beliefs(seen)["manipulated"]  # type: ignore[arg-type]
    assert doubted.confidence == 0
    assert "instances 11, 12" in doubted.reasons[0]
    seen.gripped = gripped.Gripped(rivals=frozenset({11, 13}))
    assert rgb_episode._beliefs(seen)["manipulated"].confidence == rgb_episode.SURE  # type: ignore[arg-type]


def test_an_orange_thing_in_dim_light_is_still_the_one_that_the_instruction_names() -> None:
    scene = build(episode(("block",), SHUTS, block=(120, 70, 28)), with_bodies=True)
    assert find(scene, Target(text="the orange block")) == scene.roles["manipulated"]
    for other in ("the blue block", "the green block", "the orange thing"):
        with pytest.raises(TargetError):
            find(scene, Target(text=other))


@pytest.mark.parametrize("opening", [None, np.ones(LENGTH)])
def test_a_gripper_that_does_not_close_tells_nothing(opening: np.ndarray | None) -> None:
    assert "manipulated" not in build(episode(("block",), opening), with_bodies=True).roles


def test_what_cannot_be_told_from_the_table_keeps_it_from_edits() -> None:
    scene = build(episode(("table",), SHUTS), with_bodies=True)
    assert "table" not in scene.roles
    with pytest.raises(TargetError, match="the gripper closes on something"):
        find(scene, Target(role="table"))
    assert "background" in scene.roles


def test_a_camera_that_sees_the_fingers_before_the_table_alone_takes_nothing_from_it() -> None:
    """Where the others see them before something else, the gripper is above the table."""
    scene = build(episode(("table", "block"), SHUTS), with_bodies=True)
    assert "table" in scene.roles


def drawn(hand: int | None = None, thing: int = 2) -> np.ndarray:
    """Instance ids of a table with a thing on it and, from this column on, a hand."""
    out = np.full((SIZE, SIZE), 2)
    out[30:40, 30:40] = thing
    if hand is not None:
        out[:38, hand : hand + 6] = 1
    return out


def told(frames: list[np.ndarray], thing: int) -> gripped.Gripped:
    """What is gripped if a gripper closes in the last but one of these frames."""
    return gripped.find(
        {"a": drawn(None, thing)}, lambda t: {"a": frames[t]}, len(frames) - 2, len(frames) - 1
    )


def test_a_thing_that_went_away_unseen_is_not_taken() -> None:
    hand = drawn(32, 7)
    assert told([drawn(None, 7), hand, hand], 7).thing == 7
    assert told([drawn(None, 7), hand, drawn()], 7).thing is None


def test_a_gripper_that_closes_where_it_began_or_on_its_way_tells_nothing() -> None:
    assert told([drawn(8), drawn(30), drawn(32), drawn(32)], 2).within == {2}
    assert told([drawn(32), drawn(32), drawn(32)], 2).within == set()
    assert told([drawn(8), drawn(8), drawn(32), drawn(32)], 2).within == set()


def test_opening_may_have_any_unit() -> None:
    assert gripped.closes(np.array([0.08, 0.08, 0.06])) == 2
    assert gripped.closes(np.array([0.0, 0.04, 0.08])) is None
