"""What a language model may answer, and what of it stands: valid edits that rest on the person's own words."""

import json
import re
from typing import Any

from pydantic import Field, ValidationError

from rpaug.assets import library
from rpaug.core import registry
from rpaug.language import manager
from rpaug.language.making import lacking
from rpaug.language.messages import Entry, Message
from rpaug.pipeline import recipe
from rpaug.pipeline.recipe_errors import dotted
from rpaug.scene.targets import relations, roles

DEGREE = 0.017453292519943295
SHORT = 200  # characters of a name or an instruction that is shown to a model


class WishStep(Message):
    """One change that a wish asks for, in the wish's own words."""

    said: str = Field(min_length=1, max_length=500)
    op: str


class WishPlan(Message):
    """What the manager makes of a wish."""

    steps: tuple[WishStep, ...] = Field(max_length=30)
    drop: tuple[int, ...] = Field(max_length=100)
    copies: int | None = Field(ge=1, le=10_000)
    seed: int | None = Field(ge=0, lt=2**53)
    limit: int | None = Field(ge=1)
    keep_originals: bool | None
    refuse: str = Field(max_length=500)


class Viewpoint(Message):
    """A camera's motion as seen through it: metres and degrees, or limits of a random one."""

    cameras: tuple[str, ...] = Field(min_length=1, max_length=20)
    right: float = Field(ge=-10, le=10)
    up: float = Field(ge=-10, le=10)
    forward: float = Field(ge=-10, le=10)
    turn_up: float = Field(ge=-180, le=180)
    turn_right: float = Field(ge=-180, le=180)
    turn_clockwise: float = Field(ge=-180, le=180)
    random: bool
    most_metres: float | None = Field(ge=0, le=10)
    most_degrees: float | None = Field(ge=0, le=180)

    def edit(self) -> Entry:
        """The edit of `camera_pose`. The camera's axes are right, down and ahead."""
        names = self.cameras[0] if len(self.cameras) == 1 else list(self.cameras)
        out: Entry = {"op": "camera_pose", "camera": names}
        if self.random:
            limits = {
                "shift": self.most_metres,
                "turn": self.most_degrees and self.most_degrees * DEGREE,
            }
            return out | {
                name: round(value, 4) for name, value in limits.items() if value is not None
            }
        out["by"] = [round(value, 4) or 0 for value in (self.right, -self.up, self.forward)]
        turned = [
            round(v * DEGREE, 4) or 0 for v in (self.turn_up, self.turn_right, self.turn_clockwise)
        ]
        return out | ({"turned": turned} if any(turned) else {})


def plan(value: Any, stated: str, earlier: int) -> WishPlan:
    """The manager's answer, if all of it rests on the wish. Raises ValueError."""
    found = valid(WishPlan, value)
    wish = manager.normal(stated)
    for step in found.steps:
        if manager.normal(step.said) not in wish or not manager.normal(step.said):
            raise ValueError(f"said {step.said!r}: these are not words of the wish")
        if step.op not in registry.operator_names():
            raise ValueError(f"op {step.op!r}: there are: {', '.join(registry.operator_names())}")
    if any(not 0 <= number < earlier for number in found.drop):
        raise ValueError(
            f"drop {list(found.drop)}: there are {earlier} earlier edits, counted from 0"
        )
    if found.refuse and found.steps:
        raise ValueError("either refuse, or give steps")
    return found


def edits(value: Any, op: str, known: frozenset[str], generates: bool = False) -> list[Entry]:
    """The operator's edits, if each is valid and names only what was said. Raises ValueError, RpaugError."""
    found = value.get("edits") if isinstance(value, dict) else None
    if (
        not isinstance(found, list)
        or not 0 < len(found) <= 30
        or not all(isinstance(e, dict) for e in found)
    ):
        raise ValueError('expected {"edits": [...]} with 1 to 30 edits')
    for edit in found:
        fields = {name: field for name, field in edit.items() if name != "op"}
        if edit.get("op") != op:
            raise ValueError(f"op {edit.get('op')!r}: expected {op!r}")
        recipe.option(op, fields)
        needs = registry.operator(op).needs
        for name in (*needs.targets, *needs.anchors):
            for word in _words(fields.get(name)):
                if word not in known:
                    raise ValueError(f"{name}: {word!r} was not said")
        if op == "insert" and not fields.get("asset"):
            if not generates:
                library.find(fields.get("category"), fields.get("color"))
            elif lacking(edit) and (new := _words(fields.get("category")) - known):
                raise ValueError(f"category: {', '.join(sorted(new))!r} was not said")
    return found


def viewpoint(value: Any, cameras: tuple[str, ...]) -> Viewpoint:
    found = valid(Viewpoint, value)
    for name in found.cameras:
        if name not in cameras and found.cameras != ("static",):
            raise ValueError(
                f"camera {name!r}: there are: {', '.join(map(short, cameras))}, or static for all"
            )
    return found


def valid(kind: Any, value: Any) -> Any:
    """A model's answer as a message of that kind. Raises ValueError with every fault."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        faults = [f"{dotted(fault['loc'])}: {fault['msg']}" for fault in error.errors()]
        raise ValueError("; ".join(faults[:5])) from None


def known_words(stated: str, earlier: tuple[Entry, ...]) -> frozenset[str]:
    """All words that were said, now or in earlier targets."""
    text = f"{stated} {json.dumps(earlier)}".lower()
    return frozenset(_stem(word) for word in re.findall(r"[a-z0-9_]+", text))


def _words(value: Any) -> set[str]:
    """The words in targets that name a thing."""
    if isinstance(value, list | tuple):
        return set().union(*map(_words, value)) if value else set()
    text = value.get("text") if isinstance(value, dict) else value
    if isinstance(value, dict) and value.get("handle") is not None:
        numbers = value["handle"] if isinstance(value["handle"], list) else [value["handle"]]
        return {str(number) for number in numbers}
    if not isinstance(text, str):
        return set()
    grammar = {word for spelling, _ in relations.SPELLED for word in spelling}
    skipped = grammar | relations.FILLERS | relations.ANYTHING | set(roles.NAMES)
    return {_stem(word) for word in re.findall(r"[a-z0-9_]+", text.lower())} - {
        _stem(w) for w in skipped
    }


def _stem(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def short(text: str) -> str:
    return " ".join(text.split())[:SHORT]
