"""The phrases of an instruction that name things: their color word, their size or place word, and their nouns."""
# ruff: noqa: E501  # lists of words are easiest to read whole

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rpaug.core import color_space
from rpaug.scene.targets import relations
from rpaug.scene.targets.nouns import HANDLING, TOWARDS, VERBS

STOPS = (
    TOWARDS
    | VERBS
    | relations.FILLERS
    | {
        "for",
        "but",
        "until",
        "both",
        "or",
        "left",
        "right",
        "while",
        "using",
        "near",
        "beside",
        "behind",
        "between",
    }
    | {
        "nearest",
        "closest",
        "farthest",
        "furthest",
        "above",
        "below",
        "beneath",
        "underneath",
        "beyond",
        "next",
    }
)
# Heads of phrases that say where or how, and name no thing.
NOWHERE = frozenset(
    {
        "top", "bottom", "side", "sides", "front", "back", "middle", "center", "centre", "edge", "end", "place", "position",
        "way", "time", "times", "order", "direction", "angle", "hand", "ground", "air", "row", "line", "tower", "pile",
        "off", "other", "others", "away", "together", "upright", "clockwise", "anticlockwise", "same", "last",
    }
)  # fmt: skip
# Words before a color word that are part of it: "dark red", "off-white".
TONES = frozenset(
    {
        "dark", "light", "bright", "pale", "deep", "vivid", "pastel", "neon", "off", "blood", "wine", "brick", "sky",
        "forest", "royal", "baby", "lemon", "snow", "jet",
    }
)  # fmt: skip
PARTICLES = frozenset({"up", "down", "out"})
LARGE, SMALL = "large", "small"
# Words for sizes: which way they mean, and the word for the other way, if there is one that compares as they do.
SIZES: Mapping[str, tuple[str, str | None]] = {
    "large": (LARGE, "small"), "big": (LARGE, "small"), "largest": (LARGE, "smallest"), "biggest": (LARGE, "smallest"),
    "tall": (LARGE, "short"), "tallest": (LARGE, "shortest"), "small": (SMALL, "large"), "little": (SMALL, "large"),
    "tiny": (SMALL, "large"), "smallest": (SMALL, "largest"), "tiniest": (SMALL, "largest"),
    "short": (SMALL, "tall"), "shortest": (SMALL, "tallest"), "flattest": (SMALL, None),
    **dict.fromkeys(("huge", "giant", "larger", "bigger", "taller", "long", "longer", "longest", "wide", "wider", "thick"),
                    (LARGE, None)),
    **dict.fromkeys(("smaller", "shorter", "mini", "narrow", "narrower", "thin", "thinner"), (SMALL, None)),
}  # fmt: skip
PLACES = frozenset(relations.RANKS) - frozenset(SIZES)
# Where a thing stands, told by another: "on" and "in" lead to a goal as often, and are left out.
BESIDE = re.compile(
    r"\b(?:left of|right of|in front of|behind|next to|beside|near|nearest|closest|furthest|farthest|between|close to)\b"
)


@dataclass(frozen=True)
class Word:
    """A word of the text and where it stands there."""

    text: str
    start: int
    end: int


@dataclass(frozen=True)
class InstructionPhrase:
    """A thing in an instruction's words. `color` is the color's own name, `tint` the words for it ("dark red").

    `rank` is a word for its size or its place. `handled` is what a verb such as "grip" or "push" acts on.
    """

    color: str | None
    nouns: tuple[str, ...]
    tint: Word | None = None
    rank: Word | None = None
    handled: bool = False

    def stated(self, rank: str | None = None) -> str:
        """The phrase as a target's words: color, `rank`, and what else tells it."""
        nouns = self.nouns if self.color else self.nouns[-1:]
        return " ".join([*filter(None, (rank, self.color)), *(nouns or ("thing",))])

    @property
    def text(self) -> str:
        """The phrase as it is told to people."""
        return self.stated(self.rank.text if self.rank else None)

    @property
    def ranked(self) -> str | None:
        """The word for size or place, if a target may hold it."""
        return self.rank.text if self.rank and self.rank.text in relations.RANKS else None


def phrases(text: str) -> Iterator[InstructionPhrase]:
    """Every phrase that names a thing, in order."""
    kind: tuple[str, ...] = ()
    for group in _groups(text):
        for part in _by_color(group):
            phrase = _phrase(part)
            if phrase is None:
                continue
            phrase = replace(phrase, handled=_handled(text[: part[0].start]))
            if phrase.nouns[-1:] in (("one",), ("ones",)):  # "the small cup into the large one"
                phrase = replace(phrase, nouns=kind)
            kind = phrase.nouns[-1:] or kind
            if phrase.nouns or phrase.color:
                yield phrase


def _groups(text: str) -> Iterator[list[Word]]:
    """Runs of words with nothing between them; of one that begins a clause, without its verb."""
    run: list[Word] = []
    before: Word | None = None
    led = False  # by a word after which a thing is named
    for match in re.finditer(r"[A-Za-z]+", text):
        word = Word(match.group().lower(), match.start(), match.end())
        between = text[before.end : word.start] if before else ""
        apart = bool(re.search(r"[^\s\d-]", between))
        stops = word.text in STOPS and not _side_of(word, text)
        if run and (apart or stops):
            yield run
            run = []
        if stops:
            led = word.text not in ("and", "then", "but", "or")
        elif run or _named(word, between) or (led and not apart):
            run.append(word)
        else:
            led = True  # a clause begins with its verb, whatever that is
        before = word
    if run:
        yield run


def _side_of(word: Word, text: str) -> bool:
    """Does "left" or "right" tell a thing that follows: "the left door", not "the left of the door"?"""
    following = re.match(r"[\s-]+([a-z]+)", text[word.end :].lower())
    return word.text in ("left", "right") and following is not None and following[1] not in STOPS


def _named(word: Word, between: str) -> bool:
    """Does a thing begin here, whatever stands before: with a color, or after a number?"""
    return _colored(word) or bool(re.search(r"\d", between))


def _handled(before: str) -> bool:
    """Does a verb that takes hold of things stand right before, articles and particles ("up") apart?"""
    words = re.findall(r"[a-z]+|[^a-z\s]", before.lower())
    stated = [word for word in words if word not in relations.FILLERS | PARTICLES]
    return bool(stated) and stated[-1] in HANDLING


def _colored(word: Word) -> bool:
    return color_space.canonical(word.text) is not None


def _tint(words: Sequence[Word]) -> Sequence[Word]:
    """The first color words of a run that stand together, with their tone: "navy blue", "dark red"."""
    start = next((k for k, word in enumerate(words) if _colored(word)), len(words))
    stop = start
    while stop < len(words) and _colored(words[stop]):
        stop += 1
    while start and start < stop and words[start - 1].text in TONES:
        start -= 1
    return words[start:stop]


def _by_color(group: Sequence[Word]) -> Iterator[list[Word]]:
    """A run of words, cut before all color words but the first."""
    start = 0
    tint = _tint(group)
    while tint:
        stop = group.index(tint[-1]) + 1
        tint = _tint(group[stop:])
        end = group.index(tint[0]) if tint else len(group)
        yield list(group[start:end])
        start = end
    if not start:
        yield list(group)


def _phrase(words: Sequence[Word]) -> InstructionPhrase | None:
    tints = _tint(words)
    ranks = [word for word in words if word.text in SIZES or word.text in PLACES]
    nouns = tuple(word.text for word in words if word not in tints and word not in ranks)
    while nouns and nouns[-1] in NOWHERE:
        nouns = nouns[:-1]
    color = color_space.canonical(tints[-1].text) if tints else None
    spelled = " ".join(word.text for word in tints)
    tint = Word(spelled, tints[0].start, tints[-1].end) if tints else None
    rank = ranks[0] if ranks else None
    # "the orange on the plate" is a fruit, and "the orange" alone has no noun.
    if color == "orange" and not nouns:
        return InstructionPhrase(None, ("orange",), None, rank)
    if not nouns and color is None:
        return None
    return InstructionPhrase(color, nouns, tint, rank)


def changed(text: str, word: Word, new: str) -> str:
    """The text with another word in a word's place, or none, its article and its capitals kept right."""
    before, after = text[: word.start], text[word.end :]
    old = text[word.start : word.end]
    if new and len(old) > 1 and old.isupper():
        new = new.upper()
    if not new:  # the word after it takes its place
        new, after = after.lstrip(), ""
    if old[:1].isupper():
        new = new[:1].upper() + new[1:]
    article = re.search(r"\b([Aa])[nN]?( +)$", before)
    if article:
        vowel = "N" if new[:2].isupper() else "n"
        right = article[1] + (vowel if new[:1].lower() in tuple("aeiou") else "")
        before = before[: article.start()] + right + article[2]
    return before + new + after
