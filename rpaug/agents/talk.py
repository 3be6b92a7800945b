"""A language model in the place of the grammar: the same stages, each asked with a prompt and held to a schema.

Whatever the model says, an edit stands only if it is valid, if the words it rests on are the person's own, and if the
names in its targets were said. So text out of a dataset cannot ask for anything, and a model that makes things up is
told so, a bounded number of times.
"""

import json
import re
from collections.abc import Mapping
from functools import partial
from typing import Any

from pydantic import Field, ValidationError

from rpaug import recipe, registry
from rpaug.agents import manager, rounds
from rpaug.agents.making import lacking
from rpaug.agents.messages import Answer, Entry, Mention, Message, NotUnderstood, Setting, Trace
from rpaug.agents.prompting import prompt
from rpaug.agents.rounds import History
from rpaug.assets import library
from rpaug.errors import RpaugError
from rpaug.faults import dotted
from rpaug.providers.language import Endpoint
from rpaug.scene.naming import relations, roles
from rpaug.textures import shipped

DEGREE = 0.017453292519943295
SHORT = 200  # characters of a name or an instruction that is shown to a model


class Step(Message):
    """One change that a wish asks for, in the wish's own words."""

    said: str = Field(min_length=1, max_length=500)
    op: str


class Plan(Message):
    """What the manager makes of a wish."""

    steps: tuple[Step, ...] = Field(max_length=30)
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


class Model:
    """Understands wishes by asking an endpoint; `usage` says what that has cost."""

    def __init__(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint

    @property
    def usage(self) -> dict[str, Any]:
        """Requests, retries, tokens, seconds, and the cost if prices are known."""
        return self._endpoint.usage.describe(self._endpoint.price)

    def __call__(self, history: History, said: str, setting: Setting) -> Answer:
        """What a wish comes to. Raises NotUnderstood, or LanguageError where the endpoint is of no use."""
        if not 0 < len(said.strip()) <= rounds.LONGEST:
            raise NotUnderstood(
                f"a wish has 1 to {rounds.LONGEST} characters, not {len(said.strip())}"
            )
        wish = history.wish(said, setting)
        question = {
            "wish": said,
            "cameras": [_short(name) for name in setting.cameras],
            "instructions": [_short(text) for text in setting.instructions[:5]],
            "earlier": list(wish.edits),
        }
        trace: list[Trace] = []
        check = partial(_plan, said=said, earlier=len(wish.edits))
        plan: Plan = self._asked(
            "manager", question, _plan_schema(), check, trace, operators=_operators()
        )
        if plan.refuse:
            raise NotUnderstood(f"{self._endpoint.model}: {self._endpoint.hidden(plan.refuse)}")
        edits = [edit for number, edit in enumerate(wish.edits) if number not in plan.drop]
        mention = wish.mention
        for step in plan.steps:
            made = self._made(step, mention, wish.setting, _known(said, wish.edits), trace)
            edits += made
            named = [edit["target"] for edit in made if "target" in edit]
            mention = Mention(kind="target", target=named[-1]) if named else mention
        settings = dict(wish.settings) | _settings(plan)
        if not (plan.steps or plan.drop or _settings(plan)):
            raise NotUnderstood(f"{self._endpoint.model} finds no change in {said!r}")
        answer = Answer(
            edits=tuple(edits),
            settings=settings,
            mention=mention,
            notes=_unused(said, plan),
            trace=tuple(trace),
        )
        return answer.model_copy(
            update={"notes": (*answer.notes, *_compared(history, said, setting, answer))}
        )

    def _made(
        self,
        step: Step,
        mention: Mention | None,
        setting: Setting,
        known: frozenset[str],
        trace: list[Trace],
    ) -> list[Entry]:
        if step.op == "camera_pose":
            question: dict[str, Any] = {
                "step": step.said,
                "cameras": list(map(_short, setting.cameras)),
            }
            seen = partial(_viewpoint, cameras=setting.cameras)
            schema = viewpoint_schema(setting.cameras)
            return [self._asked("renderer", question, schema, seen, trace).edit()]
        it = mention.target if mention and mention.kind == "target" else None
        question = {"step": step.said, "op": step.op, "it": it}
        check = partial(_edits, op=step.op, known=known, generates=setting.generates)
        return self._asked(
            "operation", question, _edits_schema(step.op), check, trace,
            categories=", ".join(sorted({one.category for one in library.assets()})),
            textures=", ".join(shipped.NAMES),
        )  # fmt: skip

    def _asked(
        self,
        stage: str,
        question: Mapping[str, Any],
        schema: dict[str, Any],
        check: Any,
        trace: list[Trace],
        **values: str,
    ) -> Any:
        words = prompt(stage)
        messages = words.messages(json.dumps(question, ensure_ascii=False), **values)
        found = self._endpoint.ask(messages, stage, plain(schema), check)
        output = found.model_dump() if isinstance(found, Message) else found
        label = f"{stage}.v{words.version}"
        shown = json.loads(self._endpoint.hidden(json.dumps(output)))
        trace.append(
            Trace(stage=stage, by=self._endpoint.model, input=dict(question), output=shown,
                  prompt={"file": label, "messages": messages})
        )  # fmt: skip
        return found


def _plan(value: Any, said: str, earlier: int) -> Plan:
    """The manager's answer, if all of it rests on the wish. Raises ValueError."""
    plan = valid(Plan, value)
    wish = manager.normal(said)
    for step in plan.steps:
        if manager.normal(step.said) not in wish or not manager.normal(step.said):
            raise ValueError(f"said {step.said!r}: these are not words of the wish")
        if step.op not in registry.operator_names():
            raise ValueError(f"op {step.op!r}: there are: {', '.join(registry.operator_names())}")
    if any(not 0 <= number < earlier for number in plan.drop):
        raise ValueError(
            f"drop {list(plan.drop)}: there are {earlier} earlier edits, counted from 0"
        )
    if plan.refuse and plan.steps:
        raise ValueError("either refuse, or give steps")
    return plan


def _edits(value: Any, op: str, known: frozenset[str], generates: bool = False) -> list[Entry]:
    """The operator's edits, if each is valid and names only what was said. Raises ValueError, RpaugError."""
    edits = value.get("edits") if isinstance(value, dict) else None
    if (
        not isinstance(edits, list)
        or not 0 < len(edits) <= 30
        or not all(isinstance(e, dict) for e in edits)
    ):
        raise ValueError('expected {"edits": [...]} with 1 to 30 edits')
    for edit in edits:
        fields = {name: field for name, field in edit.items() if name != "op"}
        if edit.get("op") != op:
            raise ValueError(f"op {edit.get('op')!r}: expected {op!r}")
        recipe.option(op, fields)
        for name in ("target", "near", "targets"):
            for word in _words(fields.get(name)):
                if word not in known:
                    raise ValueError(f"{name}: {word!r} was not said")
        if op == "insert" and not fields.get("asset"):
            if not generates:
                library.find(fields.get("category"), fields.get("color"))
            elif lacking(edit) and (new := _words(fields.get("category")) - known):
                raise ValueError(f"category: {', '.join(sorted(new))!r} was not said")
    return edits


def _viewpoint(value: Any, cameras: tuple[str, ...]) -> Viewpoint:
    found = valid(Viewpoint, value)
    for name in found.cameras:
        if name not in cameras and found.cameras != ("static",):
            raise ValueError(
                f"camera {name!r}: there are: {', '.join(map(_short, cameras))}, or static for all"
            )
    return found


def valid(kind: Any, value: Any) -> Any:
    """A model's answer as a message of that kind. Raises ValueError with every fault."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        faults = [f"{dotted(fault['loc'])}: {fault['msg']}" for fault in error.errors()]
        raise ValueError("; ".join(faults[:5])) from None


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


def _known(said: str, earlier: tuple[Entry, ...]) -> frozenset[str]:
    """All words that were said, now or in earlier targets."""
    text = f"{said} {json.dumps(earlier)}".lower()
    return frozenset(_stem(word) for word in re.findall(r"[a-z0-9_]+", text))


def _stem(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def _settings(plan: Plan) -> dict[str, Any]:
    named = {"copies": plan.copies, "seed": plan.seed, "keep_originals": plan.keep_originals}
    out = {name: value for name, value in named.items() if value is not None}
    return out | ({"select": {"limit": plan.limit}} if plan.limit is not None else {})


def _unused(said: str, plan: Plan) -> tuple[str, ...]:
    """What of the wish no step rests on, to be told."""
    left = manager.normal(said)
    for step in plan.steps:
        left = left.replace(manager.normal(step.said), " ")
    words = [
        word
        for word in re.findall(r"[a-z0-9]+", left)
        if word not in ("and", "then", "the", "please")
    ]
    return (f"no step rests on: {' '.join(words)}",) if words else ()


def _compared(history: History, said: str, setting: Setting, answer: Answer) -> tuple[str, ...]:
    """What the offline grammar makes of the same wish, where it makes something else of it."""
    try:
        other = rounds.next_round(history, said, setting)
    except RpaugError:
        return ("the offline grammar does not understand this wish",)
    if other.edits == answer.edits:
        return ()
    return (f"the offline grammar reads it as: {json.dumps(list(other.edits))}",)


def _operators() -> str:
    return "\n".join(
        f"- {name}: {(registry.operator(name).__doc__ or '').split(chr(10))[0]}"
        for name in registry.operator_names()
    )


def _plan_schema() -> dict[str, Any]:
    schema = Plan.model_json_schema()
    schema["$defs"]["Step"]["properties"]["op"] = {"enum": registry.operator_names()}
    return schema


def viewpoint_schema(cameras: tuple[str, ...]) -> dict[str, Any]:
    """The schema of a camera's motion: only cameras that there are."""
    schema = Viewpoint.model_json_schema()
    schema["properties"]["cameras"]["items"] = {"enum": [*map(_short, cameras), "static"]}
    schema["properties"]["cameras"]["maxItems"] = max(1, len(cameras))
    return schema


def _edits_schema(op: str) -> dict[str, Any]:
    whole = recipe.schema()["$defs"]
    one = {name: value for name, value in whole[f"op_{op}"].items() if name != "title"}
    one["properties"] = {"op": {"const": op}} | {
        name: value
        for name, value in one["properties"].items()
        if name not in ("op", "probability")
    }
    schema = {
        "type": "object",
        "properties": {"edits": {"type": "array", "items": one, "minItems": 1, "maxItems": 30}},
        "required": ["edits"],
        "additionalProperties": False,
    }
    used: dict[str, Any] = {}
    _gather(schema, whole, used)
    return schema | ({"$defs": used} if used else {})


def _gather(value: Any, whole: Mapping[str, Any], used: dict[str, Any]) -> None:
    """Every definition that a schema refers to."""
    if isinstance(value, dict):
        name = str(value.get("$ref", "")).removeprefix("#/$defs/")
        if name and name not in used:
            used[name] = whole[name]
            _gather(whole[name], whole, used)
        for inner in value.values():
            _gather(inner, whole, used)
    elif isinstance(value, list):
        for inner in value:
            _gather(inner, whole, used)


def plain(schema: Any) -> Any:
    """Without what constrained decoders may not know: titles, descriptions, defaults and formats."""
    if isinstance(schema, list):
        return [plain(value) for value in schema]
    if not isinstance(schema, dict):
        return schema
    out = {}
    for name, value in schema.items():
        if name == "properties" or name == "$defs":
            out[name] = {key: plain(inner) for key, inner in value.items()}
        elif name not in ("title", "description", "default", "format"):
            out[name] = plain(value)
    return out


def _short(text: str) -> str:
    return " ".join(text.split())[:SHORT]
