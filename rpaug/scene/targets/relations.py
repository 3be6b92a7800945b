"""The grammar of targets: words into a phrase with attributes, a ranking and relations to other phrases.

    phrase   = attributes [relation phrase [relation phrase ...]]
    e.g.  "the second largest red block left of the cup", "the cup closest to the drawer",
          "the thing between the bowl and the robot", "the leftmost block on top of the pad",
          "the second drawer from the top", "the top left drawer of the cabinet"

Directions are the robot's own: in front of something is on the robot's side of it, behind is beyond it.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from rpaug.core import color_space
from rpaug.scene.targets import roles

FILLERS = frozenset(
    {"the", "a", "an", "all", "every", "some", "of", "that", "is", "which", "are", "most", "its"}
)
ANYTHING = frozenset({"object", "thing", "part", "item", "one", "objects", "things", "instance"})
# What moves on a thing that stays, or is one of several places of it; and what such a part is held by.
PARTS = frozenset(
    {
        "drawer", "door", "lid", "cap", "cover", "hatch", "flap", "seat", "window", "shelf", "layer", "compartment",
        "side", "half", "section", "button", "switch", "dial", "lever", "tap", "wheel", "lock",
    }
)  # fmt: skip
GRIPS = frozenset({"handle", "knob", "grip", "edge", "rim"})

# Longest first: "on top of" is not "on".
RELATIONS: dict[str, tuple[str, ...]] = {
    "left of": ("to the left of", "on the left of", "left of"),
    "right of": ("to the right of", "on the right of", "right of"),
    "in front of": ("in front of",),
    "behind": ("in back of", "at the back of", "behind", "beyond"),
    "on": ("on top of", "resting on", "standing on", "lying on", "atop", "upon", "on"),
    "above": ("above", "over"),
    "below": ("underneath", "beneath", "below", "under"),
    "in": ("inside of", "inside", "within", "in"),
    "part of": ("part of", "of"),
    "between": ("in between", "between"),
    "closest to": ("closest to", "nearest to", "next to", "close to", "beside", "nearest", "closest", "near"),
    "farthest from": ("farthest from", "furthest from", "farthest", "furthest"),
}  # fmt: skip
SPELLED = sorted(
    ((spelling.split(), name) for name, spellings in RELATIONS.items() for spelling in spellings),
    key=lambda entry: -len(entry[0]),
)
RANKS: dict[str, str] = {
    **dict.fromkeys(("largest", "biggest", "large", "big"), "largest"),
    **dict.fromkeys(("smallest", "tiniest", "small", "little", "tiny"), "smallest"),
    **dict.fromkeys(("tallest", "tall"), "tallest"),
    **dict.fromkeys(("shortest", "short", "flattest"), "shortest"),
    **dict.fromkeys(("leftmost", "left"), "leftmost"),
    **dict.fromkeys(("rightmost", "right"), "rightmost"),
    **dict.fromkeys(("frontmost", "foremost", "front"), "frontmost"),
    **dict.fromkeys(("rearmost", "backmost", "hindmost", "back", "rear"), "rearmost"),
    **dict.fromkeys(("highest", "topmost", "uppermost", "top"), "highest"),
    **dict.fromkeys(("lowest", "bottommost", "lowermost", "bottom"), "lowest"),
    **dict.fromkeys(("middle", "central", "center", "centre"), "middle"),
    "upper": "upper",
    "lower": "lower",
}
SIDES = ("top", "bottom", "left", "right", "front", "back", "middle")
WHERE = re.compile(rf"\b(?:on|at|in|from) the ({'|'.join(SIDES)})\b(?! of)")  # after its noun
# Ranks that say where: two of different directions may stand together, "top left".
DIRECTIONS: Mapping[str, int] = {
    **dict.fromkeys(("frontmost", "rearmost"), 0),
    **dict.fromkeys(("leftmost", "rightmost"), 1),
    **dict.fromkeys(("highest", "lowest", "upper", "lower"), 2),
    "middle": 3,
}
ORDINALS = {"first": 0, "second": 1, "third": 2, "fourth": 3, "fifth": 4}
TO_THE_ROBOT = {"closest to": "frontmost", "farthest from": "rearmost"}  # with nothing after it


@dataclass(frozen=True)
class Relation:
    """How the wanted thing lies to other things; "between" has two anchors, the others one."""

    name: str
    anchors: tuple["Phrase", ...]


@dataclass(frozen=True)
class Phrase:
    """A thing in words. `nouns` are what is neither color, role, rank nor filler, the head noun last.

    `ranks` sort what else fits, and `ordinal` says which of the sorted is meant, 0 the first.
    """

    color: str | None = None
    role: str | None = None
    nouns: tuple[str, ...] = ()
    ranks: tuple[str, ...] = ()
    ordinal: int = 0
    relations: tuple[Relation, ...] = field(default=())

    @property
    def spatial(self) -> bool:
        """Does it say where the thing is, or how it compares?"""
        return bool(self.relations or self.ranks)


def singular(noun: str) -> str:
    """A noun without its plural's "s"."""
    for ending, left in (
        ("shelves", "shelf"),
        ("ches", "ch"),
        ("shes", "sh"),
        ("xes", "x"),
        ("ss", "ss"),
    ):
        if noun.endswith(ending):
            return noun.removesuffix(ending) + left
    return noun.removesuffix("s")


def parse(text: str) -> Phrase:
    """The phrase a text stands for. Raises ValueError that says what is wrong with it."""
    plain = WHERE.sub(r"\1", text.lower())
    plain = re.sub(r"\b(?:at|in) the (top|bottom|middle) of\b", r"\1 of", plain)
    words = re.findall(r"[a-z_]+", plain.replace("-", " "))
    phrase, rest = _phrase(words, text)
    if rest:
        raise ValueError(f"{text!r}: {' '.join(rest)!r} is left over")
    return phrase


def _phrase(words: list[str], text: str) -> tuple[Phrase, list[str]]:
    """The phrase at the beginning, and the words from an "and" on that does not belong to it."""
    own, words = _until_relation(words)
    ranked, relations = None, []
    while words and words[0] != "and":
        name, length = relation_at([*own, *words], len(own))
        words = words[length:]
        anchor, beyond = _until_relation(words)
        if name == "part of" and not [w for w in own if w not in FILLERS and w not in RANKS]:
            raise ValueError(f"{text!r}: name the part, as in: the top drawer of the cabinet")
        if not anchor and name in TO_THE_ROBOT:
            ranked = TO_THE_ROBOT[name]  # "the closest block", "the block that is nearest"
            own, words = own + anchor, beyond
            continue
        if not [word for word in anchor if word not in FILLERS]:
            raise ValueError(f"{text!r}: {name!r} of what?")
        if name in TO_THE_ROBOT and not _spells_anchor(own):
            # "the nearest block to the robot": the noun comes first, its anchor after "to" or "from".
            split = [k for k, word in enumerate(anchor) if word in ("to", "from")]
            own += anchor[: split[0]] if split else anchor
            if not split:
                ranked, words = TO_THE_ROBOT[name], beyond
                continue
            words = words[split[0] + 1 :]
        if name == "between":
            first, words = _attributes_only(words, text)
            if words[:1] != ["and"]:
                raise ValueError(f"{text!r}: between what and what?")
            second, words = _phrase(words[1:], text)
            relations.append(Relation(name, (first, second)))
        else:
            anchored, words = _phrase(words, text)
            relations.append(Relation(name, (anchored,)))
    return _attributes(own, text, ranked, tuple(relations)), words


def _spells_anchor(own: list[str]) -> bool:
    """Has the phrase a noun, a color or a role before its relation?"""
    return any(word not in FILLERS and word not in ORDINALS for word in own)


def _attributes_only(words: list[str], text: str) -> tuple[Phrase, list[str]]:
    own, rest = _until_relation(words)
    return _attributes(own, text, None, ()), rest


def _until_relation(words: list[str]) -> tuple[list[str], list[str]]:
    """The words before the first relation or "and", and the rest."""
    for k in range(len(words)):
        if words[k] == "and" or relation_at(words, k)[1]:
            return words[:k], words[k:]
    return words, []


def relation_at(words: list[str], at: int) -> tuple[str, int]:
    """The relation that begins at a word and how many words it takes; 0 if none. Parts and sides alone are "of"."""
    for spelling, name in SPELLED:
        if words[at : at + len(spelling)] == spelling:
            owned = at > 0 and (singular(words[at - 1]) in PARTS | GRIPS or words[at - 1] in RANKS)
            return (name, len(spelling)) if name != "part of" or owned else ("", 0)
    return "", 0


def _attributes(
    words: list[str], text: str, rank: str | None, relations: tuple[Relation, ...]
) -> Phrase:
    words = [word for word in words if word not in FILLERS]
    tints = {name for word in words if (name := color_space.canonical(word))}
    tasks = {word for word in words if word in roles.NAMES}
    ranks = tuple(
        dict.fromkeys(RANKS[word] for word in (*words, *filter(None, [rank])) if word in RANKS)
    )
    if len(tints) > 1 or len(tasks) > 1:
        raise ValueError(
            f"{text!r} names several colors or several roles for one thing; give one of each at most"
        )
    if len({DIRECTIONS.get(rank) for rank in ranks} - {None}) < len(ranks) > 1:
        raise ValueError(f"{text!r}: {' and '.join(sorted(ranks))} at once; give one of them")
    which = [ORDINALS[word] for word in words if word in ORDINALS]
    taken = tasks | set(RANKS) | set(ORDINALS) | ANYTHING
    nouns = tuple(w for w in words if w not in taken and not color_space.canonical(w))
    plain = any(word in ANYTHING for word in words)
    if not (tints or tasks or ranks or nouns or plain):
        raise ValueError(f"{text!r} names no thing: give a color, a role or a noun")
    among = {"middle", "upper", "lower"} & set(ranks)
    if among and not (tints or tasks or nouns):
        raise ValueError(f"{text!r}: the {among.pop()} one of which things? name them")
    if which and not ranks:
        raise ValueError(f"{text!r}: the {words[0]} in which order? e.g. second leftmost")
    return Phrase(
        next(iter(tints), None),
        next(iter(tasks), None),
        nouns,
        ranks,
        which[0] if which else 0,
        relations,
    )
