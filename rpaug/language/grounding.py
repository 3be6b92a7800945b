"""Which thing is meant: words into a recipe's target, and targets looked for in a recorded scene."""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from rpaug.core import color_space
from rpaug.language import slots, spelling
from rpaug.language.grammar import NotThis, Said
from rpaug.language.messages import Mention, NotUnderstood
from rpaug.scene.targets import relations, roles, shapes
from rpaug.scene.targets.nouns import ROLES, VERBS

Target = str | dict[str, Any]

PRONOUNS = frozenset(
    {
        "it",
        "that",
        "this",
        "them",
        "these",
        "those",
        "itself",
        "same",
        "me",
        "us",
        "you",
        "him",
        "her",
    }
)
ARTICLES = ("the", "a", "an", "that", "this", "its", "your", "our", "my")
PHRASES: Mapping[str, str] = {
    **dict.fromkeys(("robot arm", "robot's arm", "robotic arm"), "robot"),
    **dict.fromkeys(
        (
            "whatever the robot moves", "what the robot moves", "thing the robot moves", "object the robot moves",
            "manipulated object", "manipulated thing", "manipulated item", "moved object", "moved thing",
            "what the robot manipulates", "whatever the robot manipulates", "object that the robot moves",
            "thing that the robot moves", "handled object", "handled thing",
        ),
        "manipulated",
    ),
    **dict.fromkeys(("receiving object", "receiving thing", "receiver object"), "receiver"),
}  # fmt: skip
# What no thing on a table is called: words that a rule should have accounted for, and what rpaug itself is made of.
NO_THING = (
    PRONOUNS
    | VERBS
    | frozenset(
        re.findall(
            r"\S+",
            """
            make paint remove delete add duplicate copy clone dim raise lower blur color colour recolor recolour
            texture give cover shift jitter shake erase resize scale shrink enlarge stylise stylize style light
            lights lamp lamps lighting camera cameras image images picture pictures frame frames noise exposure
            view size dataset file files folder folders recipe recipes episode episodes instruction instructions
            output outputs policy policies code program prompt system data key keys report disk everything
            nothing anything something except but not no without or then please do don never ignore forget undo
            twice half bigger smaller larger darker brighter lighter percent times stop stops copies seed
            probability scene world distractor distractors clutter cm mm m metres meters degrees random previous
            all both every each instead if when while because like as look looks into onto for so also now again
            more less very too be been being was were will would should shall must could can't have has had get
            gets let lets want wants need needs from with by at to up down than there here how what who whether
            why after before during off out only randomly its their whose glow somewhere elsewhere else anywhere
            left right other middle
            """,
        )
    )
    | frozenset(word for phrase in slots.WORDS for word in phrase.split())
) - {"one", "place", "a", "an"}
MOST_NOUNS = 3


def thing(stated: Said, slot: str = "thing") -> Target:
    """The target that the words of a slot stand for. Raises NotThis if they name no thing."""
    return target(stated[slot], stated.wish.mention)


def things(stated: Said, slot: str = "thing") -> list[Target]:
    """One target or several: "the bowl and the cup". Raises NotThis."""
    words = stated[slot]
    try:
        return [target(words, stated.wish.mention)]
    except NotThis:
        parts = re.split(r",? and |, ", re.sub(r"^both (?=.* and )", "", words))
        if len(parts) < 2:
            raise
        return [target(part, stated.wish.mention) for part in parts]


def target(words: str, mention: Mention | None = None) -> Target:
    """A recipe's target for a phrase. Raises NotThis for what is no phrase, NotUnderstood for an "it" of nothing."""
    words = words.strip()
    if words in ("it", "that", "this", "that one", "them"):
        if mention is None or mention.kind != "target":
            why = {None: "nothing was named before", "new": "a new thing has no name yet"}
            reason = why.get(mention.kind if mention else None, "what was named before is no thing")
            raise NotUnderstood(f"{words!r}: {reason}; say which thing is meant")
        return mention.target
    several = re.match(
        r"(?:all(?: of)?(?: the)?|every|each(?: of the)?|both(?: of)?(?: the)?) ", words
    )
    words = words[several.end() :] if several else words
    words = re.sub(rf"^(?:{'|'.join(ARTICLES)}) ", "", words)
    numbered = re.fullmatch(
        r"(?:object|handle|instance|thing|number|#)(?: number)? ?#?(\d+)", words
    )
    if numbered:
        return {"handle": int(numbered[1])}
    if words in PHRASES:
        return {"role": PHRASES[words]}
    bare = re.sub(r" (?:object|thing|item)$", "", words)
    if bare in roles.NAMES or bare in ROLES:
        return {"role": ROLES.get(bare, bare)}
    _check(words)
    return {"text": words, "all": True} if several else words


def _check(words: str) -> None:
    """That words are a phrase of the targets' grammar in the order in which people say it. Raises NotThis."""
    try:
        phrase = relations.parse(words)
    except ValueError:
        raise NotThis from None
    if re.search(r"[^a-z_ -]", words) or _nouns(phrase) & NO_THING:
        raise NotThis
    if any(re.fullmatch(r"[a-z]{3,}ed", noun) for noun in _nouns(phrase)):
        raise NotThis  # "the mug tinted" is more than a thing
    for noun in _nouns(phrase):
        if tint := _nearly_a_color(noun):
            raise NotUnderstood(f"{words!r}: {noun!r} is no colour ({noun!r} may be {tint!r})")
    for part in _segments(relations.WHERE.sub("", words.replace("-", " ")).split()):
        kinds = [_kind(word) for word in part]
        if kinds != sorted(kinds) or kinds.count(2) > MOST_NOUNS or kinds.count(0) > 1:
            raise NotThis


@cache
def _nearly_a_color(noun: str) -> str | None:
    """The color that a noun looks misspelt from, if it is no known thing."""
    if len(noun) < 4 or noun in shapes.WORDS or noun.removesuffix("s") in shapes.WORDS:
        return None
    return spelling.nearest(noun, color_space.NAMES)


def _kind(word: str) -> int:
    """0: what begins a phrase; 1: what describes a thing; 2: the thing; 3: what leads to a relation."""
    if word in ARTICLES[:-1]:
        return 0
    if word in ("is", "are", "which"):
        return 3
    describing = (
        word in relations.RANKS
        or word in relations.ORDINALS
        or word == "most"
        or color_space.canonical(word) is not None
    )
    return 1 if describing else 2


def _segments(words: list[str]) -> list[list[str]]:
    """The phrases between relation words and "and"."""
    out: list[list[str]] = [[]]
    at = 0
    while at < len(words):
        size = relations.relation_at(words, at)[1] or int(words[at] == "and")
        if size:
            out.append([])
            at += size
        else:
            leads = words[at] == "that" and words[at + 1 : at + 2] in (["is"], ["are"])
            if not leads:
                out[-1].append(words[at])
            at += 1
    return out


def _nouns(phrase: relations.Phrase) -> set[str]:
    """Every noun in a phrase and in those inside it."""
    inner = [anchor for relation in phrase.relations for anchor in relation.anchors]
    return {*phrase.nouns}.union(*map(_nouns, inner))


def phrases(value: Target) -> list[str]:
    """The phrases inside a target, the innermost anchors first: each is looked for by itself."""
    text = value if isinstance(value, str) else value.get("text")
    if text is None:
        return []
    words, ends, at = text.split(), [], 0
    while at < len(words):
        size = relations.relation_at(words, at)[1]
        at += size or 1
        ends += [at] if size else []
    anchors = [re.sub(r"^(?:the|a|an) ", "", " ".join(words[end:])) for end in reversed(ends)]
    return [anchor for anchor in anchors if anchor and " and " not in anchor]
