"""What was found last, kept for whoever asks again about the same scene: edits are tried before they are drawn."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

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
