"""What a language model may answer, and what of it stands: valid edits, each resting on the person's own words.

A dataset's text is shown to the model, so it may try to ask for something. Whatever is changed must therefore quote the
wish, and what names a file or a network must stand in the wish as it is.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError

from rpaug.assets import library
from rpaug.core import registry
from rpaug.language import values
from rpaug.language.making import lacking
from rpaug.language.messages import Entry, Message, WishContext
from rpaug.pipeline import recipe
from rpaug.pipeline.gates import Gates
from rpaug.pipeline.recipe_errors import dotted

DEGREE = 0.017453292519943295
SHORT = 200  # characters of a name or an instruction that is shown to a model
MOST = 30  # edits
FILE = re.compile(r"[/\\:~]|\.\w{1,5}$")
"""What may name a file, an address or a network."""
PLACES = ("textures", "weights", "vision", "harmoniser", "inpaint")
"""Fields that name a folder, a file or a network."""
COUNTS = {
    "first": 1,
    "single": 1,
    "once": 1,
    "twice": 2,
}  # numbers in words, beside `values.NUMBERS`

VAGUE = ("few", "several", "some", "different", "various", "multiple")  # two to five


class WishEdit(Message):
    """One entry of the recipe: an edit, or several of which each copy draws one."""

    said: str = Field(min_length=1, max_length=500)
    probability: float | None = Field(ge=0, le=1)
    together: str | None = Field(None, min_length=1, max_length=100)
    options: tuple[dict[str, Any], ...] = Field(min_length=1, max_length=MOST)


class WishSettings(Message):
    """What holds for the whole recipe; None leaves it as it is."""

    said: str = Field(min_length=1, max_length=500)
    copies: int | None = Field(ge=1, le=10_000)
    seed: int | None = Field(ge=0, lt=2**53)
    limit: int | None = Field(ge=1)
    keep_originals: bool | None
    paraphrases: int | None = Field(ge=1, le=20)
    gates: Gates | None

    def entries(self) -> dict[str, Any]:
        """The recipe's keys."""
        named = {"copies": self.copies, "seed": self.seed, "keep_originals": self.keep_originals}
        out: dict[str, Any] = {key: value for key, value in named.items() if value is not None}
        out |= {"select": {"limit": self.limit}} if self.limit is not None else {}
        out |= {"instructions": {"paraphrases": self.paraphrases}} if self.paraphrases else {}
        return out | ({"gates": self.gates.model_dump(exclude_defaults=True)} if self.gates else {})


class WishAnswer(Message):
    """What a model makes of a wish: edits to add, earlier ones to drop, settings, or why it refuses."""

    refuse: str = Field(max_length=500)
    drop: tuple[int, ...] = Field(max_length=100)
    edits: tuple[WishEdit, ...] = Field(max_length=MOST)
    settings: WishSettings | None
    notes: tuple[str, ...] = Field(max_length=MOST)


class WishStep(Message):
    """One change that a wish asks for, in the wish's own words."""

    said: str = Field(min_length=1, max_length=500)
    op: str


class WishPlan(Message):
    """What the manager makes of a wish, where each step is asked alone."""

    steps: tuple[WishStep, ...] = Field(max_length=MOST)
    drop: tuple[int, ...] = Field(max_length=100)
    settings: WishSettings | None
    refuse: str = Field(max_length=500)


def _span(value: Any) -> Any:
    """One number is low and high of a range."""
    return (value, value) if isinstance(value, int | float) else value


Metre = Annotated[float, Field(ge=-10, le=10)]
Degree = Annotated[float, Field(ge=-180, le=180)]
Metres = Annotated[tuple[Metre, Metre], BeforeValidator(_span)]
Degrees = Annotated[tuple[Degree, Degree], BeforeValidator(_span)]


class Viewpoint(Message):
    """A camera's motion as seen through it: ranges in metres and degrees, or limits of a random one.

    `look_at` is a place of the world that it then looks at.
    """

    cameras: tuple[str, ...] = Field(min_length=1, max_length=20)
    right: Metres
    up: Metres
    forward: Metres
    turn_up: Degrees
    turn_right: Degrees
    turn_clockwise: Degrees
    look_at: tuple[float, float, float] | None
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
        down = (-self.up[1], -self.up[0])
        by = _motion((self.right, down, self.forward), 1.0)
        turned = _motion((self.turn_up, self.turn_right, self.turn_clockwise), DEGREE)
        out |= {"by": by} | ({"turned": turned} if turned != [0, 0, 0] else {})
        return out | ({"toward": list(self.look_at)} if self.look_at is not None else {})


def _motion(spans: Sequence[tuple[float, float]], unit: float) -> list[Any]:
    """A motion along or about three axes: exact, or its low and high."""
    low, high = ([round(span[end] * unit, 4) or 0 for span in spans] for end in (0, 1))
    return low if low == high else [low, high]


def understood(value: Any, stated: str, earlier: int) -> WishAnswer:
    """The answer, if all that it changes quotes the wish. Raises ValueError."""
    found: WishAnswer = valid(WishAnswer, value)
    if found.refuse and (found.edits or found.drop or found.settings):
        raise ValueError("either refuse, or give edits, drop and settings")
    _within(found.drop, earlier)
    quoted = [edit.said for edit in found.edits]
    for said in (*quoted, *([found.settings.said] if found.settings else [])):
        if not _normal(said) or _normal(said) not in _normal(stated):
            raise ValueError(f"said {said!r}: these are not words of the wish")
    _settled(found.settings)
    return found


def planned(value: Any, stated: str, earlier: int) -> WishPlan:
    """The manager's answer, if all of it rests on the wish. Raises ValueError."""
    found: WishPlan = valid(WishPlan, value)
    for step in found.steps:
        if not _normal(step.said) or _normal(step.said) not in _normal(stated):
            raise ValueError(f"said {step.said!r}: these are not words of the wish")
        if step.op not in registry.operator_names():
            raise ValueError(f"op {step.op!r}: there are: {', '.join(registry.operator_names())}")
    _within(found.drop, earlier)
    if found.refuse and found.steps:
        raise ValueError("either refuse, or give steps")
    if found.settings and _normal(found.settings.said) not in _normal(stated):
        raise ValueError(f"said {found.settings.said!r}: these are not words of the wish")
    _settled(found.settings)
    return found


def _settled(settings: WishSettings | None) -> None:
    """See that the person said every setting: numbers by their value, the others by name. Raises ValueError."""
    if settings is None:
        return
    said = settings.said.lower()
    numbers = {values.numeral(one) for one in re.findall(rf"(?<![\w.]){values.NUMBER}", said)}
    numbers |= {count for word, count in COUNTS.items() if word in said}
    numbers |= set(range(2, 6)) if any(word in said for word in VAGUE) else set()
    numbers |= {one / 100 for one in numbers}  # percent
    gates = settings.gates.model_dump(exclude_unset=True) if settings.gates else {}
    given = {
        name: getattr(settings, name) for name in ("copies", "seed", "limit", "paraphrases")
    } | gates
    for name, value in given.items():
        if name in gates and (value is None or isinstance(value, bool)):
            unsaid = not any(word in said for word in ("gate", "check", *name.split("_")))
        else:
            unsaid = value is not None and value not in numbers
        if unsaid:
            raise ValueError(f"{name} {value}: the wish says no such thing")
    if settings.keep_originals is not None and "original" not in said:
        raise ValueError("keep_originals: the wish says nothing of originals")


def _within(drop: Sequence[int], earlier: int) -> None:
    if any(not 0 <= number < earlier for number in drop):
        raise ValueError(f"drop {list(drop)}: there are {earlier} earlier edits, counted from 0")


def entry(edit: WishEdit, stated: str, setting: WishContext) -> Entry:
    """The recipe's entry for an edit of the answer. Raises ValueError, RpaugError with what is amiss."""
    options = [_option(one, stated, setting) for one in edit.options]
    if len(options) == 1:
        made = options[0]
    else:
        weights = [{"weight": w} if (w := one.get("weight")) else {} for one in edit.options]
        made = {"one_of": [one | weight for one, weight in zip(options, weights, strict=True)]}
    chance = edit.probability
    drawn = {"probability": chance} if chance is not None and chance < 1 else {}
    return made | drawn | ({"together": edit.together} if edit.together else {})


def _option(given: Mapping[str, Any], stated: str, setting: WishContext) -> Entry:
    op = given.get("op")
    if op not in registry.operator_names():
        raise ValueError(f"op {op!r}: there are: {', '.join(registry.operator_names())}")
    out = ("op", "weight")
    fields = {name: value for name, value in given.items() if name not in out and value is not None}
    if op == "camera_pose":
        seen: Viewpoint = valid(Viewpoint, fields | _absent(Viewpoint, fields))
        for name in seen.cameras:
            if name not in (*setting.cameras, "static"):
                there = ", ".join(map(short, setting.cameras))
                raise ValueError(f"camera {name!r}: there are: {there}, or static for all")
        return seen.edit()
    for name, value in fields.items():
        for text in _texts(value):
            if (name in PLACES or FILE.search(text)) and text not in stated:
                raise ValueError(f"{op}: {text!r} was not said")
    recipe.option(op, fields)
    if op == "insert" and "asset" not in fields:
        edit = {"op": op, **fields}
        if not setting.generates or not lacking(edit):
            library.closest(fields.get("category"), fields.get("color"))
    return {"op": op, **fields}


def _absent(kind: type[Message], fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields that may be None, and are where a model leaves them out."""
    return {
        name: None
        for name in kind.model_fields
        if name not in fields and name in ("most_metres", "most_degrees", "look_at")
    }


def _texts(value: Any) -> Iterator[str]:
    """All texts within a value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from _texts(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _texts(inner)


def valid(kind: Any, value: Any) -> Any:
    """A model's answer as a message of that kind. Raises ValueError with every fault."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        faults = [f"{dotted(fault['loc'])}: {fault['msg']}" for fault in error.errors()]
        raise ValueError("; ".join(faults[:5])) from None


def short(text: str) -> str:
    """A name or an instruction, of bounded length, on one line."""
    return " ".join(text.split())[:SHORT]


def _normal(text: str) -> str:
    return " ".join(re.findall(r"\w+", text.lower()))
