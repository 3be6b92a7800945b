"""Which instances an edit is meant for: by handle, by role, or by a few words."""

import re
from collections.abc import Iterable, Sequence
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, StrictInt, model_validator

from rpaug.errors import TargetError
from rpaug.scene import colours, roles
from rpaug.scene.survey import InstanceSummary, survey
from rpaug.types import Scene

ANYTHING = frozenset({"object", "thing", "part", "item", "one"})
FILLERS = frozenset({"the", "a", "an", "all", "every", "some", "of", "that", "is", "which"})


class Target(BaseModel):
    """Exactly one of `handle`, `role` and `text`.

    `text` is a colour word, a role word, or both ("the red receiver", "the blue thing"). Any other noun is
    taken only beside a colour word, and then the colour decides alone: nouns need a detector. Where several
    things fit, `all` takes them; a body of several handles that move as one is one thing.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    handle: StrictInt | list[StrictInt] | None = None
    role: str | None = None
    text: str | None = Field(default=None, min_length=1)
    all: bool = False

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if sum(value is not None for value in (self.handle, self.role, self.text)) != 1:
            raise ValueError("give exactly one of handle, role, text")
        if self.role is not None and self.role not in roles.NAMES:
            raise ValueError(
                f"no role is called {self.role!r}; there are: {', '.join(roles.NAMES)}"
            )
        if self.handle == []:
            raise ValueError("give at least one handle")
        if self.text is not None:
            _parse(self.text)
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
    if target.handle is not None:
        wanted = frozenset([target.handle] if isinstance(target.handle, int) else target.handle)
        if wanted - scene.handles:
            raise TargetError(
                f"{target}: no such instance {_numbers(wanted - scene.handles)}; {_there_is(_rows(scene))}"
            )
        return wanted
    if target.role is not None:
        if target.role not in scene.roles:
            raise TargetError(f"{target}: {_why(scene, target.role)}; {_there_is(_rows(scene))}")
        return scene.roles[target.role]
    assert target.text is not None
    return _by_words(scene, target)


def _by_words(scene: Scene, target: Target) -> frozenset[int]:
    colour, role = _parse(target.text or "")
    rows = _rows(scene)
    fits = [row for row in rows if role is None or row.role == role]
    if role is not None and not fits:
        raise TargetError(f"{target}: {_why(scene, role)}; {_there_is(rows)}")
    if colour is not None:
        exact = [row for row in fits if row.colour_name == colour]
        fits = exact or [row for row in fits if colours.means(colour, row.colour_name)]
    if not fits:
        raise TargetError(f"{target}: nothing fits; {_there_is(rows)}")
    if role is not None:
        return frozenset(row.handle for row in fits)
    things = {row.body: row for row in fits}
    if len(things) > 1 and not target.all:
        raise TargetError(
            f"{target}: {len(things)} things fit: {_list(things.values())}; "
            "name one, or set all: true to take them all"
        )
    return frozenset().union(*things)


def _parse(text: str) -> tuple[str | None, str | None]:
    """Colour name and role in a text. Raises ValueError if neither is in it."""
    words = [word for word in re.findall(r"[a-z_]+", text.lower()) if word not in FILLERS]
    tints = [name for word in words if (name := colours.canonical(word))]
    tasks = [word for word in words if word in roles.NAMES]
    if len(set(tints)) > 1 or len(set(tasks)) > 1:
        raise ValueError(
            f"{text!r} names several colours or several roles; give one of each at most"
        )
    if not tints and not tasks and not (len(words) == 1 and words[0] in ANYTHING):
        raise ValueError(
            f"{text!r} has no colour and no role in it; nouns need a detector. "
            f"Colours: {', '.join(sorted(colours.NAMES))}; roles: {', '.join(roles.NAMES)}"
        )
    return (tints[0] if tints else None), (tasks[0] if tasks else None)


def _rows(scene: Scene) -> tuple[InstanceSummary, ...]:
    return survey(scene.episode, scene.bodies, scene.roles)


def _why(scene: Scene, role: str) -> str:
    """Why a role is not known."""
    if not scene.bodies:
        return "the episode has no depth or no instance masks, so no role is known"
    if scene.episode.length < 2:
        return f"one frame alone does not show what is the {role}"
    if role in ("manipulated", "receiver") and "manipulated" not in scene.roles:
        return f"nothing was seen to be moved by the robot, so there is no {role}"
    if role == "receiver":
        return "what was moved touches nothing at the end, so there is no receiver"
    return f"nothing was seen to be the {role}"


def _numbers(handles: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(handles)))


def _list(rows: Iterable[InstanceSummary]) -> str:
    return "; ".join(map(str, rows))


def _there_is(rows: Sequence[InstanceSummary]) -> str:
    return f"there is: {_list(rows)}" if rows else "there is no instance at all"
