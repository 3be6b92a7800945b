"""Words that look misspelt, to be told with a refusal; nothing is ever read as another word than it is."""

import difflib
import re
from collections.abc import Collection
from functools import cache

from rpaug.assets import library
from rpaug.core import color_space, registry
from rpaug.language.grammar import RULES
from rpaug.language.slots import METRES, RADIANS, WORDS
from rpaug.scene.targets import shapes
from rpaug.scene.targets.nouns import ROLES

ALIKE = 0.84  # share of letters in common, as difflib counts it
SHORTEST = 3  # letters of a word that can be judged


def hint(step: str) -> str:
    """What the unknown words of a step may be, in brackets; empty if they are like nothing."""
    pairs = [(word, _like(word)) for word in dict.fromkeys(re.findall(r"[a-z]+", step))]
    given = ", ".join(f"{word!r} may be {known!r}" for word, known in pairs if known)
    return f" ({given})" if given else ""


def _like(word: str) -> str | None:
    """The known word that an unknown one may be."""
    if len(word) < SHORTEST or word in vocabulary() or word.removesuffix("s") in vocabulary():
        return None
    return nearest(word, vocabulary())


def nearest(word: str, known: Collection[str]) -> str | None:
    """The known word of the same letters in another order, or of nearly the same letters; None if there is none."""
    turned = [other for other in known if sorted(other) == sorted(word)]
    return next(iter(turned or difflib.get_close_matches(word, known, 1, ALIKE)), None)


@cache
def vocabulary() -> tuple[str, ...]:
    """All words that rules, colors, units, shapes and the library know."""
    patterns = " ".join(one.pattern for rule in RULES for one in rule.patterns)
    bare = re.sub(r"\(\?P<\w+>|\\[a-z]", " ", patterns)
    phrases = " ".join(
        text for name in registry.operator_names() for text in registry.operator(name).phrases
    )
    things = " ".join(one.category for one in library.assets())
    bare = f"{bare} {phrases} the all"
    known = f"{bare} {things} {' '.join((*METRES, *RADIANS, *WORDS, *shapes.WORDS, *ROLES, *color_space.NAMES))}"
    return tuple(sorted({word for word in re.findall(r"[a-z]+", known) if len(word) >= SHORTEST}))
