"""What an instruction says of its things: each noun with what the sentence does to it, its place words and its owner.

No grammar of English, only its prepositions and the verbs of manipulation: "put the cup from the tray on the stove"
handles the cup, takes it from the tray and brings it to the stove; "press the button on the stove" handles the button,
which the stove owns. What it cannot place ("next to the plate") is `aside`.
"""

import re
from dataclasses import dataclass, field, replace

from rpaug.core import color_space
from rpaug.scene.targets.relations import ANYTHING, FILLERS, GRIPS, PARTS, RANKS


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Verbs, by what "on" and "in" after their object mean: where it goes, where it was, or what it belongs to.
PLACING = _words(
    "put place set leave stack insert hang drop throw pour slide move drag sweep slot dunk push arrange"
)
SHIFTING = frozenset(
    {"slide", "move", "push", "pull", "drag"}
)  # of a part ("slide the door on the cabinet"): not away
TAKING = _words("take remove get retrieve pick grasp grip grab lift pull hold unplug")
GRIPPING = frozenset({"grasp", "grip", "grab", "hold", "use"})
# What is opened need not be what moves: of a box it is the lid.
OPENING = frozenset({"open", "close", "shut"})
# What these act on is not what moves: a tool, a switch or a lock does it, or the hand goes round it.
UNMOVED = _words(
    """
    wipe clean clear brush water hammer cover uncover bypass keep ensure prepare create build play adjust change make
    point find empty heat preheat unlock lock
    """
)
OTHERS = _words(
    "press turn rotate flip tip tilt topple knock flick switch screw unscrew twist reach touch lower raise kick hit "
    "pot chuck use"
)
ACTS = PLACING | TAKING | OPENING | UNMOVED | OTHERS
PARTICLES = frozenset({"up", "down", "out", "off", "on", "in", "away", "open", "shut", "back"})

TOWARDS = frozenset({"onto", "into", "to", "inside", "towards", "toward", "against"})
LYING = frozenset({"on", "in", "at"})
ASIDE = _words(
    """
    next near nearest beside between behind above below over under beneath underneath by for until where around
    through along so such while
    """
)
SIDES = frozenset({"left", "right", "front", "back", "middle", "top", "bottom", "side"})
ARTICLES = FILLERS - {"of"} | _words(
    "it them both each any your their two three other others its s"
)
CLAUSES = frozenset({"and", "then", "or"})
TOOL = frozenset({"with", "using"})
TRAILING = (
    PARTICLES
    | SIDES - {"side"}
    | _words(
        "upright position together direction flat way closed clockwise anti counter degrees sideways one alone tight"
    )
)


@dataclass(frozen=True)
class StatedNoun:
    """A noun of an instruction. `place` is "handled", "goal", "source", "owner" of the noun before it, or "aside".

    `ranks` are its place and size words, as `relations.RANKS` calls them, `qualifiers` the nouns before it.
    """

    noun: str
    place: str
    verb: str
    ranks: tuple[str, ...] = ()
    color: str | None = None
    qualifiers: tuple[str, ...] = ()

    @property
    def is_part(self) -> bool:
        return self.noun in PARTS or self.noun in GRIPS


@dataclass
class _SentenceReader:
    """Where the reading of a sentence stands."""

    found: list[StatedNoun] = field(default_factory=list)
    run: list[str] = field(default_factory=list)
    verb: str = ""
    place: str = "handled"

    def close(self) -> None:
        """End the noun phrase that was being read."""
        nouns = [word for word in self.run if word not in RANKS and not color_space.canonical(word)]
        if nouns[-1:] in (["open"], ["closed"], ["shut"]):  # "leave the pan open"
            self.verb = "open"
        while nouns and nouns[-1] in TRAILING:
            nouns.pop()
        if nouns and nouns[-1] not in ANYTHING:
            tints = [name for word in self.run if (name := color_space.canonical(word))]
            before = self.run[: len(self.run) - 1 - self.run[::-1].index(nouns[-1])]
            self.found.append(
                StatedNoun(
                    nouns[-1],
                    self._place(nouns[-1]),
                    self.verb,
                    tuple(RANKS[word] for word in before if word in RANKS),
                    tints[0] if tints else None,
                    tuple(nouns[:-1]),
                )
            )
        self.run = []

    def _place(self, noun: str) -> str:
        """The place, as the verb has it: what is poured is no thing, what it is poured from is what moves."""
        if self.verb == "pour" and self.place in ("handled", "source"):
            return "aside" if self.place == "handled" else "handled"
        if self.place == "switched":  # a tap that is turned on moves, a lamp does not
            return "handled" if noun in PARTS else "aside"
        return "aside" if self.verb in UNMOVED and self.place == "handled" else self.place


def mentions(text: str) -> list[StatedNoun]:
    """The nouns of one instruction, in order."""
    words = re.findall(r"[a-z]+|[,.;]", text.lower().replace("'s ", " "))
    reader, at, begins = _SentenceReader(), 0, True
    while at < len(words):
        word, rest = words[at], words[at + 1 :]
        at += 1
        acts = _verb(word, rest) if begins or word == "to" else None
        if word == "to" and rest:
            acts = _verb(rest[0], rest[1:]) if rest[0] in ACTS else None
            at += acts is not None
        if acts is not None:
            reader.close()
            reader.verb, reader.place, begins = acts, "handled", False
            while at < len(words) and _is_particle(words[at], words[at + 1 :], acts):
                if words[at] in OPENING:  # "slide open"
                    reader.verb = "open"
                if acts in ("turn", "switch") and words[at] in ("on", "off"):
                    reader.place = "switched"
                at += 1
            goals = [one for one in reader.found if one.place == "goal"]
            if acts in OPENING and goals and words[at : at + 1] == ["it"]:
                # "put the cup in the drawer and close it"
                reader.found.append(replace(goals[0], place="handled", verb=acts))
        elif word in CLAUSES or not word.isalpha():
            reader.close()
            begins = True
        else:
            begins = False
            at += _read(reader, word, rest)
    reader.close()
    return reader.found


def _verb(word: str, rest: list[str]) -> str | None:
    """The verb that a clause begins with, or None."""
    stem = word.removesuffix("ing")
    for one in (word, stem, stem + "e", stem[:-1]):
        if one in ACTS:
            return one
    # Whatever stands before an article at the beginning of a clause is a verb.
    follows = rest[:1] and (rest[0] in ARTICLES or rest[0] in PARTICLES)
    return word if follows and word not in ARTICLES | LYING | TOWARDS | ASIDE | SIDES else None


def _is_particle(word: str, rest: list[str], verb: str) -> bool:
    """Does a word belong to the verb before it ("pick up", "press on"), not to a place ("put in the drawer")?"""
    return word in PARTICLES and not (
        verb in PLACING and word in LYING and rest and rest[0] in ARTICLES
    )


def _read(reader: _SentenceReader, word: str, rest: list[str]) -> int:
    """Take in a word that is no verb; how many further words were used up."""
    ahead = [w for w in rest[:3] if w not in ARTICLES]
    side = bool(ahead) and ahead[0] in SIDES
    if word in LYING | TOWARDS and side and ahead[1:2] == ["of"]:
        reader.close()
        among = ahead[0] in ("top", "middle", "bottom", "side", "back")
        reader.place = _lying(reader) if among and word in LYING else "aside"
        return rest.index("of") + 1
    if word in LYING and side and (len(ahead) < 2 or not _continues(ahead[1])):
        reader.close()
        if reader.found and ahead[0] in RANKS:
            last = reader.found[-1]
            reader.found[-1] = replace(last, ranks=(*last.ranks, RANKS[ahead[0]]))
        return rest.index(ahead[0]) + 1
    if word in ("left", "right") and rest[:1] == ["of"]:
        reader.close()
        reader.place = "aside"
        return 1
    place = {
        **dict.fromkeys(TOWARDS, "goal"),
        **dict.fromkeys(TOOL, "handled"),  # "sweep the dirt with the broom": a tool moves
        **dict.fromkeys(ASIDE, "aside"),
        **dict.fromkeys(("from", "off"), "source"),
    }.get(word)
    if word == "out" and rest[:1] == ["of"]:
        place = "source"
    if word in ("on", "off") and not ahead and reader.verb in ("turn", "switch"):
        reader.close()  # "turn the lamp off"
        reader.found[-1:] = [
            one if one.noun in PARTS else replace(one, place="aside") for one in reader.found[-1:]
        ]
        return 0
    if word in LYING:
        reader.close()
        place = _lying(reader)
    if place:
        reader.close()
        reader.place = place
        if word in TOOL:
            reader.verb = "use"
        return int(rest[:1] == ["of"] or (word == "next" and rest[:1] == ["to"]))
    if word == "of":
        named = len(reader.found)
        reader.close()
        if len(reader.found) > named:
            reader.place = "owner"
    elif word in ARTICLES:
        if word != "most":  # "the left most knob"
            reader.close()
    elif not (word in PARTICLES and not reader.run):
        reader.run.append(word)
    return 0


def _continues(word: str) -> bool:
    return word.isalpha() and word not in CLAUSES | LYING | TOWARDS | ASIDE | {"from", "off", "of"}


def _lying(reader: _SentenceReader) -> str:
    """What "on" and "in" lead to after this verb."""
    last = reader.found[-1] if reader.found else None
    if last is not None and last.place == "goal" and last.verb == reader.verb:
        return "owner"  # "onto a peg on the stand"
    of_part = last is not None and last.is_part and last.place == "handled"
    if reader.verb in PLACING and not (of_part and reader.verb in SHIFTING):
        return "goal"
    return "source" if reader.verb in TAKING and not of_part else "owner"
