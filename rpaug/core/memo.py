"""What was found of a scene, kept for whoever asks again: edits are tried before they are drawn, and drawn again."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields, replace
from functools import wraps
from operator import attrgetter
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from rpaug.core.types import Episode, Rig, Scene

ANSWERS = 32  # kept of an episode
PLAIN = (frozenset, Rig, str)  # the same where they are equal
kept_scenes = (
    1  # whose answers `last` keeps: those that go episode by episode need one, training sets more
)

OF_FIELDS: dict[type, Callable[[Any], tuple[Any, ...]]] = {
    kind: attrgetter(*(f.name for f in fields(kind))) for kind in (Scene, Episode)
}

Found = TypeVar("Found")


def keep(scenes: int) -> None:
    """Let `last` keep answers of that many scenes from now on, for those who ask of scenes by turns."""
    global kept_scenes  # one process, one way to ask
    kept_scenes = max(kept_scenes, scenes)


def once(find: Callable[..., Found]) -> Callable[..., Found]:
    """Remember the last answer, for the very same arguments: objects, sets, lamps, words; tuples, episodes, scenes
    of such."""
    return _remembering(find, lambda: 1)


def last(find: Callable[..., Found]) -> Callable[..., Found]:
    """As `once`, the last answers, as many as `keep` said: for answers that take little memory."""
    return _remembering(find, lambda: kept_scenes)


def _remembering(find: Callable[..., Found], most: Callable[[], int]) -> Callable[..., Found]:
    held: tuple[tuple[tuple[Any, ...], Found], ...] = ()  # never changed: threads may be reading it

    @wraps(find)
    def remembered(*arguments: Any) -> Found:
        nonlocal held
        for known, answer in held:
            if len(known) == len(arguments) and all(map(_same, known, arguments)):
                return answer
        answer = find(*arguments)
        held = ((arguments, answer), *held)[: most()]
        return answer

    return remembered


def _same(one: object, other: object) -> bool:
    if one is other:
        return True
    kind = type(one)
    if kind is not type(other):
        return False
    if kind is tuple or kind in OF_FIELDS:
        values = OF_FIELDS.get(kind, tuple)
        parts, others = values(one), values(other)
        if len(parts) != len(others):
            return False
        return all(
            part is beside or _same(part, beside)
            for part, beside in zip(parts, others, strict=True)
        )
    return kind in PLAIN and one == other


def bare(scene: Scene) -> Scene:
    """The scene without what changes colors or words alone: what stands where, which such edits do not alter."""
    return replace(scene, appearance=(), sensor=(), ambience=None, descriptions=(), relit=None)


def recorded(episode: Episode) -> Episode:
    """The episode without what a recipe makes of its words: what is found in its images hangs on no recipe."""
    return replace(episode, embeddings=Episode.embeddings)


def of_episode(find: Callable[..., Found]) -> Callable[..., Found]:
    """Remember some answers for as long as the episode, the first argument, lives; the others are hashable."""
    every: WeakKeyDictionary[Episode, OrderedDict[Hashable, Found]] = WeakKeyDictionary()

    @wraps(find)
    def remembered(episode: Episode, *arguments: Hashable) -> Found:
        answers = every.setdefault(episode, OrderedDict())
        if arguments not in answers:
            answers[arguments] = find(episode, *arguments)
        answers.move_to_end(arguments)
        while len(answers) > ANSWERS:
            answers.popitem(last=False)
        return answers[arguments]

    return remembered
