"""What a noun of a target means in one episode: a role, a measured shape, or a word of the instruction.

Exact words come first; then, if the extra `words` is installed, a word that means about the same.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rpaug.core import color_space
from rpaug.core.errors import MissingExtra
from rpaug.providers.words import synonym
from rpaug.scene.targets import shapes
from rpaug.scene.targets.relations import ANYTHING, FILLERS, ORDINALS, RANKS
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


@dataclass(frozen=True)
class Meaning:
    """What a noun stands for: a role, or the shapes a thing may have. `said` is the word that was understood."""

    stated: str
    role: str | None = None
    shapes: frozenset[str] = frozenset()


def understood(
    noun: str, descriptions: Sequence[str], roles: Mapping[str, object]
) -> list[Meaning]:
    """The meanings of a noun, the likeliest first; none if it has none here.

    An instruction's nouns stand for the roles of what it names ("open the drawer": the drawer is what is
    manipulated), if those roles are known.
    """
    exact = _exact(noun, descriptions, roles)
    if exact:
        return exact
    known = sorted({*ROLES, *shapes.WORDS, *named(descriptions), *NAMES})
    try:
        other = synonym(noun, known)
    except MissingExtra:
        return []
    return _exact(other, descriptions, roles) if other else []


def _exact(noun: str, descriptions: Sequence[str], roles: Mapping[str, object]) -> list[Meaning]:
    singular = noun[:-1] if noun.endswith("s") and not noun.endswith("ss") else noun
    for word in (noun, singular):
        found = []
        if word in NAMES or word in ROLES:
            found.append(Meaning(word, role=ROLES.get(word, word)))
        if word in shapes.WORDS:
            found.append(Meaning(word, shapes=shapes.WORDS[word]))
        role = named(descriptions).get(word)
        if role in roles:
            found.append(Meaning(word, role=role))
        if found:
            return found
    return []


def named(descriptions: Sequence[str]) -> dict[str, str]:
    """The nouns of the instructions and the roles they stand for: head nouns only, first instruction first."""
    out: dict[str, str] = {}
    for text in descriptions:
        words = re.findall(r"[a-z]+", text.lower())
        cut = next((k for k, word in enumerate(words) if word in TOWARDS and k > 1), len(words))
        for part, role in ((words[:cut], "manipulated"), (words[cut:], "receiver")):
            nouns = [word for word in part if _is_noun(word)]
            if nouns:
                out.setdefault(nouns[-1], role)
    return out


def _is_noun(word: str) -> bool:
    taken = FILLERS | ANYTHING | VERBS | TOWARDS | set(RANKS) | set(ORDINALS)
    return word not in taken and color_space.canonical(word) is None
