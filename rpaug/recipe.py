"""The recipe: what to change, how often, from which seed. YAML in, validated operators out."""

import fnmatch
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from rpaug import registry
from rpaug.errors import BadRecipe, RpaugError
from rpaug.files import read_bytes
from rpaug.gates import Gates
from rpaug.interfaces import Operator

MAX_BYTES = 2**20
MAX_NODES = 20_000  # aliases expand: a small file can name a very large tree

Path_ = tuple[str | int, ...]


class Select(BaseModel):
    """Which episodes to take: `episodes` are shell patterns on keys, `limit` the first so many of them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    episodes: list[str] = ["*"]
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
    depth_model: str | None = None
    edits: list[dict[str, Any]] = []
    gates: Gates | None = None


class _Chance(BaseModel):
    """What every entry of `edits` may carry beside its operator's own fields."""

    model_config = ConfigDict(extra="forbid")

    probability: Annotated[float, Field(ge=0, le=1)] = 1.0


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


@dataclass(frozen=True)
class Step:
    """One entry of `edits`: taken with `probability`, as one of `options`."""

    options: tuple[Option, ...]
    probability: float = 1.0

    def draw(self, rng: np.random.Generator) -> Option | None:
        """The option of this draw, or None if the step is skipped."""
        if rng.random() >= self.probability:
            return None
        weights = np.array([option.weight for option in self.options])
        return self.options[int(rng.choice(len(self.options), p=weights / weights.sum()))]


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
    depth_model: str | None = None  # for episodes without depth

    def generator(self, key: str, copy: int, step: int, attempt: int = 0) -> np.random.Generator:
        """The random stream of one step for one copy of one episode: the same in any order, on any worker.

        A copy that failed its gates is drawn again with the next `attempt`. `key` is relative to the dataset's root:
        two datasets with the same keys draw alike under one seed.
        """
        name = int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "little")
        again = [attempt] if attempt else []
        return np.random.default_rng([self.seed, name, copy, step, *again])


def load(path: Path, overrides: Sequence[str] = ()) -> Recipe:
    """The recipe in a YAML file, with `a.b=c` overrides applied. Raises BadRecipe with file, line and key."""
    data = read_bytes(path)
    if len(data) > MAX_BYTES:
        raise BadRecipe(f"{path}: found {len(data)} bytes; expected at most {MAX_BYTES}")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise BadRecipe(f"{path}: byte {error.start} is not UTF-8") from None
    tree, lines = _parse(text, str(path))
    for override in overrides:
        _override(tree, override)
    return build(tree, name=str(path), lines=lines)


def build(tree: Any, *, name: str = "recipe", lines: dict[Path_, int] | None = None) -> Recipe:
    """The recipe of plain data. Raises BadRecipe naming every fault by line (if known) and key."""
    faults = _Faults(name, lines or {})
    if not isinstance(tree, dict):
        raise BadRecipe(f"{name}: found {_kind(tree)}; expected keys such as version, seed, edits")
    top = faults.check((), _Top, tree)
    entries = tree.get("edits") if isinstance(tree.get("edits"), list) else []
    steps = [_step(faults, ("edits", i), entry) for i, entry in enumerate(entries or [])]
    faults.raise_any()
    assert top is not None
    return Recipe(
        seed=top.seed,
        copies=top.copies,
        keep_originals=top.keep_originals,
        select=top.select,
        steps=tuple(step for step in steps if step),
        source=json.loads(json.dumps(tree)),
        gates=top.gates,
        accuracy=top.accuracy,
        arms=tuple(top.arms),
        depth_model=top.depth_model,
    )


def option(name: str, fields: dict[str, Any]) -> Option:
    """An operator made from its recipe fields. Raises BadRecipe."""
    faults = _Faults(name, {})
    made = _option(faults, (), {"op": name, **fields})
    faults.raise_any()
    assert made is not None
    return made


def schema() -> dict[str, Any]:
    """JSON Schema of recipe files, with every installed operator's fields."""
    top = _Top.model_json_schema()
    definitions = top.setdefault("$defs", {})
    names: list[dict[str, str]] = []
    alternatives: list[dict[str, str]] = []
    chance = {"probability": {"type": "number", "minimum": 0, "maximum": 1, "default": 1.0}}
    weight = {"weight": {"type": "number", "exclusiveMinimum": 0, "maximum": 1e6, "default": 1.0}}
    for name in registry.operator_names():
        fields = TypeAdapter(registry.operator(name)).json_schema(ref_template="#/$defs/{model}")
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
    top["properties"]["edits"] = {
        "type": "array",
        "items": {"oneOf": [*names, {"$ref": "#/$defs/one_of"}]},
        "default": [],
    }
    return top


def _step(faults: "_Faults", path: Path_, entry: Any) -> Step | None:
    if not isinstance(entry, dict):
        faults.add(path, f"found {_kind(entry)}; expected a mapping with `op` or `one_of`")
        return None
    chance = faults.check(path, _Chance, {k: v for k, v in entry.items() if k == "probability"})
    rest = {k: v for k, v in entry.items() if k != "probability"}
    if "one_of" not in entry:
        options = [_option(faults, path, rest)]
    else:
        for key in rest.keys() - {"one_of"}:
            faults.add((*path, key), "unknown key; beside one_of only probability is known")
        choices = entry["one_of"]
        if not isinstance(choices, list) or not choices:
            faults.add((*path, "one_of"), f"found {_kind(choices)}; expected a list of edits")
            return None
        options = [_alternative(faults, (*path, "one_of", i), one) for i, one in enumerate(choices)]
    made = tuple(option for option in options if option)
    return Step(made, chance.probability) if chance and made else None


def _alternative(faults: "_Faults", path: Path_, entry: Any) -> Option | None:
    if not isinstance(entry, dict):
        return _option(faults, path, entry)
    weight = faults.check(path, _Weight, {k: v for k, v in entry.items() if k == "weight"})
    made = _option(faults, path, {k: v for k, v in entry.items() if k != "weight"})
    return replace(made, weight=weight.weight) if made and weight else None


def _option(faults: "_Faults", path: Path_, entry: Any) -> Option | None:
    if not isinstance(entry, dict) or not isinstance(entry.get("op"), str):
        faults.add(path, f"found {_kind(entry)} without `op`; expected one of: {_names()}")
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


class _Faults:
    """Collects what is wrong, so that one run tells all of it."""

    def __init__(self, name: str, lines: dict[Path_, int]) -> None:
        self.name, self.lines, self.found = name, lines, []  # type: ignore[var-annotated]

    def add(self, path: Path_, message: str) -> None:
        line = next(
            (self.lines[path[:n]] for n in range(len(path), -1, -1) if path[:n] in self.lines), None
        )
        place = f"{self.name}:{line}" if line else self.name
        self.found.append(f"{place}: {dotted(path)}: {message}" if path else f"{place}: {message}")

    def check(self, path: Path_, kind: type, data: Any) -> Any:
        try:
            return TypeAdapter(kind).validate_python(data)
        except ValidationError as error:
            for fault in error.errors(include_url=False):
                where = (
                    *path,
                    *(part for part in fault["loc"] if not str(part).startswith("function-")),
                )
                message = fault["msg"].removeprefix("Value error, ")
                if fault["type"] == "missing":
                    self.add(where, "missing")
                elif fault["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
                    self.add(where, "unknown key")
                else:
                    self.add(where, f"found {fault['input']!r:.80}; {message}")
            return None

    def raise_any(self) -> None:
        if self.found:
            raise BadRecipe("\n".join(self.found))


def dotted(path: Path_) -> str:
    """`edits[0].color` for ("edits", 0, "color")."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


def _kind(value: Any) -> str:
    return {dict: "a mapping", list: "a list", type(None): "nothing"}.get(
        type(value), repr(value)[:60]
    )


def _parse(text: str, name: str) -> tuple[Any, dict[Path_, int]]:
    """Plain data and the line of every key. Safe tags only, no duplicate keys, bounded aliases."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        lines = dict(_walk(node, (), name)) if node else {}
        return yaml.safe_load(text), lines
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        raise BadRecipe(f"{name}:{mark.line + 1 if mark else '?'}: {error.problem}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise BadRecipe(f"{name}: not YAML: {str(error)[:200]}") from None


def _walk(node: yaml.Node, path: Path_, name: str) -> Iterator[tuple[Path_, int]]:
    stack, seen = [(node, path)], 0
    while stack:
        node, path = stack.pop()
        seen += 1
        if seen > MAX_NODES or len(path) > 50:
            raise BadRecipe(
                f"{name}: found more than {MAX_NODES} values or 50 levels; expected a recipe"
            )
        yield path, node.start_mark.line + 1
        if isinstance(node, yaml.MappingNode):
            keys = set()
            for key, value in node.value:
                if not isinstance(key, yaml.ScalarNode):
                    raise BadRecipe(
                        f"{name}:{key.start_mark.line + 1}: found a key that is no word"
                    )
                if key.value in keys:
                    raise BadRecipe(f"{name}:{key.start_mark.line + 1}: {key.value}: given twice")
                keys.add(key.value)
                stack.append((value, (*path, str(key.value))))
        elif isinstance(node, yaml.SequenceNode):
            stack += [(value, (*path, i)) for i, value in enumerate(node.value)]


def _override(tree: Any, override: str) -> None:
    """Apply `edits.0.color=red` to plain data. Raises BadRecipe."""
    dotted_path, equals, text = override.partition("=")
    if not equals or not dotted_path:
        raise BadRecipe(f"--set {override}: expected key.path=value")
    *parents, last = dotted_path.split(".")
    here = tree
    try:
        for part in parents:
            here = here[int(part)] if isinstance(here, list) else here.setdefault(part, {})
        value = yaml.safe_load(text)
        if isinstance(here, list):
            here[int(last)] = value
        elif isinstance(here, dict):
            here[last] = value
        else:
            raise BadRecipe(
                f"--set {override}: {'.'.join(parents)} holds {_kind(here)}, not a mapping or list"
            )
    except (ValueError, IndexError, AttributeError, yaml.YAMLError):
        raise BadRecipe(f"--set {override}: no such place in the recipe, or not a value") from None
