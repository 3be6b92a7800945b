"""What was found of a scene, kept for whoever asks again: edits are tried before they are drawn, and drawn again."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields, replace
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from rpaug.core.types import Episode, Scene

ANSWERS = 32  # kept of an episode

Found = TypeVar("Found")


def once(find: Callable[..., Found]) -> Callable[..., Found]:
    """Remember the last answer, for the very same arguments: objects, sets, and tuples, episodes, scenes of such."""
    last: list[tuple[tuple[Any, ...], Found]] = []

    @wraps(find)
    def remembered(*arguments: Any) -> Found:
        for known, answer in last:
            if len(known) == len(arguments) and all(map(_same, known, arguments)):
                return answer
        answer = find(*arguments)
        last[:] = [(arguments, answer)]
        return answer

    return remembered


def _same(one: object, other: object) -> bool:
    if one is other:
        return True
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    for kind in (Scene, Episode):
        if isinstance(one, kind) and isinstance(other, kind):
            return all(_same(getattr(one, f.name), getattr(other, f.name)) for f in fields(kind))
    return isinstance(one, frozenset) and one == other


def bare(scene: Scene) -> Scene:
    """The scene without what changes colors or words alone: what stands where, which such edits do not alter."""
    return replace(scene, appearance=(), sensor=(), ambience=None, descriptions=())


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
