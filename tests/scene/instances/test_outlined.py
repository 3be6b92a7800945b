"""Masks that words were found by, in some frames of some cameras, become instances of all frames and cameras."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rpaug.core.types import Camera, CameraView, Episode, Robot
from rpaug.providers.detect import Detection
from rpaug.providers.finder import AskedImage, plain
from rpaug.providers.models_settings import Models
from rpaug.scene.instances import by_models, outlined
from rpaug.scene.instances.by_models import AskedModels, voted
from rpaug.scene.instances.outlined import FIRST_ID, Outlined

LENGTH, SIDE = 12, 64
Where = Callable[[int], tuple[int, int]]


def square(at: tuple[int, int], size: int = 10) -> np.ndarray:
    mask = np.zeros((SIDE, SIDE), bool)
    mask[at[0] : at[0] + size, at[1] : at[1] + size] = True
    return mask


def rests(t: int) -> tuple[int, int]:
    return 40, 8


def moves(t: int) -> tuple[int, int]:
    return 10, 4 + 4 * t


class Scripted:
    """Says in each camera what it was told of each frame."""

    name = "scripted"

    def __init__(self, said: Mapping[str, Mapping[tuple[str, int], Sequence[Detection]]]) -> None:
        self.said, self.asked = said, list[tuple[str, int, str]]()

    def frames(self, episode: str, camera: str, length: int) -> Sequence[int]:
        return range(length)

    def knows(self, episode: str, words: str) -> bool:
        return True

    def __call__(self, asked: AskedImage, words: str) -> list[Detection]:
        self.asked.append((asked.camera, asked.frame, words))
        known = {plain(one): seen for one, seen in self.said.items()}
        return list(known.get(words, {}).get((asked.camera, asked.frame), ()))


def seen(where: Where, times: Sequence[int] = range(LENGTH), camera: str = "a", score: float = 0.9):
    return {(camera, t): [Detection((0, 0, 1, 1), score, square(where(t)))] for t in times}


def episode(*cameras: str) -> Episode:
    ground = np.random.default_rng(0).integers(90, 120, (SIDE, SIDE, 3)).astype(np.uint8)

    def rgb(t: int) -> np.ndarray:
        image = ground.copy()
        image[square(rests(t))] = (200, 30, 30)
        image[square(moves(t))] = (30, 60, 200)
        return image

    still = np.tile(np.eye(4), (LENGTH, 1, 1))
    K = np.array([[80.0, 0, 31.5], [0, 80, 31.5], [0, 0, 1]])
    views = {
        name: CameraView(Camera(K, still, SIDE, SIDE, assumed=True), rgb)
        for name in cameras or ("a",)
    }
    robot = Robot(np.zeros((LENGTH, 0)), np.zeros((LENGTH, 0)), None, None)
    return Episode("e", views, robot, (), LENGTH)


def found(
    said: Mapping[str, Mapping[tuple[str, int], Sequence[Detection]]], *cameras: str
) -> Outlined:
    return outlined.find(episode(*cameras), list(said), Scripted(said), lambda share: None)


def test_one_thing_has_one_id_in_all_frames_and_cameras() -> None:
    made = found({"the cup": seen(rests) | seen(rests, camera="b"), "block": seen(moves)}, "a", "b")
    (cup,), (block,) = made.names["cup"], made.names["block"]
    assert {cup, block} == {FIRST_ID, FIRST_ID + 1}
    for t in range(LENGTH):
        np.testing.assert_array_equal(made.at("a", t) == cup, square(rests(t)))
        np.testing.assert_array_equal(made.at("a", t) == block, square(moves(t)))
        np.testing.assert_array_equal(made.at("b", t) == cup, square(rests(t)))
    assert made.moved == {block}
    assert made.instance_ids == {cup, block}


@pytest.mark.parametrize("where", [rests, moves])
def test_frames_that_a_model_missed_are_filled(where: Where) -> None:
    made = found({"thing": seen(where, [0, 1, 2, 4, 5, 8, 9, 10, 11])})
    for t in (3, 6, 7):
        true = square(where(t))
        got = made.at("a", t) > 0
        assert (got & true).sum() / (got | true).sum() > (0.95 if where is rests else 0.7), t


def test_a_mask_is_carried_from_the_nearer_side_of_a_gap() -> None:
    made = found({"thing": seen(moves, [0, 1, 2, 3, 4, 9, 10, 11])})
    for t in (5, 6, 7, 8):
        true, got = square(moves(t)), made.at("a", t) > 0
        assert (got & true).sum() / (got | true).sum() > 0.9, t


def test_a_thing_is_there_before_it_was_seen_first_if_it_rests() -> None:
    made = found({"cup": seen(rests, [3, 4, 5, 6]), "block": seen(moves, [3, 4, 5, 6])})
    (cup,), (block,) = made.names["cup"], made.names["block"]
    for t in (0, 11):
        np.testing.assert_array_equal(made.at("a", t) == cup, square(rests(t)))
        assert not (made.at("a", t) == block).any()


def test_a_resting_thing_is_not_where_something_passes_before_it() -> None:
    """Frames 4 to 7 were missed, and in frame 5 the moving block lies over a corner of it."""
    bare = episode()
    plain = bare.views["a"].rgb

    def rgb(t: int) -> np.ndarray:
        image = plain(t).copy()
        if t == 5:
            image[40:46, 8:13] = (20, 200, 20)
        return image

    covered = replace(bare, views={"a": replace(bare.views["a"], rgb=rgb)})
    said = {"cup": seen(rests, [0, 1, 2, 3, 8, 9, 10, 11])}
    made = outlined.find(covered, ["cup"], Scripted(said), lambda share: None)
    got = made.at("a", 5) > 0
    assert not got[41:45, 9:12].any()
    assert got[47:50, 8:18].all()


def test_what_is_seen_for_a_moment_is_nothing() -> None:
    said = {"cup": {("a", 3): [Detection((0, 0, 1, 1), 0.99, square((50, 50)))]}}
    made = found(said)
    assert made.names == {"cup": frozenset()}
    assert not made.ids["a"].any()
    assert "found none" in made.notes[0]


def test_a_wrong_thing_for_a_moment_does_not_carry_the_right_one_away() -> None:
    said = seen(rests)
    said["a", 6] = [Detection((0, 0, 1, 1), 0.9, square((2, 50)))]
    made = found({"cup": said})
    (cup,) = made.names["cup"]
    np.testing.assert_array_equal(made.at("a", 6) == cup, square(rests(6)))


def test_two_things_of_one_name_stay_two_and_are_not_guessed_across_cameras() -> None:
    both = {
        ("a", t): [Detection((0, 0, 1, 1), 0.9, square(w(t))) for w in (rests, moves)]
        for t in range(LENGTH)
    }
    made = found({"cup": both | seen(rests, camera="b")}, "a", "b")
    assert len(made.names["cup"]) == 3


def test_two_names_of_one_thing_are_one_instance() -> None:
    made = found({"cup": seen(rests), "red cup": seen(rests), "block": seen(moves)})
    assert made.names["cup"] == made.names["red cup"] != made.names["block"]


def test_a_weak_second_thing_is_none() -> None:
    said = seen(rests)
    for t in range(LENGTH):
        said["a", t] = [*said["a", t], Detection((0, 0, 1, 1), 0.3, square(moves(t)))]
    assert len(found({"cup": said}).names["cup"]) == 1


def test_models_are_asked_once_for_the_same_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RPAUG_CACHE", str(tmp_path))
    scripted = Scripted({"cup": seen(rests)})
    monkeypatch.setattr(by_models, "_finder", lambda models: scripted)
    known = AskedModels(Models(text="x"), ("cup",))
    first = known.outlined(episode())
    count = len(scripted.asked)
    again = known.outlined(episode())
    assert count == LENGTH == len(scripted.asked)
    assert first is not None
    assert again is not None
    assert again.names == first.names
    assert again.notes == first.notes
    np.testing.assert_array_equal(again.ids["a"], first.ids["a"])
    other = replace(
        episode(),
        views={
            "a": replace(episode().views["a"], rgb=lambda t: np.zeros((SIDE, SIDE, 3), np.uint8))
        },
    )
    known.outlined(other)
    assert len(scripted.asked) == 2 * LENGTH
    assert AskedModels(Models(), ("cup",)).outlined(episode()) is None
    assert AskedModels(Models(text="x")).outlined(episode()) is None


def test_recorded_masks_are_named_by_what_lies_in_the_outlines() -> None:
    bare = episode()

    def ids(t: int) -> np.ndarray:
        out = np.full((SIDE, SIDE), 1, np.int32)
        out[square(rests(t))] = 7
        out[square(moves(t))] = 9
        return out

    masked = replace(bare, views={"a": replace(bare.views["a"], ids=ids)})
    said = {"cup": seen(rests), "half": seen(lambda t: (2, 48)), "none": {}}
    made = outlined.find(masked, list(said), Scripted(said), lambda share: None)
    names, notes = voted(masked, made)
    assert names == {"cup": frozenset({7}), "half": frozenset(), "none": frozenset()}
    assert any("of no instance of the masks" in one for one in notes)
