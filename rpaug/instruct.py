"""The instruction follows the edit: what was "the red cup" is "the blue cup" once it is blue, and only then.

A colour word of an instruction is changed where the thing it names was painted as a whole. Where that cannot be told,
or where the words would now fit another thing as well, the copy is rejected rather than written with words that lie.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpaug.assets import library
from rpaug.errors import RpaugError, TargetError
from rpaug.scene.naming import colours, relations, targets
from rpaug.scene.naming.nouns import TOWARDS, VERBS, understood
from rpaug.scene.naming.survey import InstanceSummary, survey
from rpaug.types import Scene

STOPS = (
    TOWARDS
    | VERBS
    | relations.FILLERS
    | {"for", "but", "until", "both", "or", "left", "right", "while", "using"}
)


class Untrue(RpaugError):
    """After the edits an instruction would not be true, or not clear, and it is not known how to mend it."""


@dataclass(frozen=True)
class Phrase:
    """A colour word and the nouns after it, with where the colour word stands in the text."""

    colour: str
    nouns: tuple[str, ...]
    start: int
    end: int

    @property
    def text(self) -> str:
        """The phrase as a target's words."""
        return " ".join([self.colour, *(self.nouns or ("thing",))])


@dataclass(frozen=True)
class Painted:
    """What the edits made of the recorded colours: a colour name for each painted handle, None for a new pattern."""

    looks: Mapping[int, str | None]
    added: tuple[tuple[str, str], ...]  # kind and colour of each new thing
    copied: frozenset[int]  # handles of which there are copies


def followed(scene: Scene, draws: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """The descriptions after the edits. Raises Untrue.

    `scene` is the edited one, `draws` are the edits as a report describes them.
    """
    if not any(True for text in scene.descriptions for _ in phrases(text)):
        return scene.descriptions
    painted = _painted(scene, draws)
    if not (painted.looks or painted.added or painted.copied):
        return scene.descriptions
    judge = _Judge(recorded(scene), painted)
    return tuple(judge.rewritten(text) for text in scene.descriptions)


def recorded(scene: Scene) -> Scene:
    """The scene as it was before any edit."""
    return replace(scene, bodies=scene.tracked, recorded_bodies=None, appearance=(), sensor=())


def phrases(text: str) -> Iterator[Phrase]:
    """Every colour word of an instruction, with the nouns that it describes."""
    words = list(re.finditer(r"[A-Za-z]+", text))
    for number, word in enumerate(words):
        name = colours.canonical(word.group())
        if name is None:
            continue
        nouns: list[str] = []
        for before, following in zip(words[number:], words[number + 1 :], strict=False):
            lower = following.group().lower()
            apart = text[before.end() : following.start()].strip(" ")
            if apart or lower in STOPS or colours.canonical(lower):
                break
            nouns.append(lower)
        # "the orange on the plate" is a fruit, and "the orange" alone has no noun.
        if nouns or name != "orange":
            yield Phrase(name, tuple(nouns), word.start(), word.end())


def _painted(scene: Scene, draws: Sequence[Mapping[str, Any]]) -> Painted:
    looks: dict[int, str | None] = {}
    known = frozenset().union(*(body.handles for body in scene.tracked))
    for appearance in scene.appearance:
        if appearance.handles is None:  # light falls on all alike, and names no thing anew
            continue
        asked = getattr(appearance, "asked", None)
        name = None if asked is None else colours.nearest(np.array(asked))
        looks.update({handle: name for handle in appearance.handles if handle in known})
    added = tuple(
        (asset.category, asset.colour)
        for draw in draws
        for thing in (draw.get("edit") or {}).get("things", ())
        if (asset := library.get(thing["asset"]))
    )
    copied = frozenset(old for body in scene.bodies for old in body.copy_of)
    return Painted(looks, added, copied)


class _Judge:
    """Says what each phrase means in the recorded scene, and what must become of it."""

    def __init__(self, scene: Scene, painted: Painted) -> None:
        self._scene, self._painted = scene, painted
        self._rows: dict[int, InstanceSummary] = {
            row.handle: row for row in survey(scene.episode, scene.bodies, scene.roles)
        }

    def rewritten(self, text: str) -> str:
        """The instruction with the colour words that the edits call for. Raises Untrue."""
        for phrase in reversed(list(phrases(text))):
            name = self._becomes(phrase)
            self._clear(phrase, name)
            if name != phrase.colour:
                text = _with(text, phrase, name)
        return text

    def _becomes(self, phrase: Phrase) -> str:
        """The colour word that is true after the edits. Raises Untrue."""
        named = self._named(phrase)
        if named is None:
            doubtful = [h for h in self._loose() if colours.means(phrase.colour, self._was(h))]
            if doubtful:
                raise Untrue(
                    f"it cannot be told whether {phrase.text!r} is handle {doubtful[0]}, which was painted"
                )
            return phrase.colour
        new = {self._painted.looks.get(handle, phrase.colour) for handle in named}
        if None in new:
            raise Untrue(f"{phrase.text!r} has another pattern now, and no one colour")
        names = {str(name) for name in new}
        if all(colours.means(phrase.colour, name) for name in names):
            return phrase.colour
        if len(names) > 1:
            raise Untrue(f"{phrase.text!r} is {' and '.join(sorted(names))} now")
        return names.pop()

    def _clear(self, phrase: Phrase, name: str) -> None:
        """See that what the words say now fits nothing that they did not mean. Raises Untrue."""
        own = self._named(phrase) or frozenset()
        if own & self._painted.copied:
            raise Untrue(f"{phrase.text!r} is there more than once now")
        for handle in self._loose():
            new = self._painted.looks[handle]
            if (
                handle not in own
                and new
                and colours.means(name, new)
                and self._fits(phrase, handle)
            ):
                raise Untrue(
                    f"handle {handle} was painted {new}: {name} {' '.join(phrase.nouns)} could be it too"
                )
        for kind, tint in self._painted.added:
            alike = not phrase.nouns or phrase.nouns[-1].removesuffix("s") == kind
            if alike and colours.means(name, tint):
                raise Untrue(
                    f"a {tint} {kind} was put in: {name} {' '.join(phrase.nouns)} could be it too"
                )

    def _named(self, phrase: Phrase) -> frozenset[int] | None:
        """The handles that a phrase means in the recorded scene; None if that cannot be told."""
        try:
            return targets.find(self._scene, targets.Target(text=phrase.text, all=True))
        except (TargetError, ValueError):
            return None

    def _fits(self, phrase: Phrase, handle: int) -> bool:
        """Could a thing be called by the phrase's noun? Where the noun says nothing, any may be."""
        if not phrase.nouns:
            return True
        meanings = understood(phrase.nouns[-1], self._scene.descriptions, self._scene.roles)
        named = frozenset[int]().union(
            *(self._scene.roles.get(one.role or "", frozenset()) for one in meanings)
        )
        if any(one.shapes for one in meanings):
            try:
                like = targets.Target(text=phrase.nouns[-1], all=True)
                return handle in targets.find(self._scene, like)
            except TargetError:
                return False
        return handle in named or not meanings

    def _loose(self) -> list[int]:
        """Painted handles but those of robot, table and background, which are meant only by name."""
        return [h for h in sorted(self._painted.looks) if self._rows[h].role not in targets.APART]

    def _was(self, handle: int) -> str:
        return self._rows[handle].colour_name


def _with(text: str, phrase: Phrase, name: str) -> str:
    """The text with another colour word in the phrase's place, its article and its capital kept right."""
    old = text[phrase.start : phrase.end]
    new = name.capitalize() if old[0].isupper() else name
    before = text[: phrase.start]
    article = re.search(r"\b([Aa])n?( +)$", before)
    if article:
        right = article[1] + ("n" if name[0] in "aeiou" else "")
        before = before[: article.start()] + right + article[2]
    return before + new + text[phrase.end :]
