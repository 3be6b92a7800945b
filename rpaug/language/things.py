"""Which things are meant: a noun phrase at the beginning of some words, and the recipe's targets that it stands for."""
# ruff: noqa: E501  # patterns are easiest to read whole

import contextlib
import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rpaug.core import color_space
from rpaug.core.errors import RpaugError, TargetError
from rpaug.language.lexicon import group, senses
from rpaug.language.messages import Mention, NotUnderstood
from rpaug.language.recording import Recording
from rpaug.language.values import NUMBERS, PARTS, texture
from rpaug.scene.targets import relations, roles, shapes, targets
from rpaug.scene.targets.nouns import FURNITURE, ROLES
from rpaug.scene.targets.relations import ANYTHING, singular

Target = str | dict[str, Any]

COUNTED = frozenset({*NUMBERS, *PARTS})
UNSAID = group("things_unsaid")
PRONOUNS = ("it", "that", "this", "them", "that one", "these", "those", "both of them", "this one")
SEVERAL = re.compile(
    r"(?:all of the|all the|each of the|both of the|every one of the|all of|each of|all|every|each|both|the two|the three)\b ?(?:the )?"
)
ARTICLE = re.compile(r"(?:the|a|an|this|that|its|your|our|my|another|one)\b ?")
NUMBERED = re.compile(r"(?:object|handle|instance|thing|number|#)(?: number)? ?#?(\d+)")
HANDLED = re.compile(
    r"(?:the )?(?:(?:what(?:ever)? |(?:the )?(?:thing|object) (?:that )?)?(?:the )?(?:robot|gripper|arm) (?:is )?(?:moves|manipulates|holding|holds|grasps|carries)"
    r"|(?:the )?(?:thing|object|one) in the (?:gripper|hand)|(?:the )?(?:manipulated|moved|handled|held|grasped) (?:object|thing|item))\b"
)
PHRASES = {
    "robot arm": "robot",
    "robotic arm": "robot",
    "receiving object": "receiver",
    "receiving thing": "receiver",
}
PLAIN = group("things_plain")  # told by nothing that is measured
NEARLY = {
    "white": ("silver", "gray"),
    "yellow": ("gold", "orange"),
    "black": ("gray",),
    "gray": ("silver",),
    "brown": ("orange", "tan"),
}
WHOLE = frozenset({"body", "base", "itself"})  # after a noun: what that names
ARMS = ("arm", "robot arm", "robotic arm", "manipulator", "arm links")
FINGERS = group("things_fingers")
ROBOTS = frozenset({"sawyer", "panda", "franka", "kuka", "ur5", "ur10", "manipulator"})
COMPARED = {"smaller": "smallest", "larger": "largest", "bigger": "largest", "taller": "tallest"}
PATTERNED = group("things_patterned")
FLOOR, WALL = ("floor", "ground"), ("wall", "walls")
PLACES = frozenset(
    f"{by} the {side}" for by in ("at", "from") for side in ("top", "bottom", "left", "right")
)
SIDE = re.compile(
    rf"(?:(?P<tint>{'|'.join(color_space.NAMES)}|grey) )?(?:tiled? )?(?P<side>floor|ground|walls?)(?: tiles?)?"
)
PALE = ("white", "silver", "gray", "black")
"""What walls of any color are measured as in poor light."""
FLAT = 5  # cm: the room's flat sides are thinner
# What no thing on a table is called: what rpaug itself is made of.
NO_THING = group("things_no_thing")


@dataclass(frozen=True)
class Named:
    """Things as they were named: with `except_`, without those; `fresh` if they are new to the scene ("a mug")."""

    words: str
    several: bool = False
    fresh: bool = False
    count: int | None = None
    pronoun: bool = False


def begins(words: Sequence[str], nouns: Collection[str] = ()) -> tuple[int, Named] | None:
    """The noun phrase that some words begin with, and how many of them it takes; None where there is none.

    `nouns` are what the scene's things are called; a word that is none of them needs an article.
    """
    text = " ".join(words)
    if found := HANDLED.match(text):
        return len(found.group().split()), Named("manipulated")
    if found := NUMBERED.match(text):
        return len(found.group().split()), Named(found.group())
    for pronoun in sorted(PRONOUNS, key=len, reverse=True):
        size = len(pronoun.split())
        if list(words[:size]) == pronoun.split() and not _nominal(words[size:]):
            return size, Named(pronoun, several=pronoun in ("them", "these", "those"), pronoun=True)
    at, several, fresh = 0, False, False
    if found := SEVERAL.match(text):
        several, at = True, len(found.group().split())
    elif found := ARTICLE.match(text):
        fresh = found.group().strip() in ("a", "an", "another", "one")
        at = 1
    other = list(words[at : at + 1]) == ["other"] and "the" in words[:at]
    at += other
    end = _end(words, at, at > 0, nouns)
    if end == at:
        return None
    kept = [w for k, w in enumerate(words[at:end], at) if w not in PLAIN or k + 1 == end]
    kept = [w for k, w in enumerate(kept) if not (k and w in WHOLE and w not in nouns)]
    kept[0] = COMPARED.get(kept[0], kept[0])
    kept = ["other"] * (other and words[at] not in ANYTHING and words[at] != "ones") + kept
    return end, Named(
        " ".join(kept), several, fresh, 2 if text.startswith(("the two", "both", "two")) else None
    )


def _nominal(words: Sequence[str]) -> bool:
    """Do the words go on with the noun that an article leads to?"""
    return bool(words) and (
        _noun(words[0], False) or (_described(words[0]) and _leads(words, 0, True, ()))
    )


def _described(word: str) -> bool:
    """Is it a word that describes a thing?"""
    return color_space.canonical(word) is not None or is_rank(word) or word in PATTERNED


def _known(word: str, nouns: Collection[str] = ()) -> bool:
    """Is it what some thing is called, by its shape, its role, its part or this scene?"""
    bare = singular(word)
    listed = (
        bare in shapes.WORDS
        or word in ROLES
        or word in roles.NAMES
        or word in ANYTHING
        or word in ROBOTS
        or word in FINGERS
        or bare in relations.PARTS | relations.GRIPS | FURNITURE
    )
    return word not in COUNTED and (
        listed or ((word in nouns or bare in nouns) and word not in senses())
    )


def _noun(word: str, led: bool, nouns: Collection[str] = ()) -> bool:
    """May a word be a noun here? After an article even one that nothing is known to be called."""
    if not re.fullmatch(r"[a-z][a-z_'-]*", word) or word in COUNTED:
        return False
    if _known(word, nouns) and (led or word not in senses()):
        return True
    return (
        led
        and word not in senses()
        and word not in PRONOUNS
        and color_space.canonical(word) is None
        and color_space.canonical(singular(word)) is None
        and not is_rank(word)
    )


def _end(words: Sequence[str], at: int, led: bool, nouns: Collection[str]) -> int:
    """Where the noun phrase from a word on ends; `at` if there is none."""
    k, count, named = at, 0, False
    while k < len(words):
        word = words[k]
        size = relations.relation_at(list(words), k)[1] if count else 0
        describes = (
            color_space.canonical(word) is not None
            or is_rank(word)
            or word == "most"
            or word in PLAIN
            or word in PATTERNED
            or (word in COMPARED and k == at == 1 and words[0] == "the")
        )
        if size:
            beyond = _beyond(words, k, size, nouns)
            if beyond == k:
                break
            k = beyond
        elif (
            count
            and word in ("that", "which")
            and words[k + 1 : k + 2] in (["is"], ["are"])
            and relations.relation_at(list(words), k + 2)[1]
        ):
            k += 2
        elif count and " ".join(words[k : k + 3]) in PLACES and _placed(words[at:k], word):
            k += 3
        elif not count and (
            (word in ("one", "ones") and k > at) or (not describes and _noun(word, led, nouns))
        ):
            count, named, k = 1, _known(word, nouns), k + 1
        elif not count and describes and _leads(words, k + 1, led, nouns):
            k += 1
        elif not count and _known(word, nouns) and (led or word not in senses()):
            count, named, k = 1, True, k + 1
        elif (
            count
            and count < 3
            and not describes
            and not _pattern(words[k:])
            and (_known(word, nouns) or (not named and _noun(word, led)) or word in WHOLE)
        ):
            count, named, k = count + 1, named or _known(word, nouns), k + 1
        else:
            break
    return k if count else at


def _placed(words: Sequence[str], by: str) -> bool:
    """Is a part told by its place: "the drawer at the bottom", and by an ordinal "from the top"?"""
    return by == "at" or any(is_rank(word) for word in words)


def _beyond(words: Sequence[str], k: int, size: int, nouns: Collection[str]) -> int:
    """Where a relation from the k-th word on ends with what it is to; `k` if it is none: "in blue"."""
    start = k + size
    ahead = begins(words[start:], nouns)
    bare = start
    while bare < len(words) and words[bare] in UNSAID:
        bare += 1
    value = bare < len(words) and (
        _pattern(words[bare:])
        or color_space.canonical(words[bare]) is not None
        or color_space.canonical(singular(words[bare])) is not None
    )
    if ahead is None or (value and not _leads(words, bare + 1, False, nouns)):
        return k
    end = start + ahead[0]
    if words[k : k + 1] == ["between"] or words[k : k + 2] == ["in", "between"]:
        more = begins(words[end + 1 :], nouns) if words[end : end + 1] == ["and"] else None
        return end + 1 + more[0] if more else k
    return end


def _pattern(words: Sequence[str]) -> bool:
    """Do some words begin with a texture rather than with a thing?"""
    return bool(texture(words)[0]) and (
        singular(words[0]) not in shapes.WORDS or words[0] in ("marble", "brick")
    )


def _leads(words: Sequence[str], k: int, led: bool, nouns: Collection[str]) -> bool:
    """Do the words from the k-th on reach a noun over attributes alone?"""
    while k < len(words) and (
        color_space.canonical(words[k]) is not None
        or is_rank(words[k])
        or words[k] in PLAIN
        or words[k] in PATTERNED
        or words[k] == "most"
    ):
        k += 1
    if k == len(words):
        return False
    return words[k] in ("one", "ones") or (
        _noun(words[k], True, nouns)
        and (led or _known(words[k], nouns))
        and (led or not _pattern(words[k:]))
    )


def is_rank(word: str) -> bool:
    """Does a word describe a thing by its rank among others: "largest", "second", "left"?"""
    return word in relations.RANKS or word in relations.ORDINALS


class Namer:
    """Turns named things into targets; with a recording it tells apart what no words of a recipe can."""

    def __init__(self, recording: Recording | None, mention: Mention | None) -> None:
        self.recording, self.mention = recording, mention
        self.notes: list[str] = []
        self.kept: list[Named] = []  # what was said to stay as it is
        self.apart = False  # arm and gripper are told apart
        self._patterns: dict[frozenset[int], str] = {}  # what things of a pattern were called

    def target(self, named: Named) -> Target:
        """A recipe's target. Raises NotUnderstood for what is no thing."""
        words = named.words
        if named.pronoun:
            if self.mention is None or self.mention.kind != "target":
                why = {None: "nothing was named before", "new": "a new thing has no name yet"}
                reason = why.get(
                    self.mention.kind if self.mention else None, "what was named before is no thing"
                )
                raise NotUnderstood(f"{words!r}: {reason}; say which thing is meant")
            found: Target = self.mention.target
            return found
        if numbered := NUMBERED.fullmatch(words):
            return {"handle": int(numbered[1])}
        bare = re.sub(r" (?:object|thing|item)$", "", words)
        owners = ("robot", "gripper", "arm", "hand")
        hand = " ".join(w for w in bare.split() if not color_space.canonical(w) and w not in owners)
        fingers = hand in FINGERS or (self.apart and bare in ("gripper", "hand"))
        if self.recording is not None and (bare in ARMS or fingers):
            return self._arm(fingers)
        if words.startswith("other "):
            return self._other(words.removeprefix("other "))
        if self.recording is not None and (told := PATTERNED & set(words.split())):
            return self._patterned(words, " ".join(one for one in words.split() if one not in told))
        if bare in ROBOTS:
            return {"role": "robot"}
        if role := PHRASES.get(words) or (bare if bare in roles.NAMES else None):
            return {"role": role}
        if side := SIDE.fullmatch(
            re.sub(" behind (?:the )?(?:robot|arm|table|scene|everything)$", "", bare)
        ):
            return self._side(side["side"], side["tint"])
        if bare in ROLES:
            return {"role": ROLES[bare]}
        self._check(words)
        if named.words.endswith((" wall", " floor")) and words.split()[0] == "background":
            return self._side(words.split()[-1])
        phrase = relations.parse(words)
        head = phrase.nouns[-1] if phrase.nouns else ""
        plural = head != singular(head) and head not in ("glass", "gas") and head not in ANYTHING
        if (
            (named.several or (plural and not phrase.relations))
            and phrase.ranks
            and not phrase.relations
        ):
            raise NotUnderstood(f"{words!r}: how many of them? name each, or one in the singular")
        if named.count == 2:
            words = singular(words)
        if plural and self.recording is not None:
            words = re.sub(rf"\b{head}\b", singular(head), words, count=1)
            found = self._seen({"text": words, "all": True}, words)
            if len(self.groups(found)) < 2:
                raise NotUnderstood(f"{named.words!r}: one alone is found, {found}")
            return found
        return self._seen({"text": words, "all": True} if named.several else words, words)

    def counted(self, named: Named) -> Target:
        """The target of things of which it was said how many they are. Raises NotUnderstood for another number."""
        found = self.target(named)
        if named.count is not None and self.recording is not None:
            there = len(self.groups(every(found)))
            if there != named.count:
                raise NotUnderstood(
                    f"{named.words!r}: {named.count} are meant, and {there} are found"
                )
        return found

    def _seen(self, target: Target, words: str) -> Target:
        """The target, in another color's name if nothing of the scene is of the one that was said.

        Raises TargetError where no near color is there either, and where several things are of the one that was said.
        """
        tints = [word for word in words.split() if word in NEARLY]
        if self.recording is None or len(tints) != 1:
            return target
        try:
            self.ids(target)
        except TargetError as error:
            for other in () if self._any(words) else NEARLY[tints[0]]:
                said = " ".join(other if word == tints[0] else word for word in words.split())
                near: Target = {"text": said, "all": True} if isinstance(target, dict) else said
                with contextlib.suppress(TargetError):
                    self.ids(near)
                    self.notes.append(
                        f"{words!r} is taken to be the {said}: nothing of that kind is {tints[0]}"
                    )
                    return near
            raise error from None
        return target

    def _any(self, words: str) -> bool:
        """Whether something fits some words, be it one thing or several."""
        with contextlib.suppress(TargetError):
            return bool(self.ids({"text": words, "all": True}))
        return False

    def _check(self, words: str) -> None:
        try:
            phrase = relations.parse(words)
        except ValueError as error:
            raise NotUnderstood(str(error)) from None
        if bad := [noun for noun in _nouns(phrase) if noun in NO_THING]:
            raise NotUnderstood(f"{words!r}: {bad[0]!r} is no thing of the scene")

    def _arm(self, fingers: bool) -> Target:
        """The robot's fingers, or all of it but these: what opens and closes beside the largest part of the hand."""
        assert self.recording is not None
        scene = self.recording.scene
        robot = scene.roles.get("robot", frozenset())
        hand = [b.instance_ids & robot for b in scene.bodies if b.motion == "gripper"]
        size = {
            row["id"]: math.prod(map(float, row["size_cm"]))
            for row in self.rows
            if "size_cm" in row
        }
        hand = sorted(filter(None, hand), key=lambda group: sum(size.get(one, 0) for one in group))
        ends = frozenset[int]().union(*hand[:-1])
        if not ends and fingers:
            raise TargetError("'fingers': the masks do not show the gripper's fingers apart")
        return {"handle": sorted(ends if fingers else robot - ends)} if ends else {"role": "robot"}

    def _other(self, words: str) -> Target:
        """The one of two that was not named before, or what an instruction calls the other one. Raises NotUnderstood."""
        mention = self.mention.target if self.mention and self.mention.kind == "target" else None
        if mention is not None and self.recording is not None:
            groups = self.groups({"text": words, "all": True})
            left = [group for group in groups if not group & self.ids(mention)]
            if len(left) == 1 and len(groups) == 2:
                return {"handle": sorted(left[0])}
        said = self.recording.scene.episode.descriptions if self.recording else ()
        if mention is None and any(f"other {words}" in text.lower() for text in said):
            return words
        raise NotUnderstood(f"'other {words}': other than which one?")

    def _patterned(self, said: str, words: str) -> Target:
        """The one of these things that shows several colors. Raises TargetError for none or several, or for one that
        was called otherwise before: of what pattern a thing is was not measured."""
        shown = {row["id"] for row in self.rows if "shows" in row}
        fits = [group for group in self.groups({"text": words, "all": True}) if group & shown]
        if len(fits) != 1:
            raise TargetError(f"{words!r} with a pattern: {len(fits)} things are of several colors")
        before = self._patterns.setdefault(fits[0], said)
        if before != said:
            raise TargetError(
                f"{before!r} and {said!r}: one thing alone is seen to be of several colors"
            )
        return {"handle": sorted(fits[0])}

    def _side(self, word: str, tint: str | None = None) -> Target:
        """The floor alone, or the walls alone; all of the background where no recording tells them apart."""
        if self.recording is None and tint is None:
            self.notes.append(
                f"{word!r} is taken as all that stands around the table: no recording was looked at"
            )
            return {"role": "background"}
        if self.recording is None:
            return f"{tint} {word}"
        rows = [
            row
            for row in self.recording.inventory
            if row.get("role") == "background" and "size_cm" in row
        ]
        flat = [row["id"] for row in rows if row["size_cm"][2] <= FLAT]
        upright = [row["id"] for row in rows if row["size_cm"][2] > FLAT >= min(row["size_cm"][:2])]
        found = flat if word in FLOOR else upright
        if not found:
            raise TargetError(f"{word!r}: no such part of the background is seen")
        if tint:
            seen = {row["id"]: row["color"] for row in rows}
            other = [one for one in found if not color_space.means(tint, seen[one])]
            found = [one for one in found if one not in other or seen[one] in PALE] or found
            if set(other) & set(found):
                self.notes.append(f"{tint} {word}: not all that is taken for it is measured so")
        return {"handle": sorted(found)}

    def ids(self, target: Target) -> frozenset[int]:
        """The instance ids of a target. Raises NotUnderstood without a recording, TargetError where nothing fits."""
        if self.recording is None:
            raise NotUnderstood(
                "which things those are takes a look at the recording: leave out --no-ground"
            )
        return targets.find(self.recording.scene, targets.Target.model_validate(target))

    def groups(self, target: Target) -> list[frozenset[int]]:
        """The things that a target holds, each with the ids that move together."""
        ids, out = self.ids(target), list[frozenset[int]]()
        bodies = {
            row["id"]: frozenset([row["id"], *row.get("moves_with", ())]) for row in self.rows
        }
        for one in sorted(ids):
            group = bodies.get(one, frozenset([one])) & ids
            if group not in out:
                out.append(group)
        return out

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The recording's inventory. Raises NotUnderstood without a recording."""
        if self.recording is None:
            raise NotUnderstood(
                "which things those are takes a look at the recording: leave out --no-ground"
            )
        return self.recording.inventory

    def there(self, named: Named) -> bool:
        """Is there such a thing in the recording?"""
        told = len(self.notes)
        try:
            return bool(self.ids(self.target(named)))
        except RpaugError:
            return False
        finally:
            del self.notes[told:]

    def color(self, target: Target) -> str:
        """The color that something was recorded in. Raises NotUnderstood for several."""
        tints = {row["color"] for row in self.rows if row["id"] in self.ids(target)}
        if len(tints) != 1:
            raise NotUnderstood(f"{target} has several colors: {', '.join(sorted(tints))}")
        return str(tints.pop())

    def among(self, named: Named, there: frozenset[int]) -> frozenset[int]:
        """Which of some things are meant; "one" is any of them."""
        words = named.words.removesuffix(" one")
        tints = [one for word in words.split() if (one := color_space.canonical(word))]
        if words == named.words:
            return self.ids(every(self.target(named))) & there
        rows = [row for row in self.rows if row["id"] in there and "shows" not in row]
        return frozenset(
            row["id"] for row in rows if all(color_space.means(one, row["color"]) for one in tints)
        )

    def handled(self, target: Target) -> bool:
        """Is it what the robot moves?"""
        return self.recording is not None and self.ids(target) <= self.ids({"role": "manipulated"})

    def strangers(self) -> frozenset[int]:
        """All that plays no role: neither the task's things, nor the robot, the table and what is around it."""
        return frozenset(row["id"] for row in self.rows if "role" not in row and "size_cm" in row)

    def middle(self, named: Iterable[Named]) -> list[float]:
        """The place in the world that lies in the middle of some things. Raises TargetError."""
        ids = self.all_ids(named)
        at = [row["at_m"] for row in self.rows if row["id"] in ids and "at_m" in row]
        if not at:
            raise TargetError("look at what? no depth shows where that is")
        return [round(sum(values) / len(at), 3) for values in zip(*at, strict=True)]

    def all_ids(self, named: Iterable[Named]) -> frozenset[int]:
        """The ids of all things that go by these names."""
        return frozenset[int]().union(*(self.ids(self.target(one)) for one in named))

    def but(self, named: Iterable[Named]) -> Target:
        """All that stands about but what is named, and but the robot, the table and what is around it."""
        apart = ("robot", "table", "background")
        loose = {
            row["id"] for row in self.rows if row.get("role") not in apart and "size_cm" in row
        }
        return self.without({"handle": sorted(loose)}, self.all_ids(named))

    def without(self, target: Target, kept: Iterable[int]) -> Target:
        """A target less some ids. Raises NotUnderstood if nothing is left."""
        left = self.ids(target) - frozenset(kept)
        if not left:
            raise NotUnderstood(f"{target}: it is all part of what must stay as it is")
        return {"handle": sorted(left)}


def _nouns(phrase: relations.Phrase) -> set[str]:
    """Every noun in a phrase and in those inside it."""
    inner = [anchor for relation in phrase.relations for anchor in relation.anchors]
    return {*phrase.nouns}.union(*map(_nouns, inner))


def every(target: Target) -> Target:
    """All things that a phrase fits."""
    return {"text": target, "all": True} if isinstance(target, str) else target
