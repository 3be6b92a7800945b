"""Which instances a noun of the instruction stands for: what it handles, where that goes, parts and wholes of both.

Where the recording does not settle it, a TargetError says why: two things moved and one is named, a handle that the
masks do not show apart, a drawer that is the middle one in words and the top one in place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from rpaug.core.errors import TargetError
from rpaug.core.types import Belief, Scene
from rpaug.scene.sampled_frames import SampledFrames
from rpaug.scene.targets import parts, places, roles
from rpaug.scene.targets.nouns import Meaning
from rpaug.scene.targets.parts import Furniture
from rpaug.scene.targets.relations import GRIPS, PARTS, Phrase, singular

Groups = list[frozenset[int]]
TOLD_BY = {"manipulated": "what the robot moves", "receiver": "where that goes"}


@dataclass(frozen=True)
class Resolved:
    """Things that a noun may mean: the `likely`, or `all` that go by it, where more than that is asked for.

    `settled`: the phrase's place words have been followed already.
    """

    likely: Groups
    all: Groups
    settled: bool = False


@dataclass(frozen=True)
class Resolver:
    """Finds what the instruction's nouns stand for in one scene. `sampled` may hold no camera."""

    scene: Scene
    sampled: SampledFrames

    def __call__(self, meaning: Meaning, phrase: Phrase) -> Resolved:
        """What a noun with an instruction's scope means in a phrase. Raises TargetError without the target's name."""
        match meaning.scope:
            case "moved":
                return self._moved(meaning, phrase)
            case "goal":
                return self._goal(meaning, phrase)
            case "part":
                return self._part(meaning, phrase)
            case "whole":
                found = self._whole(meaning)
            case "grip":
                found = self._grip(meaning)
            case "source":
                found = self._source(meaning)
            case _:
                raise TargetError(
                    f"by the instruction the {meaning.stated} is neither what moves nor where that goes, "
                    "and no role or shape tells which it is"
                )
        return _alone(found, meaning, phrase)

    @cached_property
    def _furniture(self) -> Furniture | None:
        return parts.furniture(self.scene, self.sampled) if self.sampled.cameras else None

    def _role(self, role: str, meaning: Meaning) -> frozenset[int]:
        """What plays the role by which the instruction tells a noun. Raises TargetError in terms of the noun."""
        known = self.scene.roles.get(role, frozenset()) & self.scene.instance_ids
        if known:
            return known
        doubted = self.scene.beliefs.get(role)
        cause = f"that is doubted: {_doubt(doubted)}" if doubted else _unseen(self.scene, role)
        raise TargetError(
            f"the instruction tells the {meaning.stated} by {TOLD_BY[role]}, and {cause}"
        )

    def _moved(self, meaning: Meaning, phrase: Phrase) -> Resolved:
        """What the robot moved. Of several things a part's name means what moves on furniture, another what is free."""
        self._role("manipulated", meaning)
        own, piece = parts.moved_things(self.scene, self.sampled), self._furniture
        noun = singular(meaning.stated)
        if meaning.tool is not None and self.sampled.cameras:
            held = parts.gripped(self.scene, self.sampled)
            own = [group for group in own if bool(group & held) == meaning.tool]
        if len(own) > 1 or meaning.mixed:
            on = piece.moved if piece else frozenset()
            own = [group for group in own if bool(group & on) == (noun in PARTS | GRIPS)]
        several = len(own) > 1 or (meaning.others and meaning.tool is None)
        if not own or (noun == meaning.stated and several):
            raise TargetError(
                f"the instruction handles {_and([meaning.stated, *meaning.others])}, and the robot moved "
                f"{_things(len(own))} that may be it: say its instance id (handle)"
            )
        row = piece.row if piece and any(piece.moved & group for group in own) else ()
        if len(row) < 2:
            return _alone(frozenset().union(*own), meaning, phrase)
        return self._in_row(meaning, phrase, row, own)

    def _in_row(
        self,
        meaning: Meaning,
        phrase: Phrase,
        row: Sequence[places.LocatedInstance],
        own: Groups,
    ) -> Resolved:
        """The moved part, or the one of its row that place words tell; checked against the instruction's own words."""
        noun = singular(meaning.stated)
        every = [part.instance_ids for part in row]
        if (meaning.ranks or phrase.ranks) and not places.even(row):
            raise TargetError(
                f"the {noun}s that are known do not stand evenly: one may be missing between them"
            )
        if meaning.ranks:
            said = _told(noun, meaning.ranks, 0, row)
            if own and not any(part.instance_ids & own[0] for part in said):
                words = f"the {' '.join(meaning.ranks)} {noun}"
                raise TargetError(
                    f"the instruction names {words}, which is {_numbers(said)} by its place (left and right "
                    f"are the robot's), and the robot moved {', '.join(map(str, sorted(own[0])))}"
                )
        if phrase.ranks:
            found = _told(noun, phrase.ranks, phrase.ordinal, row)
            return Resolved([part.instance_ids for part in found], every, settled=True)
        return Resolved(every if phrase.relations else own, every)

    def _goal(self, meaning: Meaning, phrase: Phrase) -> Resolved:
        """Where the moved thing goes: the receiver, unless that is only the table."""
        role = self._role("receiver", meaning)
        if role <= self.scene.roles.get("table", frozenset()):
            raise TargetError(
                f"the instruction brings something to the {meaning.stated}, and at the end it touches only the table"
            )
        if singular(meaning.stated) in PARTS and (len(role) > 1 or meaning.ranks):
            return self._part(meaning, phrase)
        return _alone(role, meaning, phrase)

    def _part(self, meaning: Meaning, phrase: Phrase) -> Resolved:
        """A part of what receives something: known only if another part of its row is moved."""
        self._role("receiver", meaning)
        row = self._furniture.row if self._furniture else ()
        ranks = phrase.ranks or meaning.ranks
        if len(row) < 2:
            raise TargetError(
                f"the masks and the motion tell no {meaning.stated} from the rest of the receiver"
            )
        if not ranks:
            return Resolved(every := [part.instance_ids for part in row], every)
        if not places.even(row):
            raise TargetError(f"one {meaning.stated} may be missing between those that are known")
        found = _told(meaning.stated, ranks, phrase.ordinal, row)
        return Resolved([part.instance_ids for part in found], [p.instance_ids for p in row], True)

    def _whole(self, meaning: Meaning) -> frozenset[int]:
        """The piece of furniture, with what the robot moves on it."""
        self._role("manipulated" if meaning.role == "manipulated" else "receiver", meaning)
        piece = self._furniture
        if piece is None or not piece.moved:
            raise TargetError(
                f"nothing shows what belongs to the {meaning.stated}: "
                "what the robot moved does not hang on anything that stays"
            )
        return piece.instance_ids

    def _grip(self, meaning: Meaning) -> frozenset[int]:
        """What the gripper holds of the moved thing."""
        self._role("manipulated", meaning)
        held = parts.gripped(self.scene, self.sampled) if self.sampled.cameras else frozenset()
        for thing in parts.moved_things(self.scene, self.sampled):
            if held & thing and not thing <= held:
                return held & thing
        raise TargetError(
            f"the masks do not show the {meaning.stated} apart from what it is on: a `part` tells it by a box"
        )

    def _source(self, meaning: Meaning) -> frozenset[int]:
        """What the moved thing stood on at first."""
        self._role("manipulated", meaning)
        found = parts.stood_on(self.scene, self.sampled) if self.sampled.cameras else frozenset()
        bodies = [body for body in self.scene.bodies if body.instance_ids & found]
        if len(bodies) != 1:
            raise TargetError(
                f"the instruction takes something from the {meaning.stated}, and at first that touches "
                f"{_things(len(bodies))} beside robot and table"
            )
        return bodies[0].instance_ids


def _alone(group: frozenset[int], meaning: Meaning, phrase: Phrase) -> Resolved:
    """A thing of which no second is known. The instruction's own place words fit it, others settle nothing."""
    return Resolved(
        [group], [group], settled=bool(phrase.ranks) and set(phrase.ranks) == set(meaning.ranks)
    )


def _told(
    noun: str, ranks: Sequence[str], ordinal: int, row: Sequence[places.LocatedInstance]
) -> list[places.LocatedInstance]:
    try:
        return places.placed(ranks, ordinal, row)
    except ValueError as error:
        raise TargetError(f"{_things(len(row))} may be called {noun}, and {error}") from error


def _and(nouns: Sequence[str]) -> str:
    return " and ".join(f"the {noun}" for noun in nouns)


def _things(count: int) -> str:
    return {0: "nothing", 1: "one thing"}.get(count, f"{count} things")


def _numbers(found: Sequence[places.LocatedInstance]) -> str:
    return ", ".join(str(h) for part in found for h in sorted(part.instance_ids)) or "nothing"


def why(scene: Scene, role: str) -> str:
    """Why a role is not known."""
    if doubted := scene.beliefs.get(role):
        return f"the {role} is doubted: {_doubt(doubted)}"
    cause = _unseen(scene, role)
    absent = role in ("manipulated", "receiver") and bool(scene.bodies) and scene.episode.length > 1
    return f"{cause}, so there is no {role}" if absent else cause


def _doubt(belief: Belief) -> str:
    return f"{'; '.join(belief.reasons)}: confidence {belief.confidence:.2f}, below {roles.BOUND}"


def _unseen(scene: Scene, role: str) -> str:
    """What of the recording shows nothing that plays a role."""
    if not scene.bodies:
        return "the episode has no depth or no instance masks, so no role is known"
    if scene.episode.length < 2:
        return f"one frame alone does not show what is the {role}"
    if role in ("manipulated", "receiver") and "manipulated" not in scene.roles:
        views = scene.episode.views.values()
        unknown = next((v.proxy.unknown for v in views if v.proxy and v.proxy.unknown), None)
        if unknown is None and getattr(scene.back, "hand", None) is not None:
            return "a video's hands and what they carry are one instance, and nothing tells what that is"
        return unknown or "nothing was seen to be moved by the robot"
    if role == "receiver":
        return "what was moved touches nothing at the end"
    return f"nothing was seen to be the {role}"
