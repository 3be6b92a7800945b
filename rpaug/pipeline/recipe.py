"""The recipe: what to change, how often, from which seed. YAML in, validated operators out."""

import fnmatch
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, WithJsonSchema

from rpaug.core import registry
from rpaug.core.errors import BadRecipe, RpaugError
from rpaug.core.files import read_bytes
from rpaug.core.interfaces import Operator
from rpaug.core.types import Effect
from rpaug.core.validation import kind_of
from rpaug.instruct.wording import Wording, wording
from rpaug.pipeline.gates import UNASKED, Gates
from rpaug.pipeline.recipe_errors import Faults
from rpaug.pipeline.recipe_yaml import Path_, override, parse
from rpaug.providers import models_settings
from rpaug.providers.models_settings import Models
from rpaug.scene.targets import settled
from rpaug.scene.video.settings import VideoSettings

MAX_BYTES = 2**20
OnMissing = Literal["skip_edit", "skip_copy", "fail"]
"""Where an episode has nothing for an edit: leave the edit out, leave its copy out, or end the run."""


PATTERNS = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}


def _listed(value: Any) -> Any:
    """One pattern as a list of one."""
    return [value] if isinstance(value, str) else value


class Select(BaseModel):
    """Which episodes to take: `episodes` is a shell pattern on keys or several, `limit` the first so many of them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    episodes: Annotated[list[str], BeforeValidator(_listed), WithJsonSchema(PATTERNS)] = ["*"]
    limit: Annotated[int, Field(ge=1)] | None = None

    def __call__(self, keys: Sequence[str]) -> list[str]:
        """The selected keys, in order."""
        taken = [k for k in keys if any(fnmatch.fnmatchcase(k, p) for p in self.episodes)]
        return taken[: self.limit]


class Accuracy(BaseModel):
    """How good rendered regions shall be: at least `psnr` dB, and a median depth error of at most `depth_mm`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    psnr: Annotated[float, Field(gt=0, le=100)] | None = None
    depth_mm: Annotated[float, Field(gt=0)] | None = None


class Instructions(BaseModel):
    """Who words instructions after edits: `rules`, or a language model first and rules where its words do not hold.

    With `paraphrases` each text of a copy is one of so many that a model says instead of it, or itself.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    by: Literal["rules", "model"] = "rules"
    paraphrases: Annotated[int, Field(ge=0, le=20, strict=True)] = 0


def _unless_off(given: Any) -> Any:
    """`off` has no limits; that there is no self-check either is read off the source (`Recipe.self_check`)."""
    return None if given is False else given


class _Top(BaseModel):
    """The keys of a recipe file; each entry of `edits` is validated by its own operator."""

    model_config = ConfigDict(extra="forbid", title="rpaug recipe")

    version: Annotated[int, Field(ge=1, le=1, strict=True)]
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 0
    copies: Annotated[int, Field(ge=1, le=10_000, strict=True)] = 1
    keep_originals: bool = False
    select: Select = Select()
    accuracy: Accuracy | None = None
    arms: list[Path] = []
    models: Models = Models()
    video: VideoSettings = VideoSettings()
    refine: Annotated[int, Field(ge=0, le=10_000, strict=True)] = 0
    on_missing: OnMissing = "skip_edit"
    embeddings: Annotated[str, Field(min_length=1)] = "refuse"
    instructions: Instructions = Instructions()
    roles: dict[settled.Role, settled.SettledRole] = {}
    edits: list[Any] = []
    gates: Annotated[Gates | None, BeforeValidator(_unless_off)] = None


class _Chance(BaseModel):
    """What every entry of `edits` may carry beside its operator's own fields."""

    model_config = ConfigDict(extra="forbid")

    probability: Annotated[float, Field(ge=0, le=1)] = 1.0
    together: Annotated[str, Field(min_length=1, max_length=100)] | None = None


CHANCE = tuple(_Chance.model_fields)


class _Weight(BaseModel):
    """What every alternative of a `one_of` may carry."""

    model_config = ConfigDict(extra="forbid")

    weight: Annotated[float, Field(gt=0, le=1e6)] = 1.0


@dataclass(frozen=True)
class Option:
    """One operator with its fields as the recipe gave them, and its weight among its alternatives."""

    name: str
    fields: dict[str, Any]
    operator: Operator
    weight: float = 1.0


def _number(word: str) -> int:
    """A number that tells a random stream by a word."""
    return int.from_bytes(hashlib.blake2b(word.encode(), digest_size=8).digest(), "little")


@dataclass(frozen=True)
class Step:
    """One entry of `edits`: taken with `probability`, as one of `options`.

    Steps that say the same word in `together` share one draw of both: as likely, they are in the same copies, and of as
    many options, as likely, they take the same one.
    """

    options: tuple[Option, ...]
    probability: float = 1.0
    together: str | None = None

    @property
    def stream(self) -> int | None:
        """The number of the random stream that steps of one word share; None for a step alone."""
        if self.together is None:
            return None
        return _number(self.together)

    def draw(self, chance: float, rng: np.random.Generator) -> Option | None:
        """The option of this draw, or None if the step is skipped: `chance` is drawn from U[0, 1)."""
        if chance >= self.probability:
            return None
        weights = np.array([option.weight for option in self.options])
        return self.options[int(rng.choice(len(self.options), p=weights / weights.sum()))]

    def describe(self) -> str:
        """In words that are the same for equal steps alone."""
        return json.dumps(
            [
                self.probability,
                self.together,
                [[one.name, one.fields, one.weight] for one in self.options],
            ]
        )


@dataclass(frozen=True)
class Recipe:
    """A validated recipe. `source` is the plain data it was made from, as the report stores it."""

    seed: int
    copies: int
    keep_originals: bool
    select: Select
    steps: tuple[Step, ...]
    source: dict[str, Any]
    gates: Gates | None = None
    accuracy: Accuracy | None = None
    arms: tuple[Path, ...] = ()  # URDF or MJCF files
    models: Models = field(default_factory=Models)
    video: VideoSettings = field(default_factory=VideoSettings)  # for videos of one moving camera
    refine: int = 0  # steps of the joint fine-tune, where Gaussians show all
    on_missing: OnMissing = "skip_edit"
    embeddings: str = "refuse"  # vectors of changed words: "refuse", "drop", or a sentence model
    roles: Mapping[str, settled.SettledRole] = field(default_factory=dict)  # that a person settled
    instructions: Instructions = field(default_factory=Instructions)

    @cached_property
    def wording(self) -> Wording | None:
        """The language model that words instructions, None without one. Raises LanguageError where none is named."""
        return wording(self.instructions.by == "model", self.instructions.paraphrases)

    @property
    def self_check(self) -> bool:
        """Whether copies are held against the recording: by default, and not where the recipe says `gates: off`."""
        gates = self.source.get("gates")
        return self.gates.self_check if self.gates else gates is not False

    @classmethod
    def from_yaml(cls, path: Path | str) -> "Recipe":
        """The recipe in a YAML file. Raises BadInput, and BadRecipe with file, line and key."""
        return load(Path(path))

    @classmethod
    def from_dict(cls, tree: Mapping[str, Any]) -> "Recipe":
        """The recipe of plain data, as YAML has it. Raises BadRecipe."""
        return build(dict(tree))

    def settled(self, root: Path) -> "Recipe":
        """The recipe with the roles that a dataset's `roles.yaml` settles; its own are preferred. Raises BadInput."""
        given = {
            role: one.model_dump(exclude_defaults=True) for role, one in settled.read(root).items()
        }
        if not given:
            return self
        return build({**self.source, "roles": {**given, **self.source.get("roles", {})}})

    def with_models(self, options: Sequence[str] = ()) -> "Recipe":
        """The recipe with the models of a command's `--models` and the user's own file. Raises RpaugError."""
        given = models_settings.given(options, self.source.get("models", {}))
        if given == self.source.get("models", {}):
            return self
        return build({**self.source, "models": given})

    def generator(self, key: str, copy: int, step: int, attempt: int = 0) -> np.random.Generator:
        """The random stream of one step for one copy of one episode: the same in any order, on any worker.

        A copy that failed its gates is drawn again with the next `attempt`. `key` is relative to the dataset's root:
        two datasets with the same keys draw alike under one seed.
        """
        name = _number(key)
        again = [attempt] if attempt else []
        return np.random.default_rng([self.seed, name, copy, step, *again])


def load(path: Path, overrides: Sequence[str] = ()) -> Recipe:
    """The recipe in a YAML file, with `a.b=c` overrides applied. Raises BadRecipe with file, line and key."""
    data = read_bytes(path)
    if len(data) > MAX_BYTES:
        raise BadRecipe(f"{path}: found {len(data)} bytes; expected at most {MAX_BYTES}")
    tree, lines = parse(data, str(path))
    for given in overrides:
        override(tree, given)
    return build(tree, name=str(path), lines=lines)


def build(tree: Any, *, name: str = "recipe", lines: dict[Path_, int] | None = None) -> Recipe:
    """The recipe of plain data. Raises BadRecipe naming every fault by line (if known) and key."""
    faults = Faults(name, lines or {})
    if not isinstance(tree, dict):
        faults.add((), f"found {kind_of(tree)}; expected keys such as version, seed, edits")
        faults.raise_any()
    top = faults.check((), _Top, tree)
    entries = tree.get("edits") if isinstance(tree.get("edits"), list) else []
    painter = top.models.inpaint if top else None
    steps = [
        _step(faults, ("edits", i), _painted(entry, painter))
        for i, entry in enumerate(entries or [])
    ]
    faults.raise_any()
    assert top is not None
    return Recipe(
        seed=top.seed,
        copies=top.copies,
        keep_originals=top.keep_originals,
        select=top.select,
        steps=tuple(step for step in steps if step),
        source=json.loads(json.dumps(tree)),
        gates=top.gates or _unasked(tree, steps),
        accuracy=top.accuracy,
        arms=tuple(top.arms),
        models=top.models,
        video=top.video,
        refine=top.refine,
        on_missing=top.on_missing,
        embeddings=top.embeddings,
        roles=dict(top.roles),
        instructions=top.instructions,
    )


def _unasked(tree: Mapping[str, Any], steps: Iterable[Step | None]) -> Gates | None:
    """Gates of a recipe that has none: those of moved cameras, where an edit moves them."""
    options = (option for step in steps if step for option in step.options)
    if tree.get("gates") is False or not any(
        Effect.CAMERA in one.operator.effect for one in options
    ):
        return None
    return UNASKED


def option(name: str, fields: dict[str, Any]) -> Option:
    """An operator made from its recipe fields. Raises BadRecipe."""
    faults = Faults(name, {})
    made = _option(faults, (), {"op": name, **fields})
    faults.raise_any()
    assert made is not None
    return made


def schema() -> dict[str, Any]:
    """JSON Schema of recipe files, with every installed operator's fields."""
    installed = tuple((name, registry.operator(name)) for name in registry.operator_names())
    return dict(json.loads(_schema(installed)))


@cache
def _schema(operators: tuple[tuple[str, type[Operator]], ...]) -> str:
    """The schema with these operators, as text: whoever asks gets it new, and it is made once."""
    top = _Top.model_json_schema()
    definitions = top.setdefault("$defs", {})
    names: list[dict[str, str]] = []
    alternatives: list[dict[str, str]] = []
    chance = _Chance.model_json_schema()["properties"]
    weight = {"weight": {"type": "number", "exclusiveMinimum": 0, "maximum": 1e6, "default": 1.0}}
    for name, operator in operators:
        fields = TypeAdapter(operator).json_schema(ref_template="#/$defs/{model}")
        definitions.update(fields.pop("$defs", {}))
        fields["required"] = ["op", *fields.get("required", [])]
        for kind, extra, group in (("op", chance, names), ("one_of", weight, alternatives)):
            properties = {"op": {"const": name}} | extra | fields.get("properties", {})
            definitions[f"{kind}_{name}"] = fields | {"properties": properties}
            group.append({"$ref": f"#/$defs/{kind}_{name}"})
    definitions["one_of"] = {
        "type": "object",
        "properties": {"one_of": {"type": "array", "items": {"oneOf": alternatives}, "minItems": 1}}
        | chance,
        "required": ["one_of"],
        "additionalProperties": False,
    }
    top["properties"]["gates"]["anyOf"].append({"const": False})
    top["properties"]["edits"] = {
        "type": "array",
        "items": {"oneOf": [*names, {"$ref": "#/$defs/one_of"}]},
        "default": [],
    }
    return json.dumps(top)


def _painted(entry: Any, painter: str | None) -> Any:
    """An entry whose edits paint what nobody saw with the recipe's model, unless they name another."""
    if painter is None or not isinstance(entry, dict):
        return entry
    if isinstance(entry.get("one_of"), list):
        return {**entry, "one_of": [_painted(one, painter) for one in entry["one_of"]]}
    try:
        fields = getattr(registry.operator(str(entry.get("op"))), "__dataclass_fields__", {})
    except RpaugError:  # it is named as a fault
        return entry
    return {"inpaint": painter, **entry} if "inpaint" in fields else entry


def _step(faults: Faults, path: Path_, entry: Any) -> Step | None:
    if not isinstance(entry, dict):
        faults.add(path, f"found {kind_of(entry)}; expected a mapping with `op` or `one_of`")
        return None
    chance = faults.check(path, _Chance, {k: v for k, v in entry.items() if k in CHANCE})
    rest = {k: v for k, v in entry.items() if k not in CHANCE}
    if "one_of" not in entry:
        options = [_option(faults, path, rest)]
    else:
        for key in rest.keys() - {"one_of"}:
            faults.add(
                (*path, key), f"unknown key; beside one_of only {' and '.join(CHANCE)} are known"
            )
        choices = entry["one_of"]
        if not isinstance(choices, list) or not choices:
            faults.add((*path, "one_of"), f"found {kind_of(choices)}; expected a list of edits")
            return None
        options = [_alternative(faults, (*path, "one_of", i), one) for i, one in enumerate(choices)]
    made = tuple(option for option in options if option)
    return Step(made, chance.probability, chance.together) if chance and made else None


def _alternative(faults: Faults, path: Path_, entry: Any) -> Option | None:
    if not isinstance(entry, dict):
        return _option(faults, path, entry)
    weight = faults.check(path, _Weight, {k: v for k, v in entry.items() if k == "weight"})
    made = _option(faults, path, {k: v for k, v in entry.items() if k != "weight"})
    return replace(made, weight=weight.weight) if made and weight else None


def _option(faults: Faults, path: Path_, entry: Any) -> Option | None:
    if not isinstance(entry, dict) or not isinstance(entry.get("op"), str):
        faults.add(path, f"found {kind_of(entry)} without `op`; expected one of: {_names()}")
        return None
    fields = {k: v for k, v in entry.items() if k != "op"}
    try:
        kind = registry.operator(entry["op"])
    except RpaugError as error:
        faults.add((*path, "op"), str(error))
        return None
    operator = faults.check(path, kind, fields)
    return Option(entry["op"], fields, operator) if operator is not None else None


def _names() -> str:
    return ", ".join(registry.operator_names())
