"""What was found of a scene, kept for whoever asks again: edits are tried before they are drawn, and drawn again."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from rpaug.types import Episode

ANSWERS = 32  # kept of an episode

Found = TypeVar("Found")


def once(find: Callable[..., Found]) -> Callable[..., Found]:
    """Remember the last answer, for arguments that are the very same objects or equal sets."""
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
    return one is other or (isinstance(one, frozenset) and one == other)


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
