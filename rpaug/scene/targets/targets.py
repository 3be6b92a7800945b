"""Which instances an edit is meant for: by instance id, by role, or by a few words."""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    StrictInt,
    model_validator,
)

from rpaug.core import color_space
from rpaug.core.errors import TargetError, there_are
from rpaug.core.types import Scene
from rpaug.scene.sampled_frames import SampledFrames, look
from rpaug.scene.targets import agreement, places, relations, roles, shapes
from rpaug.scene.targets.nouns import ROLES, Meaning, colored_so, understood
from rpaug.scene.targets.observed import surface
from rpaug.scene.targets.relations import Phrase, Relation, singular
from rpaug.scene.targets.resolving import Resolver, why
from rpaug.scene.targets.survey import InstanceSummary, survey

TOUCH = 0.5  # of the strongest chroma that fits a color word: weaker ones are not meant beside it


class TargetPart(BaseModel):
    """A part of the target that is finer than its masks, by a `box` (left, top, right, bottom in pixels) in the image
    of `camera` at `frame`, or by `words` for a `detector`, which then finds the box.

    `segmenter` finds the part in the box: `grabcut`. Both may be models by folder or hub id.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: str
    frame: int = Field(default=0, ge=0)
    box: tuple[float, float, float, float] | None = None
    words: str | None = Field(default=None, min_length=1)
    detector: str | None = None
    segmenter: str = "grabcut"

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.box is None) == (self.words is None) or (self.words is None) != (
            self.detector is None
        ):
            raise ValueError("give a box, or words with a detector")
        if self.box is not None and not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise ValueError(f"box {self.box}: expected left < right and top < bottom")
        return self

    @property
    def instance_id(self) -> int:
        """The instance id that this part gets: always the same for the same words, above those that simulators give."""
        return (1 << 23) + zlib.crc32(self.model_dump_json().encode()) % (1 << 22)


class Target(BaseModel):
    """Exactly one of `handle`, `role` and `text`.

    `text` says what the thing is and where ("the red receiver", "the cup closest to the drawer", "the second
    largest block left of the bowl"): the grammar is that of `relations`, nouns mean what `nouns` says. A noun
    that means nothing here is taken only beside a color word, and then the color decides alone; in color images
    alone it is refused. A plain string is a `text`. With a `part` only that part of the thing is meant. Where
    several things fit, `all` takes them; a body of several instance ids that move as one is one thing.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    handle: StrictInt | list[StrictInt] | None = None
    role: str | None = None
    text: str | None = Field(default=None, min_length=1)
    all: bool = False
    part: TargetPart | None = None

    @model_validator(mode="before")
    @classmethod
    def _plain_text(cls, value: Any) -> Any:
        return {"text": value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: GetJsonSchemaHandler) -> Any:
        """A mapping, or its text alone."""
        return {"anyOf": [{"type": "string", "minLength": 1}, handler(schema)]}

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if sum(value is not None for value in (self.handle, self.role, self.text)) != 1:
            raise ValueError("give exactly one of handle, role, text")
        if self.role is not None and self.role not in roles.NAMES:
            raise ValueError(
                f"no role is called {self.role!r}; {there_are(self.role, roles.NAMES)}"
            )
        if self.handle == []:
            raise ValueError("give at least one handle")
        if self.text is not None:
            relations.parse(self.text)
        return self

    def __str__(self) -> str:
        if self.handle is not None:
            return f"handle {self.handle}"
        return f"role {self.role}" if self.role is not None else repr(self.text)


TABLE, BACKGROUND = Target(role="table"), Target(role="background")


def find(scene: Scene, target: Target) -> frozenset[int]:
    """Handles of the instances that the target names.

    Raises TargetError if there is none, or if several things fit where one was meant, and lists what there is.
    """
    if target.part is not None:
        if target.part.instance_id not in scene.instance_ids:
            raise TargetError(f"{target}: its part was not told apart in this episode")
        return frozenset([target.part.instance_id])
    if target.handle is not None:
        wanted = frozenset([target.handle] if isinstance(target.handle, int) else target.handle)
        if wanted - scene.instance_ids:
            raise TargetError(
                f"{target}: no such instance {_numbers(wanted - scene.instance_ids)}; {_there_is(_rows(scene), scene)}"
            )
        if reason := _unlike(scene, wanted):
            raise TargetError(
                f"{target}: {reason}{_together(scene, wanted)}; `views` of cameras.yaml names the cameras to edit"
            )
        return wanted
    if target.role is not None:
        if target.role not in scene.roles:
            raise TargetError(
                f"{target}: {why(scene, target.role)}; {_there_is(_rows(scene), scene)}"
            )
        found = scene.roles[target.role]
    else:
        found = by_words(scene, target)
    if disputed := _disputed(scene, found, every=target.all):
        thing, reason = disputed
        raise TargetError(
            f"{target}: instance {_numbers(thing)}: {reason}{_together(scene, thing)}"
        )
    return found


def _disputed(
    scene: Scene, found: frozenset[int], *, every: bool
) -> tuple[frozenset[int], str] | None:
    """The first thing of a photographed scene on which its cameras may not agree, and why; `every`: each instance is
    one, else all are one together."""
    if not agreement.photographed(scene) or found & agreement.apart(scene):
        return None
    named = frozenset[int]().union(*scene.names.values())
    for thing in [frozenset({one}) for one in sorted(found)] if every else [found]:
        outlined, others = named >= thing, found - thing
        if reason := agreement.dispute(scene, thing, outlined=outlined, besides=others):
            return thing, reason
    return None


def _unlike(scene: Scene, wanted: frozenset[int]) -> str:
    """Why instances that are named by their ids are not one thing in all cameras of a photographed scene; empty if
    nothing speaks against it."""
    if not agreement.photographed(scene) or wanted & agreement.apart(scene):
        return ""
    named = frozenset[int]().union(*scene.names.values())
    known = named | agreement.apart(scene) if named >= wanted else frozenset[int]()
    return agreement.split(scene, wanted, known)


def _together(scene: Scene, thing: frozenset[int]) -> str:
    """How to name a thing with what it may be in cameras that do not show it, if its cameras agree on that."""
    there = agreement.missed(scene, thing).values()
    both = thing.union(one for one in there if one is not None)
    if both == thing or agreement.cut_off(scene, thing) or _unlike(scene, both):
        return ""
    return f"; where that is so, {{handle: {sorted(both)}}} in a recipe of this episode alone takes both"


def by_words(scene: Scene, target: Target, *, whole: bool = False) -> frozenset[int]:
    """What the target's words mean. By its color alone nothing of a photographed scene is robot, table or background,
    unless `whole`. Raises TargetError."""
    phrase = relations.parse(target.text or "")
    found = _Finder(scene, str(target), whole).things(phrase, target.all)
    if len(found) > 1 and not target.all:
        listed = _list(_firsts(_rows(scene), found))
        raise TargetError(f"{target}: {len(found)} things fit: {listed}; {_choice(scene, found)}")
    return frozenset().union(*found)


def _choice(scene: Scene, found: Sequence[frozenset[int]]) -> str:
    """What would settle which of several things are meant: each way that works in this scene."""
    every = frozenset[int]().union(*found)
    if not agreement.photographed(scene):
        return "say more, or set all: true to take them all"
    ways = ["say more"] if agreement.modelled(scene) else []  # places take depth
    ways += [
        f"{{handle: {sorted(one)}}} in a recipe of this episode alone takes one"
        for one in found
        if not _unlike(scene, one)
    ]
    if not _disputed(scene, every, every=True):
        ways.append("all: true takes them all")
    elif not _unlike(scene, every):
        ways.append(f"{{handle: {sorted(every)}}} in a recipe of this episode alone takes all")
    return (
        ", ".join(ways)
        or "cameras do not agree on any: `views` of cameras.yaml names those to edit"
    )


def wording(phrase: Phrase) -> str:
    """A phrase's own words as models are asked for them: what it is, not where."""
    return " ".join(filter(None, [phrase.color, *phrase.nouns]))


def phrases(target: Target) -> list[str]:
    """The words of a target that a model can be asked for: of the thing, and of what it stands beside."""
    if target.text is None:
        return []
    left, out = [relations.parse(target.text)], list[str]()
    while left:
        phrase = left.pop()
        left += [anchor for relation in phrase.relations for anchor in relation.anchors]
        if phrase.nouns and phrase.role is None and phrase.nouns[-1] not in ROLES:
            out.append(wording(phrase))
    return out


def assumed(scene: Scene, target: Target) -> str:
    """In a sentence that nothing but its color tells a thing that a target names; empty where more does."""
    phrase = relations.parse(target.text or "thing")
    if not (agreement.photographed(scene) and phrase.nouns and phrase.color):
        return ""
    try:
        found = find(scene, target)
    except TargetError:
        return ""
    if any(found <= members for members in scene.roles.values()):
        return ""
    if any(found <= members for members in scene.names.values()):
        return ""
    return f"without a model {target} is known by its color alone: instance {_numbers(found)}"


class _Finder:
    """Finds what a phrase and the phrases inside it mean. A thing is a group of instance ids: those of a role together,
    else those of a body. Images are looked at only if a color, a shape or a place is asked for."""

    def __init__(self, scene: Scene, stated: str, whole: bool) -> None:
        self._scene, self._stated = scene, stated
        self._named_only = agreement.photographed(scene) and not whole
        self._looks: SampledFrames | None = None

    @cached_property
    def _rows(self) -> Sequence[InstanceSummary]:
        return _rows(self._scene)

    def things(self, phrase: Phrase, every: bool = False) -> list[frozenset[int]]:
        """One thing or several that the phrase fits, `every` or the likeliest. Raises TargetError if it fits none."""
        phrase = self._owned(phrase)
        found, settled = self._described(phrase, every)
        if settled:
            phrase = replace(phrase, ranks=())
        if phrase.spatial:
            found = self._placed(phrase, found)
        if not found:
            raise TargetError(f"{self._stated}: nothing fits; {_there_is(self._rows, self._scene)}")
        return found

    def _owned(self, phrase: Phrase) -> Phrase:
        """ "The cabinet drawer" as "the drawer of the cabinet", where both nouns are known by what they do."""
        nouns, given = phrase.nouns, self._scene.descriptions
        if len(nouns) != 2 or any(one.scope == "" for one in understood(nouns[0], given)):
            return phrase
        if not understood(nouns[0], given) or nouns[0] in self._qualifiers(nouns[1]):
            return phrase
        owner = Relation("part of", (Phrase(nouns=nouns[:1]),))
        return replace(phrase, nouns=nouns[1:], relations=(*phrase.relations, owner))

    def _described(self, phrase: Phrase, every: bool) -> tuple[list[frozenset[int]], bool]:
        """Things with the phrase's role, color and noun; and whether they are those that its place words tell."""
        if phrase.role is not None:
            return self._playing(phrase.role, phrase), False
        if (named := self._named(phrase)) is not None:
            return named, False
        meanings = self._meanings(phrase)
        for word in phrase.nouns[:-1]:
            if phrase.color is None and word not in self._qualifiers(phrase.nouns[-1]):
                raise TargetError(
                    f"{self._stated}: {word!r} is nothing that masks and depth can tell"
                )
        every = every or any(noun != singular(noun) for noun in phrase.nouns[-1:])
        role = next((one.role for one in meanings if one.role and not one.scope), None)
        if role is not None:
            return self._playing(role, phrase), False
        shaped = self._shaped(phrase, meanings)
        own, settled, reason = self._own(phrase, meanings, every)
        meant = frozenset[int]().union(*own)
        others = [group for group in shaped if not group & meant]
        if others and len(others) == len(shaped) and self._shaped_otherwise(meant):
            if not every:
                raise TargetError(
                    f"{self._stated}: by the instruction it is {_numbers(meant)}, and that has another shape; by "
                    f"shape it is {_list(_firsts(self._rows, others))}"
                )
            own = []
        if settled and own and not others:
            return own, True
        if settled and own and not every:
            self._agrees(phrase, own, others)
        # The instruction's own thing, if it calls it so without another word; else all of that shape may be meant.
        bare = any(one.scope and not one.ranks and not one.color for one in meanings)
        sole = bare and not every and not phrase.spatial
        found = own if own and sole else [*own, *others]
        if phrase.ranks and found == own and len(own) == 1:
            reason = f"of {phrase.nouns[-1]}s one alone is known, and the instruction does not call it so"
            found = []
        if found:
            return found, False
        if reason and phrase.color is None:
            raise TargetError(f"{self._stated}: {reason}; {_there_is(self._rows, self._scene)}")
        if meanings and phrase.color is None and not own and not self._look().cameras:
            raise TargetError(
                f"{self._stated}: the instruction names no {phrase.nouns[-1]}, and without depth no shape tells one; "
                f"{_there_is(self._rows, self._scene)}"
            )
        # What the instruction calls so is known, and has another color: no other thing is meant.
        other = self._named_only and any(one.scope for one in meanings) and not reason
        if meanings and (phrase.color is None or settled or other):
            return [], False
        return self._by_color(phrase, meanings), False

    def _named(self, phrase: Phrase) -> list[frozenset[int]] | None:
        """What models found by the phrase's words; None if they were not asked, or masks and motion tell more.

        Raises TargetError if it is nothing.
        """
        known = self._scene.names
        masked = not any(view.inferred for view in self._scene.episode.views.values())
        if masked and phrase.nouns and understood(phrase.nouns[-1], self._scene.descriptions):
            return None
        words = [word for word in (wording(phrase), *phrase.nouns[-1:]) if word in known]
        if not words:
            return None
        # "The red cup": what goes by both words, else the cups that are red.
        if words[0] == wording(phrase) and known[words[0]]:
            return [frozenset([one]) for one in sorted(known[words[0]])]
        rows = [row for row in self._rows if row.instance_id in known[words[-1]]]
        found = _bodies(self._colored(phrase, rows))
        if not found:
            raise TargetError(f"{self._stated}: the models found no {words[0]}")
        return found

    def _by_color(self, phrase: Phrase, meanings: Sequence[Meaning]) -> list[frozenset[int]]:
        """What has the phrase's color.

        In a photographed scene a noun must be one of the instruction's, and the thing none that plays another's part
        there or that the instruction describes by this color. Raises TargetError.
        """
        rows = self._movable() if phrase.spatial or self._named_only else self._rows
        if self._named_only and phrase.nouns:
            noun, own = phrase.nouns[-1], [one for one in meanings if one.scope]
            if not own:
                raise TargetError(
                    f"{self._stated}: the instruction names no {noun}, and without a model its color alone would tell "
                    f"it ('the {phrase.color} thing' takes whatever is {phrase.color}); "
                    f"{_there_is(self._rows, self._scene)}"
                )
            if phrase.color not in [one.color for one in own] and (
                rival := colored_so(phrase.color, self._scene.descriptions)
            ):
                raise TargetError(
                    f"{self._stated}: in the instruction {phrase.color} is the {rival}"
                )
            rows = [row for row in rows if row.role in {"", *(one.role for one in own)}]
        return _bodies(self._colored(phrase, rows))

    def _qualifiers(self, noun: str) -> set[str]:
        """The words that the instruction says before a noun: "wine" of the wine bottle."""
        found = understood(noun, self._scene.descriptions)
        return {word for meaning in found for word in meaning.qualifiers}

    def _shaped(self, phrase: Phrase, meanings: Sequence[Meaning]) -> list[frozenset[int]]:
        """Things of a shape that the noun may mean, and of the phrase's color; none without depth."""
        wanted = frozenset().union(*(meaning.shapes for meaning in meanings))
        if not wanted or not self._look().cameras:
            return []
        rows = [row for row in self._movable() if self._shape(row) in wanted]
        return _bodies(self._colored(phrase, rows))

    def _agrees(
        self, phrase: Phrase, own: list[frozenset[int]], others: list[frozenset[int]]
    ) -> None:
        """See that what the instruction calls the left bowl is the left one of the bowls. Raises TargetError."""
        found = self._placed(replace(phrase, relations=()), [*own, *others])
        if found != own:
            raise TargetError(
                f"{self._stated}: the instruction calls {_list(_firsts(self._rows, own))} so, and it is "
                f"{_list(_firsts(self._rows, found))} by its place or size (left and right are the robot's)"
            )

    def _shaped_otherwise(self, meant: frozenset[int]) -> bool:
        """Is it of a measured shape? What is large, or of several instances, has none."""
        rows = [row for row in self._rows if row.instance_id in meant]
        return len(rows) == 1 and bool(self._shape(rows[0]))

    def _own(
        self, phrase: Phrase, meanings: Sequence[Meaning], every: bool
    ) -> tuple[list[frozenset[int]], bool, str]:
        """What the instruction's own noun means: things, whether place words are settled, and why there are none."""
        reason, out = "", list[frozenset[int]]()
        for meaning in meanings:
            if not meaning.scope:
                continue
            try:
                found = self._resolver(meaning, phrase)
            except TargetError as error:
                reason = reason or str(error)
                continue
            wanted = found.all if every and not found.settled else found.likely
            fits = self._of_color(phrase, wanted) or self._of_color(phrase, found.all) * (
                phrase.color is not None and not found.settled
            )
            fits = fits or self._dimmed(phrase, found.all)
            if found.settled:
                return fits, True, ""
            # "The left bowl on the right bowl": two things go by the noun; a cabinet's part by that of the cabinet.
            out = [group for group in out if not any(group < fit for fit in fits)]
            out += [fit for fit in fits if not any(fit <= group for group in out)]
        return out, False, "" if out else reason

    def _of_color(self, phrase: Phrase, groups: Iterable[frozenset[int]]) -> list[frozenset[int]]:
        """Of each thing the instance ids that have the phrase's color."""
        if phrase.color is None:
            return [group for group in groups if group]
        rows = [[row for row in self._rows if row.instance_id in group] for group in groups]
        fits = [frozenset(row.instance_id for row in self._colored(phrase, some)) for some in rows]
        return [fit for fit in fits if fit]

    def _dimmed(self, phrase: Phrase, groups: Sequence[frozenset[int]]) -> list[frozenset[int]]:
        """In color images alone the one thing that a noun means has its color, as far as light and shade leave it, if
        nothing else has: an orange carrot in a dim sink is brown."""
        if not self._named_only or phrase.color is None or len(groups) != 1:
            return []
        if self._colored(phrase, self._movable()):
            return []
        rows = [row for row in self._rows if row.instance_id in groups[0]]
        near = [color_space.akin(phrase.color, row.color_name) for row in rows]
        return list(groups) if rows and all(near) else []

    @cached_property
    def _resolver(self) -> Resolver:
        return Resolver(self._scene, self._look())

    def _meanings(self, phrase: Phrase) -> list[Meaning]:
        """What the head noun means here. Raises TargetError if it means nothing and there is no color to go by."""
        if not phrase.nouns:
            return []
        noun = phrase.nouns[-1]
        found = understood(noun, self._scene.descriptions)
        if not found and phrase.color is None:
            raise TargetError(
                f"{self._stated}: {noun!r} is no role, no shape and not in the instruction: such nouns need a detector"
                f" (--models text=NAME; the extra rpaug[words] brings synonyms). Roles: {', '.join(roles.NAMES)}; "
                f"shapes: {', '.join(sorted(shapes.WORDS))}; {_there_is(self._rows, self._scene)}"
            )
        return found

    def _playing(self, role: str, phrase: Phrase) -> list[frozenset[int]]:
        """What has that role and the phrase's color, as one thing."""
        known = self._scene.roles.get(role)
        if not known:
            raise TargetError(
                f"{self._stated}: {why(self._scene, role)}; {_there_is(self._rows, self._scene)}"
            )
        return self._of_color(phrase, [known & self._scene.instance_ids])

    def _movable(self) -> list[InstanceSummary]:
        """All but robot, table and background, which are meant only by name."""
        apart = agreement.apart(self._scene)
        return [row for row in self._rows if row.instance_id not in apart]

    def _colored(
        self, phrase: Phrase, rows: Sequence[InstanceSummary]
    ) -> Sequence[InstanceSummary]:
        color = phrase.color
        if color is None:
            return rows
        exact = [row for row in rows if row.color_name == color]
        exact = exact or [row for row in rows if color_space.means(color, row.color_name)]
        if not agreement.photographed(self._scene):
            return exact
        # Beside a thing that has much of a color, what has a touch of it is not meant.
        given = exact or [row for row in rows if color_space.hued(color, np.array(row.color))]
        chroma = [float(np.hypot(*color_space.to_lab(np.array(row.color))[1:])) for row in given]
        least = TOUCH * max(chroma, default=0.0)
        return [row for row, own in zip(given, chroma, strict=True) if own >= least]

    def _shape(self, row: InstanceSummary) -> str:
        body = next(body for body in self._scene.bodies if row.instance_id in body.instance_ids)
        return shapes.shape(*surface(self._look(), row.instance_id, body))

    def _look(self) -> SampledFrames:
        if self._looks is None:
            self._looks = look(self._scene.episode)
        return self._looks

    def _placed(self, phrase: Phrase, found: list[frozenset[int]]) -> list[frozenset[int]]:
        """Of these things those that stand as the phrase says, ranked and counted."""
        anchors = [tuple(map(self._anchor, relation.anchors)) for relation in phrase.relations]
        beside = [
            some
            for relation, some in zip(phrase.relations, anchors, strict=True)
            if relation.name != "part of"
        ]
        taken = frozenset[int]().union(*(group for some in beside for group in some))
        found = [group for group in found if not group & taken]
        groups = [*found, *(group for some in anchors for group in some)]
        where = places.places(self._scene, self._look(), groups)
        for group in groups:
            if group in where:
                continue
            raise TargetError(
                f"{self._stated}: no camera shows instance {_numbers(group)} with depth"
            )
        left = [where[group] for group in found]
        for relation, some in zip(phrase.relations, anchors, strict=True):
            left = places.related(relation.name, left, [where[group] for group in some])
        if len(phrase.ranks) == 1 and phrase.ranks[0] not in ("middle", "upper", "lower"):
            left = places.ranked(phrase.ranks[0], left)[phrase.ordinal : phrase.ordinal + 1]
        elif phrase.ranks:
            try:
                left = places.placed(phrase.ranks, phrase.ordinal, left)
            except ValueError as error:
                listed = _list(_firsts(self._rows, found))
                raise TargetError(f"{self._stated}: {error}: {listed}") from error
        return [place.instance_ids for place in left]

    def _anchor(self, phrase: Phrase) -> frozenset[int]:
        """The one thing that an inner phrase means."""
        found = self.things(phrase)
        if len(found) > 1:
            listed = _list(_firsts(self._rows, found))
            raise TargetError(f"{self._stated}: of which? {len(found)} things fit there: {listed}")
        return found[0]


def _bodies(rows: Sequence[InstanceSummary]) -> list[frozenset[int]]:
    return list(dict.fromkeys(row.body for row in rows))


def _firsts(
    rows: Sequence[InstanceSummary], things: Sequence[frozenset[int]]
) -> list[InstanceSummary]:
    """One row to show for each thing."""
    return [next(row for row in rows if row.instance_id in group) for group in things]


def _rows(scene: Scene) -> tuple[InstanceSummary, ...]:
    return survey(scene.episode, scene.bodies, scene.roles)


def _numbers(instance_ids: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(instance_ids)))


def _list(rows: Iterable[InstanceSummary]) -> str:
    return "; ".join(map(str, rows))


def _there_is(rows: Sequence[InstanceSummary], scene: Scene) -> str:
    by_color = agreement.photographed(scene) and not scene.names
    models = f"{BY_WORDS}; " if by_color else ""
    if not rows:
        return "there is no instance at all"
    more = f"; and {len(rows) - LISTED} more, by `rpaug inspect`" if len(rows) > LISTED else ""
    return f"{models}there is: {_list(rows[:LISTED])}{more}"


LISTED = 16  # instances that a refusal names: a table of masks has fewer, patches of color are more
BY_WORDS = "a detector, or outlines that you draw, tell things by words: --models text=NAME, or text=outlines:FILE"
