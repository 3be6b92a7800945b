"""The instruction follows the edit: what was "the red cup" is "the blue cup" once it is blue, and only then.

A word of an instruction is changed where the thing it tells of was changed as a whole: a color word where it was
painted, a size word where it is the largest now that was the smallest. Where that cannot be told, where the thing is no
longer there, or where the words would now fit another thing as well, the copy is rejected rather than written with
words that lie.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpaug.core.interfaces import Edit, Operator
from rpaug.core.types import Scene
from rpaug.instruct import changes
from rpaug.instruct.judging import Judge, Untrue
from rpaug.instruct.phrases import phrases
from rpaug.instruct.wording import Wording
from rpaug.providers.language import LanguageError
from rpaug.scene.targets.nouns import HANDLING

__all__ = ["Followed", "Untrue", "followed", "phrases", "wording"]

# Articles, joining words and colors that English lacks. Where one stands the rules cannot read.
FOREIGN = frozenset(
    {
        "le", "la", "les", "une", "du", "des", "et", "dans", "sur", "el", "los", "las", "una", "y", "del", "al", "en",
        "der", "das", "dem", "den", "ein", "eine", "einen", "und", "auf", "il", "lo", "gli", "e", "nel", "o", "os",
        "um", "uma", "het", "een", "de", "op", "rouge", "bleu", "vert", "jaune", "noir", "blanc", "rojo", "azul",
        "verde", "amarillo", "negro", "blanco", "rot", "rote", "roten", "rotes", "blau", "blaue", "blauen", "gelb",
        "gelbe", "schwarz", "rosso", "giallo", "nero", "bianco", "vermelho", "amarelo", "preto", "branco", "rood",
        "rode", "blauw", "groen", "geel", "zwart",
    }
)  # fmt: skip
ENGLISH = HANDLING | {"the", "it", "up", "then", "with", "of", "and"}


@dataclass(frozen=True)
class Followed:
    """The descriptions after the edits; `left` says in sentences which stayed as they were though they may not hold,
    and what a model was asked for in vain."""

    texts: tuple[str, ...]
    left: tuple[str, ...] = ()


def followed(
    scene: Scene,
    edits: Sequence[tuple[Operator, Edit]],
    model: Wording | None = None,
    rng: np.random.Generator | None = None,
) -> Followed:
    """The descriptions after the edits. Raises Untrue.

    `scene` is the edited one, `edits` are what was drawn, in order, by the operators that drew it. A `model` may be
    asked before the rules, and for paraphrases, of which `rng` draws.
    """
    made = changes.of(scene, edits)
    if not made and model is None:
        return Followed(scene.descriptions)
    judge = Judge(changes.recorded(scene), changes.rearranged(scene), made)
    left: list[str] = []
    after = tuple(
        _worded(text, judge, model, left) if made else text for text in scene.descriptions
    )
    for text in after:
        _see_nothing_old(text, scene.descriptions, after)
    if model is not None and model.paraphrases and rng is not None:
        varied = [
            model.varied(text, judge, rng) if _english(text) else (text, _unread(text))
            for text in after
        ]
        after = tuple(text for text, _ in varied)
        left += [why for _, why in varied if why and why not in left]
    return Followed(after, tuple(left))


def _worded(text: str, judge: Judge, model: Wording | None, left: list[str]) -> str:
    """One description after the edits, by the model or by the rules. Raises Untrue."""
    readable = _english(text)
    if model is not None and model.first:
        try:
            return model.rewritten(text, judge, readable)
        except LanguageError as error:
            left.append(f"{text!r} was worded by rules: {error}")
    if not readable:
        left.append(_unread(text))
    return judge.rewritten(text) if readable else text


def _unread(text: str) -> str:
    return f"{text!r} is not in English: it was left as it is and may not hold after the edits"


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
