"""What an instruction's phrases mean before and after the edits, and what must become of their words."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from rpaug.core import color_space
from rpaug.core.errors import RpaugError, TargetError
from rpaug.core.interfaces import Added
from rpaug.core.types import Scene
from rpaug.instruct.changes import Changes
from rpaug.instruct.phrases import (
    BESIDE,
    LARGE,
    PLACES,
    SIZES,
    InstructionPhrase,
    Word,
    changed,
    phrases,
)
from rpaug.scene.lighting import albedo
from rpaug.scene.targets import agreement, shapes, targets
from rpaug.scene.targets.nouns import Meaning, understood
from rpaug.scene.targets.relations import ANYTHING
from rpaug.scene.targets.survey import InstanceSummary, survey

# Nouns that things of several kinds go by: a mug is a cup, a brick is a block.
BROAD = frozenset(
    {"block", "box", "cube", "cup", "cylinder", "ball", "sphere", "pad", "container", "bowl"}
)


SPELLED = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
COUNTS = {word: str(count) for count, word in enumerate(SPELLED, 2)}


class Untrue(RpaugError):
    """After the edits an instruction would not be true, or not clear, and it is not known how to mend it."""


class Judge:
    """Says what each phrase means in the `recorded` scene, and what must become of it.

    `after` has what is left of the recorded things, as large as they are now and where they stand now.
    """

    def __init__(self, recorded: Scene, after: Scene, changes: Changes) -> None:
        self._recorded, self._after, self._changes = recorded, after, changes
        self._known: dict[tuple[bool, str, bool], frozenset[int] | None] = {}

    def rewritten(self, text: str) -> str:
        """The instruction with the words that the edits call for. Raises Untrue."""
        new: list[tuple[Word, str]] = []
        beside = bool(BESIDE.search(text.lower()))
        for phrase in phrases(text):
            self._there(phrase)
            self._stands(phrase, beside)
            if phrase.rank and (word := self._sized(phrase, phrase.rank)) != phrase.rank.text:
                new.append((phrase.rank, word))
            name = self._becomes(phrase)
            self._clear(phrase, name)
            if phrase.tint and name != phrase.color:
                new.append((phrase.tint, name or ""))
        for place, word in sorted(new, key=lambda entry: -entry[0].start):
            text = changed(text, place, word)
        return text

    def hold(self, new: str, old: str) -> None:
        """See that another wording names the same things, as they are after the edits, and no others. Raises Untrue."""
        before, after = ([*phrases(text)] for text in (old, new))
        if _numbers(old) != _numbers(new):
            raise Untrue(f"{new!r} has other numbers than {old!r}")
        meant = [self._means_now(phrase, before) for phrase in after]
        for phrase in before:
            named, heads = self._named(phrase), {one.nouns[-1:] for one in after}
            if named not in meant if named else phrase.nouns[-1:] not in heads:
                raise Untrue(f"{new!r} does not name {phrase.text!r} of {old!r}")
        known = [one for one in map(self._named, before) if one]
        for phrase, named in zip(after, meant, strict=True):
            if named and named not in known:
                raise Untrue(f"{phrase.text!r} is not what {old!r} is about")

    def _means_now(
        self, phrase: InstructionPhrase, before: Sequence[InstructionPhrase]
    ) -> frozenset[int] | None:
        """What a phrase of a new wording means after the edits; None for a noun of the old that nothing is known of.
        Raises Untrue."""
        self._there(replace(phrase, color=None, tint=None))
        noun = phrase.nouns[-1] if phrase.nouns else ""
        stated = {word for one in before for word in one.nouns}
        places = {one.rank.text for one in before if one.rank}
        if phrase.rank and phrase.rank.text in PLACES and phrase.rank.text not in places:
            raise Untrue(f"{phrase.text!r} says another place")
        if noun and noun not in ANYTHING | stated and not self._meanings(noun):
            raise Untrue(f"{phrase.text!r} is nothing that the recording shows")
        for one in self._changes.added:
            if (phrase.color is None or color_space.means(phrase.color, one.color)) and _goes_by(
                one, phrase.nouns
            ):
                raise Untrue(
                    f"a {one.color} {one.kind} was put in: {phrase.text!r} could be it too"
                )
        if phrase.color is None:
            return self._named(phrase)
        kind = self._of_kind(phrase) if noun not in ("", *ANYTHING) else frozenset(self._rows)
        words = self._changes.words
        own = {h: words[h] if h in words else self._was(h) for h in kind or self._rows}
        alike = frozenset(
            h for h, word in own.items() if word and color_space.means(phrase.color, word)
        )
        alike -= {h for h in alike if self._rows[h].role in agreement.APART}
        if not alike:
            recorded = self._named(phrase)
            unheard = recorded is None and phrase.text not in (one.text for one in before)
            if unheard or (words and (recorded is None or recorded & words.keys())):
                raise Untrue(f"nothing is {phrase.text!r} after the edits")
            return recorded
        return alike

    @property
    def things(self) -> list[str]:
        """The recorded instances, each in a line."""
        return [str(row) for _, row in sorted(self._rows.items())]

    @property
    def edits(self) -> list[str]:
        """What was changed, each in a sentence."""
        made = self._changes
        return [
            *(f"{h} is {word or 'of no one color'} now" for h, word in made.words.items()),
            *(f"{h} is {scale:.2f} times its size" for h, scale in made.scales.items()),
            *(f"{h} was moved" for h in sorted(made.moved)),
            *(f"{h} is there more than once" for h in sorted(made.copied)),
            *(f"{h} was taken out" for h in sorted(made.removed)),
            *(f"a {one.color} {one.name.replace('_', ' ')} was put in" for one in made.added),
        ]

    def _there(self, phrase: InstructionPhrase) -> None:
        """See that what is named is still there, and only once. Raises Untrue."""
        for instance_ids, what in (
            (self._changes.removed, "was taken out"),
            (self._changes.copied, "is there more than once now"),
        ):
            if not instance_ids:
                continue
            named = self._named(phrase)
            if named is None:
                self._doubt(phrase, instance_ids, what, alone=True)
            elif named & instance_ids:
                raise Untrue(f"{phrase.text!r} {what}")

    def _stands(self, phrase: InstructionPhrase, beside: bool) -> None:
        """See that what is told by its place stands as told, among as many of its kind. Raises Untrue."""
        moved = self._changes.moved
        given = phrase.rank is not None and phrase.rank.text in PLACES
        others = self._changes.removed | self._changes.copied if given else frozenset[int]()
        if not (moved or others) or not (given or beside):
            return
        named = self._named(phrase)
        if named is None:
            self._doubt(phrase, moved, "was moved", alone=not given)
        elif beside and named & moved:
            raise Untrue(f"{phrase.text!r} was moved, and the words say where it stands")
        elif given and self._named(phrase, after=True) != named:
            raise Untrue(
                f"{phrase.text!r} is another thing now that things were moved or taken out"
            )
        elif given and others & self._changes.copied & self._of_kind(phrase):
            raise Untrue(f"one more thing could be {phrase.text!r} now")

    def _sized(self, phrase: InstructionPhrase, rank: Word) -> str:
        """The word for its size that is true after the edits. Raises Untrue."""
        scales = self._changes.scales
        if not scales or rank.text not in SIZES:
            return rank.text
        way, opposite = SIZES[rank.text]
        named = self._named(phrase)
        if named is None:
            self._doubt(phrase, frozenset(scales), "was resized")
            return rank.text
        for kind in (replace(phrase, color=None, tint=None), phrase):
            if (
                phrase.ranked is None
                or not kind.nouns
                or self._found(kind.stated(), False) == named
            ):
                continue
            if self._named(kind) != named:
                continue  # smaller than others of its color alone
            if self._named(kind, after=True) == named:
                return rank.text
            if opposite and self._named(kind, after=True, rank=opposite) == named:
                return opposite
            raise Untrue(f"{phrase.text!r} is another thing now that things were resized")
        lies = [h for h in named if h in scales and (scales[h] < 1) == (way == LARGE)]
        if lies:
            raise Untrue(f"{phrase.text!r} is {scales[lies[0]]:.2f} times its size now")
        return rank.text

    def _becomes(self, phrase: InstructionPhrase) -> str | None:
        """The color word that is true after the edits, None where there is none and none is needed. Raises Untrue."""
        words = self._changes.words
        if phrase.color is None or not words:
            return phrase.color
        named = self._named(phrase)
        if named is None:
            self._doubt(phrase, frozenset(self._loose()), "was painted")
            return phrase.color
        new = {words.get(instance_id, phrase.color) for instance_id in named}
        if None in new and self._alone(phrase, named):
            return None
        if None in new:
            raise Untrue(f"{phrase.text!r} has another pattern now, and no one color")
        names = {str(name) for name in new}
        toned = phrase.tint is not None and " " in phrase.tint.text and named <= words.keys()
        if not toned and all(color_space.means(phrase.color, name) for name in names):
            return phrase.color
        if len(names) > 1:
            raise Untrue(f"{phrase.text!r} is {' and '.join(sorted(names))} now")
        return names.pop()

    def _alone(self, phrase: InstructionPhrase, named: frozenset[int]) -> bool:
        """Do a phrase's nouns say the same without its color: "the button", where there is but one?"""
        plain = replace(phrase, color=None, tint=None)
        return bool(phrase.nouns) and self._named(plain) == named

    def _clear(self, phrase: InstructionPhrase, name: str | None) -> None:
        """See that what the words say now fits nothing that they did not mean. Raises Untrue."""
        stated = " ".join([*filter(None, [name]), *phrase.nouns])
        painted = self._loose() if name is not None else []
        own = (self._named(phrase) or frozenset()) if painted else frozenset()
        for instance_id in painted:
            new = self._changes.words[instance_id]
            if (
                instance_id not in own
                and new
                and color_space.means(str(name), new)
                and self._fits(phrase, instance_id)
            ):
                raise Untrue(f"instance {instance_id} was painted {new}: {stated} could be it too")
        if name is not None and name != phrase.color:
            for instance_id in self._others(phrase):
                if color_space.means(name, self._was(instance_id)):
                    raise Untrue(
                        f"instance {instance_id} is {self._was(instance_id)}: {stated} could be it too"
                    )
        if name is not None and color_space.canonical(name) is None:  # a pattern, not a color
            for instance_id in self._others(phrase):
                if not albedo.plain(self._recorded.episode, instance_id):
                    raise Untrue(
                        f"instance {instance_id} has a pattern of its own: {stated} could be it too"
                    )
        for one in self._changes.added:
            if (name is None or color_space.means(name, one.color)) and _goes_by(one, phrase.nouns):
                raise Untrue(f"a {one.color} {one.kind} was put in: {stated} could be it too")

    def _others(self, phrase: InstructionPhrase) -> list[int]:
        """Recorded things that go by the phrase's noun, but for those it means, and that keep their looks."""
        own = self._named(phrase) or frozenset()
        return [
            instance_id
            for instance_id, row in sorted(self._rows.items())
            if row.role not in agreement.APART
            and instance_id not in own | self._changes.removed | self._changes.words.keys()
            and self._fits(phrase, instance_id)
        ]

    def _doubt(
        self,
        phrase: InstructionPhrase,
        instance_ids: frozenset[int],
        what: str,
        alone: bool = False,
    ) -> None:
        """See that none of these could be meant by a phrase that nothing was found for. Raises Untrue.

        A color that nothing of its noun has may be that of any whose own is akin, or else of any at all.
        `alone`: the robot was seen to leave them alone, or the edit would have been refused. So they are not "the
        handle" of "grip the handle"; a color that fits them is doubted all the same.
        """
        if alone and phrase.handled and phrase.color is None:
            return
        kin = self._kin(phrase)
        for instance_id in sorted(instance_ids):
            if (
                (kin is None or instance_id in kin)
                and self._rows[instance_id].role not in agreement.APART
                and self._fits(phrase, instance_id)
            ):
                raise Untrue(
                    f"it cannot be told whether {phrase.text!r} is instance {instance_id}, which {what}"
                )

    def _kin(self, phrase: InstructionPhrase) -> frozenset[int] | None:
        """All whose color is akin to the phrase's; None, for any, without a color and where none of its noun's is."""
        if phrase.color is None:
            return None
        kin = frozenset(h for h in self._rows if color_space.akin(phrase.color, self._was(h)))
        return kin if not self._of_kind(phrase) or kin & self._of_kind(phrase) else None

    def _named(
        self, phrase: InstructionPhrase, after: bool = False, rank: str | None = None
    ) -> frozenset[int] | None:
        """The instance ids that a phrase means, in the recorded scene or in what is left.

        The instruction's own thing, or else all that fit; None if that cannot be told.
        """
        noun = phrase.nouns[-1] if phrase.nouns else None
        if phrase.color is None and noun and noun not in ANYTHING and not self._meanings(noun):
            return None  # known without a look at any image
        stated = phrase.stated(rank or phrase.ranked)
        found = self._found(stated, after, every=False)
        found = self._found(stated, after) if found is None else found
        if found is None and phrase.color and noun and self._meanings(noun):
            return self._nearly(phrase, after, rank)
        return found

    def _nearly(
        self, phrase: InstructionPhrase, after: bool, rank: str | None
    ) -> frozenset[int] | None:
        """The one thing of a phrase's noun that people may call by its color: silver is white to them.

        Of several it is the one that the task is about, by its role.
        """
        plain = replace(phrase, color=None, nouns=phrase.nouns[-1:]).stated(rank or phrase.ranked)
        alike = [
            h
            for h in self._found(plain, after) or ()
            if color_space.akin(str(phrase.color), self._was(h))
        ]
        with_role = [h for h in alike if self._rows[h].role not in ("", *agreement.APART)]
        only = alike if len(alike) == 1 else with_role
        return frozenset(only) if len(only) == 1 else None

    def _found(self, stated: str, after: bool, every: bool = True) -> frozenset[int] | None:
        if (after, stated, every) not in self._known:
            try:
                scene = self._after if after else self._recorded
                found = targets.find(scene, targets.Target(text=stated, all=every))
            except (TargetError, ValueError):
                found = None
            self._known[after, stated, every] = found
        return self._known[after, stated, every]

    def _of_kind(self, phrase: InstructionPhrase) -> frozenset[int]:
        """All that go by the phrase's noun."""
        return (self._found(phrase.nouns[-1], False) if phrase.nouns else None) or frozenset()

    def _fits(self, phrase: InstructionPhrase, instance_id: int) -> bool:
        """Could a thing be called by the phrase's noun? Where the noun says nothing, any may be."""
        if not phrase.nouns:
            return True
        scene, meanings = self._recorded, self._meanings(phrase.nouns[-1])
        named = frozenset[int]().union(
            *(scene.roles.get(one.role or "", frozenset()) for one in meanings)
        )
        if any(one.shapes for one in meanings):
            return instance_id in self._of_kind(phrase)
        return instance_id in named or not meanings

    def _meanings(self, noun: str) -> list[Meaning]:
        found = understood(noun, self._recorded.descriptions)
        return [one for one in found if one.shapes or one.role in self._recorded.roles]

    @cached_property
    def _rows(self) -> dict[int, InstanceSummary]:
        scene = self._recorded
        return {row.instance_id: row for row in survey(scene.episode, scene.bodies, scene.roles)}

    def _loose(self) -> list[int]:
        """Painted instance ids but those of robot, table and background, which are meant only by name."""
        words = self._changes.words
        return [h for h in sorted(words) if self._rows[h].role not in agreement.APART]

    def _was(self, instance_id: int) -> str:
        return self._rows[instance_id].color_name


def _numbers(text: str) -> list[str]:
    """The numbers of a text, in words or figures, one apart: it is an article as well."""
    found = re.findall(r"\d+|[a-z]+", text.lower())
    figures = [COUNTS.get(word, word) for word in found]
    return sorted(one for one in figures if one.isdigit() and one != "1")


def _goes_by(thing: Added, nouns: tuple[str, ...]) -> bool:
    """Could a new thing be called by these nouns? By its kind, a part of its name, or a word as broad as its shape."""
    if not nouns or nouns[-1] in ANYTHING:
        return True
    noun = nouns[-1]
    for stated in (noun, noun.removesuffix("s"), noun.removesuffix("es")):
        if stated == thing.kind or stated in thing.name.split("_"):
            return True
        alike = shapes.WORDS.get(stated, frozenset()) & shapes.WORDS.get(thing.kind, frozenset())
        if alike and {stated, thing.kind} & BROAD:
            return True
    return False
