"""The instruction follows the edit: what was "the red cup" is "the blue cup" once it is blue, and only then.

A word of an instruction is changed where the thing it tells of was changed as a whole: a color word where it was
painted, a size word where it is the largest now that was the smallest. Where that cannot be told, where the thing is no
longer there, or where the words would now fit another thing as well, the copy is rejected rather than written with
words that lie.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rpaug.core.interfaces import Edit, Operator
from rpaug.core.types import Scene
from rpaug.instruct import changes
from rpaug.instruct.judging import Judge, Untrue
from rpaug.instruct.phrases import phrases
from rpaug.scene.targets.nouns import HANDLING

__all__ = ["Followed", "Untrue", "followed", "phrases"]

# Articles and joining words that English lacks. Where one stands the rules cannot read.
FOREIGN = frozenset(
    {
        "le", "la", "les", "une", "du", "des", "et", "dans", "sur", "el", "los", "las", "una", "y", "del", "al", "en",
        "der", "das", "dem", "den", "ein", "eine", "einen", "und", "auf", "il", "lo", "gli", "e", "nel", "o", "os",
        "um", "uma", "het", "een", "de", "op",
    }
)  # fmt: skip
ENGLISH = HANDLING | {"the", "it", "up", "then", "with", "of", "and"}


@dataclass(frozen=True)
class Followed:
    """The descriptions after the edits; `left` says in sentences which stayed as they were though they may not hold."""

    texts: tuple[str, ...]
    left: tuple[str, ...] = ()


def followed(scene: Scene, edits: Sequence[tuple[Operator, Edit]]) -> Followed:
    """The descriptions after the edits. Raises Untrue.

    `scene` is the edited one, `edits` are what was drawn, in order, by the operators that drew it.
    """
    made = changes.of(scene, edits)
    if not made:
        return Followed(scene.descriptions)
    judge = Judge(changes.recorded(scene), changes.rearranged(scene), made)
    read = [any(True for _ in phrases(text)) and _english(text) for text in scene.descriptions]
    after = tuple(
        judge.rewritten(text) if known else text
        for text, known in zip(scene.descriptions, read, strict=True)
    )
    for text in after:
        _see_nothing_old(text, scene.descriptions, after)
    left = tuple(
        f"{text!r} is not in English: it was left as it is and may not hold after the edits"
        for text in scene.descriptions
        if not _english(text)
    )
    return Followed(after, left)


def _english(text: str) -> bool:
    """Could a text be English, as far as its commonest words tell? One of color and noun alone could."""
    words = {*re.findall(r"[^\W\d_]+", text.lower())}
    letters = not words or all(word.isascii() for word in words)
    return bool(words & ENGLISH or letters) and not words & FOREIGN


def _see_nothing_old(text: str, before: Sequence[str], after: Sequence[str]) -> None:
    """See that words joined by "_", which are not read as phrases ("lift_pink_block"), hold none that was replaced in
    the other words of the episode. Raises Untrue."""
    replaced = {
        word
        for old, new in zip(before, after, strict=True)
        for word in {*old.lower().split()} - {*new.lower().split()}
    }
    joined = {part for word in text.lower().split() if "_" in word for part in word.split("_")}
    if stale := sorted(joined & replaced):
        raise Untrue(f"{text!r} still says {stale[0]!r}, and it is not known how to mend it")
