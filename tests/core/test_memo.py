"""The last answer is kept for the very same question, and for no other."""

from dataclasses import replace

from analytic import scene

from rpaug.core.memo import bare, last, once
from rpaug.core.types import Rig, Scene
from rpaug.scene.sampled_frames import look


def test_the_same_question_is_answered_once():
    asked = []

    @once
    def find(thing: object, some: frozenset[int]) -> int:
        asked.append(thing)
        return len(asked)

    one, other = [1], [1]
    assert find(one, frozenset({1})) == find(one, frozenset([1])) == 1
    assert find(other, frozenset({1})) == 2
    assert find(one, frozenset({2})) == 3
    assert len(asked) == 3


def test_a_scene_is_the_same_while_nothing_of_it_is_another() -> None:
    asked = []

    @once
    def find(shown: Scene) -> int:
        asked.append(shown)
        return len(asked)

    recorded = scene({"front": (1.6, 0.3, 1.0)}, length=2)
    again = replace(recorded, descriptions=("another instruction",), bodies=(*recorded.bodies,))
    assert find(bare(recorded)) == find(bare(again)) == 1
    assert find(again) == 2
    assert find(replace(again, bodies=again.bodies[1:])) == 3


def test_an_episode_is_looked_at_once() -> None:
    recorded = scene({"front": (1.6, 0.3, 1.0)}, length=2).episode
    assert look(recorded) is look(recorded)
    assert look(recorded, [0]).frames.tolist() == [0]
    assert look(replace(recorded)) is look(recorded)
    assert look(replace(recorded, key="other")) is not look(recorded)


def test_the_same_lamps_are_the_same_though_read_twice() -> None:
    asked = []

    @once
    def find(lamps: Rig) -> int:
        asked.append(lamps)
        return len(asked)

    assert (
        find(Rig(0.4, ((0.0, 0.0, 1.0),), (0.6,)))
        == find(Rig(0.4, ((0.0, 0.0, 1.0),), (0.6,)))
        == 1
    )
    assert find(Rig(0.4, ((0.0, 0.6, 0.8),), (0.6,))) == 2


def test_another_question_may_come_while_one_is_looked_up() -> None:
    """As another thread's does."""
    others = iter([frozenset({7})])

    class Asking(frozenset[int]):
        def __eq__(self, other: object) -> bool:
            for one in others:
                find(one)
            return super().__eq__(other)

        __hash__ = frozenset.__hash__

    @last
    def find(some: frozenset[int]) -> int:
        return len(some)

    for some in (Asking({1, 2}), Asking({1, 2, 3}), Asking({1, 2, 3})):
        assert find(some) == len(some)
