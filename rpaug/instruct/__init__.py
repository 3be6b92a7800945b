"""The instruction follows the edit: what was "the red cup" is "the blue cup" once it is blue, and only then.

A word of an instruction is changed where the thing it tells of was changed as a whole: a color word where it was
painted, a size word where it is the largest now that was the smallest. Where that cannot be told, where the thing is no
longer there, or where the words would now fit another thing as well, the copy is rejected rather than written with
words that lie.
"""

from collections.abc import Sequence

from rpaug.core.interfaces import Edit, Operator
from rpaug.core.types import Scene
from rpaug.instruct import changes
from rpaug.instruct.judging import Judge, Untrue
from rpaug.instruct.phrases import phrases

__all__ = ["Untrue", "followed", "phrases"]


def followed(scene: Scene, edits: Sequence[tuple[Operator, Edit]]) -> tuple[str, ...]:
    """The descriptions after the edits. Raises Untrue.

    `scene` is the edited one, `edits` are what was drawn, in order, by the operators that drew it.
    """
    if not any(True for text in scene.descriptions for _ in phrases(text)):
        return scene.descriptions
    made = changes.of(scene, edits)
    if not made:
        return scene.descriptions
    judge = Judge(changes.recorded(scene), changes.rearranged(scene), made)
    after = tuple(judge.rewritten(text) for text in scene.descriptions)
    for text in after:
        _see_nothing_old(text, scene.descriptions, after)
    return after


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
