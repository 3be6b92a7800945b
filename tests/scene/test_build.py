"""Which of four sources tells an episode's instances: one choice, and what follows where it fails."""

from dataclasses import dataclass, replace

import pytest
from analytic import scene as analytic_scene

from rpaug.core.errors import Unsupported
from rpaug.core.types import CameraView, Embeddings, Episode
from rpaug.scene.build import ByImages, ByMasks, ByMotion, find, sources
from rpaug.scene.instances.found import FoundInstances
from rpaug.scene.video.reconstruct import ByVideo


@dataclass(frozen=True)
class Refusing:
    """A source that takes every episode and can tell nothing of it."""

    gives_way: bool

    def suits(self, episode: Episode) -> bool:
        return True

    def find(self, episode: Episode) -> FoundInstances:
        raise Unsupported("nothing is seen")


def episode(**fields: None) -> Episode:
    """Two still cameras, less what `fields` take away."""
    recorded = analytic_scene({"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}, length=2)
    views = recorded.episode.views.items()
    less: dict[str, CameraView] = {name: replace(view, **fields) for name, view in views}
    return replace(recorded.episode, views=less)


@pytest.mark.parametrize(
    ("lacks", "kind"),
    [
        ({}, ByMasks),
        ({"depth": None}, ByMasks),
        ({"ids": None}, ByMotion),
        ({"depth": None, "ids": None}, ByImages),
    ],
    ids=["all", "masks alone", "depth alone", "images alone"],
)
def test_the_first_that_suits_is_taken(lacks: dict[str, None], kind: type) -> None:
    given = episode(**lacks)
    among = sources(tuple, video=ByVideo())
    assert isinstance(next(one for one in among if one.suits(given)), kind)


def test_copies_of_an_episode_are_tracked_once() -> None:
    given, among = episode(), (ByMasks(()),)
    first = find(given, among)
    again = find(replace(given, embeddings=Embeddings(drop=True)), among)
    assert again.bodies is first.bodies
    assert again.episode.embeddings.drop
    assert find(replace(given, views=dict(given.views)), among).bodies is not first.bodies


def test_arms_are_not_read_where_a_video_is_taken() -> None:
    def unread() -> tuple[()]:
        raise AssertionError

    first = next(sources(unread, video=Refusing(gives_way=True)))
    assert first.suits(episode())


def test_a_source_that_gives_way_is_noted_and_the_next_one_tells() -> None:
    found = find(episode(depth=None), [Refusing(gives_way=True), ByMasks(())])
    assert found.notes == ("nothing is seen; rpaug falls back to images only",)
    assert {body.motion for body in found.bodies} == {"unknown"}
    assert found.scene().bodies == found.bodies


def test_a_source_that_does_not_give_way_is_the_last_word() -> None:
    with pytest.raises(Unsupported, match="nothing is seen"):
        find(episode(), [Refusing(gives_way=False), ByMasks(())])
