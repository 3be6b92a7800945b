"""What a noun of a target means in one episode: a role, a measured shape, or a word of the instruction.

Exact words come first; then, if the extra `words` is installed, a word that means about the same.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from rpaug.core.errors import MissingExtra
from rpaug.core.types import Belief
from rpaug.providers.words import synonym
from rpaug.scene.targets import shapes
from rpaug.scene.targets.instruction import (
    GRIPPING,
    OPENING,
    StatedNoun,
    mentions,
)
from rpaug.scene.targets.relations import GRIPS, PARTS, singular
from rpaug.scene.targets.roles import NAMES

ROLES: Mapping[str, str] = {
    **dict.fromkeys(("arm", "gripper", "manipulator"), "robot"),
    **dict.fromkeys(("desk", "tabletop", "counter", "worktop", "countertop"), "table"),
    **dict.fromkeys(("wall", "walls", "floor", "room", "surroundings"), "background"),
}
# Before these words an instruction names what is moved, after them where it goes.
TOWARDS = frozenset(
    {"on", "onto", "in", "into", "to", "inside", "at", "against", "over", "from", "under"}
)
# What these act on, the robot touches.
HANDLING = frozenset(
    {
        "open", "close", "push", "pull", "put", "pick", "place", "slide", "move", "set", "take", "press", "turn",
        "stack", "lift", "grip", "grasp", "drag", "insert", "hang", "pour", "wipe", "sweep",
    }
)  # fmt: skip
VERBS = HANDLING | {"up", "down", "out", "it", "and", "then", "with", "by", "your"}


# Parts that a noun before them owns: a box lid is of a box, a light switch of no light.
HELD = frozenset(
    {"drawer", "door", "lid", "cap", "cover", "hatch", "flap", "seat", "shelf", "handle", "knob"}
)
FURNITURE = frozenset({"cabinet", "cupboard", "dresser", "furniture", "closet", "wardrobe"})

PLAYED = {"handled": "manipulated", "goal": "receiver"}
SURE = 0.6  # of a role that an instruction and models tell, and no motion


@dataclass(frozen=True)
class Meaning:
    """What a noun stands for: a role, or the shapes a thing may have. `stated` is the word that was understood.

    `scope` says what of a role. "" is all of it; "moved" the one thing that the instruction handles; "goal" where that
    goes, "part" a part of it; "whole" the piece of furniture; "grip" what the gripper holds of the moved thing;
    "source" what that stood on at first; "aside" nothing: the noun only says where. `ranks`, `color` and `qualifiers`
    are the instruction's own words with the noun. `others` are the other things of its kind, part or no part, that the
    instruction handles; `mixed`: it handles some of the other kind. `tool`: what the hand holds of what moves, where
    that is acted on with it ("hit the nail with the hammer"); None where the instruction names no tool.
    """

    stated: str
    role: str | None = None
    shapes: frozenset[str] = frozenset()
    scope: str = ""
    ranks: tuple[str, ...] = ()
    color: str | None = None
    qualifiers: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    mixed: bool = False
    tool: bool | None = None


def understood(noun: str, descriptions: Sequence[str]) -> list[Meaning]:
    """The meanings of a noun, the likeliest first; none if it has none here.

    An instruction's nouns stand for the roles of what it names: in "open the drawer" the drawer is manipulated.
    """
    exact = _exact(noun, descriptions)
    if exact:
        return exact
    known = sorted({*ROLES, *shapes.WORDS, *named(tuple(descriptions)), *NAMES})
    try:
        other = synonym(noun, known)
    except MissingExtra:
        return []
    return _exact(other, descriptions) if other else []


def _exact(noun: str, descriptions: Sequence[str]) -> list[Meaning]:
    stated = named(tuple(descriptions))
    for word in dict.fromkeys((noun, singular(noun))):
        found = []
        if word in NAMES or word in ROLES:
            found.append(Meaning(word, role=ROLES.get(word, word)))
        if word in shapes.WORDS:
            found.append(Meaning(word, shapes=shapes.WORDS[word]))
        own = stated.get(singular(word), ())
        found += own
        if not own and word in FURNITURE and stated.keys() & {"drawer", "door", "shelf"}:
            found.append(Meaning(word, "receiver", scope="whole"))
        if not own and word in GRIPS:
            found.append(Meaning(word, "manipulated", scope="grip"))
        if found:
            return found
    return []


def colored_so(color: str | None, descriptions: Sequence[str]) -> str:
    """A noun that the instructions describe by this color; empty if there is none."""
    stated = named(tuple(descriptions)).items()
    return next((noun for noun, known in stated if color in [one.color for one in known]), "")


@cache
def named(descriptions: tuple[str, ...]) -> dict[str, list[Meaning]]:
    """What the nouns of the instructions stand for, by their singular; what only says where comes last."""
    out: dict[str, list[Meaning]] = {}
    for text in descriptions:
        for meaning in _stated(mentions(text)):
            known = out.setdefault(singular(meaning.stated), [])
            if meaning not in known:
                known.append(meaning)
    return {
        noun: [one for one in known if one.scope != "aside"] or known[:1]
        for noun, known in out.items()
    }


def _stated(found: Sequence[StatedNoun]) -> list[Meaning]:
    """What the nouns of one instruction stand for."""
    scopes = [_scope(k, found) for k in range(len(found))]
    moved = {
        one.noun
        for one, (_, scope) in zip(found, scopes, strict=True)
        if scope == "moved" and one.noun not in ROLES
    }
    opened = any(
        scope == "whole" and one.place == "handled"
        for one, (_, scope) in zip(found, scopes, strict=True)
    )
    tools = {one.noun for one in found if one.verb == "use" and one.noun in moved}
    tools = tools if moved - tools else set()
    out = []
    for one, (role, scope) in zip(found, scopes, strict=True):
        others, mixed, tool = [], False, None
        if scope == "moved":
            if one.noun in GRIPS and one.verb in GRIPPING and len(moved) > 1:
                scope = "grip"
            tool = one.noun in tools if tools else None
            rest = moved - GRIPS - {one.noun}
            others = sorted(noun for noun in rest if (noun in PARTS) == one.is_part)
            mixed = len(others) < len(rest) or (opened and not one.is_part)
        out.append(
            Meaning(
                one.noun,
                role,
                scope=scope,
                ranks=one.ranks,
                color=one.color,
                qualifiers=one.qualifiers,
                others=tuple(others),
                mixed=mixed,
                tool=tool,
            )
        )
        if role and one.noun in HELD and one.qualifiers and one.qualifiers[-1] not in PARTS:
            out.append(Meaning(one.qualifiers[-1], role, scope="whole"))  # "the fridge door"
    return out


def _scope(at: int, found: Sequence[StatedNoun]) -> tuple[str | None, str]:
    """Role and scope of one noun of an instruction."""
    one = found[at]
    match one.place:
        case "handled":
            opened = one.verb in OPENING and not one.is_part
            return "manipulated", "whole" if opened else "moved"
        case "goal":
            owned = one.qualifiers or (at + 1 < len(found) and found[at + 1].place == "owner")
            return "receiver", "part" if one.noun in PARTS and owned else "goal"
        case "source" if not one.is_part:
            return "manipulated", "source"
        case "owner" if at and found[at - 1].is_part:
            if not one.is_part:
                return _scope(at - 1, found)[0], "whole"
            if found[at - 1].noun in GRIPS:  # "the handle of the door"
                return "manipulated", "moved"
    return None, "aside"


def things(descriptions: Sequence[str]) -> list[str]:
    """The things that instructions name, each in its own words: "red cup", "wine bottle"."""
    found = (noun for text in descriptions for noun in mentions(text))
    return list(dict.fromkeys(_own_words(one) for one in found if one.noun not in ROLES))


def by_instruction(
    descriptions: Sequence[str], names: Mapping[str, frozenset[int]], known: Collection[str]
) -> dict[str, Belief]:
    """Beliefs of `manipulated` and `receiver` where they are not `known`, the instruction names one thing of that part,
    and models found one such thing; `names` are the instance ids that they found by words."""
    out = {}
    for place, role in PLAYED.items():
        nouns = {
            _own_words(one)
            for text in descriptions
            for one in mentions(text)
            if one.place == place and one.noun not in ROLES
        }
        meant = frozenset[int]().union(*(names.get(words, frozenset()) for words in nouns))
        if role not in known and len(nouns) == 1 and len(meant) == 1:
            reason = f"the instruction names {min(nouns)!r} so, and models found one"
            out[role] = Belief(meant, SURE, (reason,))
    return out


def _own_words(one: StatedNoun) -> str:
    return " ".join(filter(None, [one.color, *one.qualifiers, one.noun]))
