"""Rules of the offline grammar: a pattern that a whole step must fit, to the last word, and what it then means.

In a pattern `{thing}` and the like stand for slots. Nothing is skipped: a word that no rule accounts for makes the
step not understood. A rule that finds its slots senseless passes; one that knows why it must refuse says so.
"""

import itertools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rpaug.language import slots
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Wish
from rpaug.language.verbs import VERBS

# At least one word after articles, so that "the" alone is never taken for a thing.
THING = r"(?:(?:all|every|each|both)(?: of)? )?(?:the )?(?!(?:the|an?|all|every|each|both) )[a-z0-9_#-][a-z0-9_#, -]*?"
SLOTS: Mapping[str, str] = {
    "thing": THING,
    "other": THING,
    "asset": r"[a-z0-9_# -]+?",
    "texture": r"[a-z_ ]+?",
    "camera": r"[a-z0-9_ ,-]*?cam(?:era)?s?|it|them",
    "motion": r"[a-z0-9., ]+?",
    "color": slots.COLOR,
    "tint": slots.ONE_COLOR,
    "number": slots.NUMBER,
    "low": slots.DIGITS,
    "high": slots.DIGITS,
    "length": slots.LENGTH,
    "least": slots.LENGTH,
    "angle": slots.ANGLE,
    "share": slots.PERCENT,
    "point": slots.POINT,
    "triple": slots.TRIPLE,
}
PHRASES: Mapping[str, str] = {
    "LIGHT": r"(?:the |all |every )?(?:of the |the )?(?:scene(?:'s)? |room )?"
    r"(?:lights?|lamps?|lighting|illumination|light sources?|light bulbs?)",
    "IMAGES": r"(?:the |all |all the |all of the |every |each |its )?"
    r"(?:(?:rendered|final|finished|output|rgb|colou?r|camera) )?"
    r"(?:images?|pictures?|photos?|frames?|videos?|views?|footage)",
    "UP_TO": r"(?:by |of |within )?"
    r"(?:(?:anything |any amount )?up to|at most|no more than|a maximum of|max|a max of|maximally)",
    **VERBS,
}


class NotThis(Exception):
    """A rule's pattern fits and its slots make no sense: another rule may be meant."""


@dataclass(frozen=True)
class Said:
    """A step that fits a rule: the words in its slots, and the wish it belongs to."""

    slots: Mapping[str, str]
    wish: Wish

    def __getitem__(self, name: str) -> str:
        """What fills a slot that the pattern demands."""
        return self.slots[name]

    def get(self, name: str) -> str | None:
        """What fills a slot, or None."""
        return self.slots.get(name)


Make = Callable[[Said], Meant]


@dataclass(frozen=True)
class Rule:
    """One way to say something."""

    patterns: tuple[re.Pattern[str], ...]
    make: Make

    def __call__(self, text: str, wish: Wish) -> Meant | None:
        """What the text means by this rule; None if nothing. Raises NotUnderstood with a reason of its own."""
        for pattern in self.patterns:
            found = pattern.fullmatch(text)
            if found:
                try:
                    stated = {
                        name.split("__")[0]: value
                        for name, value in found.groupdict().items()
                        if value is not None
                    }
                    return self.make(Said(stated, wish))
                except NotThis:
                    continue
        return None


RULES: list[Rule] = []


def rule(*patterns: str) -> Callable[[Make], Make]:
    """Add a rule. Earlier rules are tried first."""

    def add(make: Make) -> Make:
        RULES.append(Rule(tuple(compiled(pattern) for pattern in patterns), make))
        return make

    return add


def compiled(pattern: str) -> re.Pattern[str]:
    """A pattern with its slots filled in; one that stands in several alternatives is told apart by a number."""
    for name, phrase in PHRASES.items():
        pattern = pattern.replace(f"<{name}>", phrase)
    for name, slot in SLOTS.items():
        pattern = pattern.replace("{" + name + "}", f"(?P<{name}>{slot})")
    place = itertools.count()
    return re.compile(re.sub(r"\(\?P<(\w+)>", lambda m: f"(?P<{m[1]}__{next(place)}>", pattern))


def done(
    *edits: Entry,
    mention: Mention | None = None,
    notes: tuple[str, ...] = (),
    replaces: tuple[int, ...] = (),
) -> Meant:
    """What a rule gives back."""
    return Meant(edits=edits, mention=mention, notes=notes, replaces=replaces)


def refuse(reason: str) -> NotUnderstood:
    """An error that ends the search."""
    return NotUnderstood(reason)
