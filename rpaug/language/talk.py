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

from rpaug.assets import library
from rpaug.assets.textures import shipped
from rpaug.core import registry
from rpaug.core.errors import RpaugError
from rpaug.language import answers, declared, manager, rounds, schemas, templates
from rpaug.language.messages import (
    Answer,
    Entry,
    Mention,
    Message,
    NotUnderstood,
    Trace,
    WishContext,
)
from rpaug.language.prompting import prompt
from rpaug.language.rounds import History
from rpaug.providers.language import Endpoint


class WishModel:
    """Understands wishes by asking an endpoint; `usage` says what that has cost."""

    def __init__(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint

    @property
    def usage(self) -> dict[str, Any]:
        """Requests, retries, tokens, seconds, and the cost if prices are known."""
        return self._endpoint.usage.describe(self._endpoint.price)

    def __call__(self, history: History, stated: str, setting: WishContext) -> Answer:
        """What a wish comes to. Raises NotUnderstood, or LanguageError where the endpoint is of no use."""
        if not 0 < len(stated.strip()) <= rounds.LONGEST:
            raise NotUnderstood(
                f"a wish has 1 to {rounds.LONGEST} characters, not {len(stated.strip())}"
            )
        wish = history.wish(stated, setting)
        question = {
            "wish": stated,
            "cameras": [answers.short(name) for name in setting.cameras],
            "instructions": [answers.short(text) for text in setting.instructions[:5]],
            "earlier": list(wish.edits),
        }
        trace: list[Trace] = []
        check = partial(answers.plan, stated=stated, earlier=len(wish.edits))
        plan: answers.WishPlan = self._asked(
            "manager", question, schemas.of_plan(), check, trace, operators=operators()
        )
        if plan.refuse:
            raise NotUnderstood(f"{self._endpoint.model}: {self._endpoint.hidden(plan.refuse)}")
        edits = [edit for number, edit in enumerate(wish.edits) if number not in plan.drop]
        mention = wish.mention
        for step in plan.steps:
            made = self._made(
                step, mention, wish.setting, answers.known_words(stated, wish.edits), trace
            )
            edits += made
            named = [target for edit in made for target in declared.targets(edit)]
            mention = Mention(kind="target", target=named[-1]) if named else mention
        settings = dict(wish.settings) | _settings(plan)
        if not (plan.steps or plan.drop or _settings(plan)):
            raise NotUnderstood(f"{self._endpoint.model} finds no change in {stated!r}")
        answer = Answer(
            edits=tuple(edits),
            settings=settings,
            mention=mention,
            notes=_unused(stated, plan),
            trace=tuple(trace),
        )
        return answer.model_copy(
            update={"notes": (*answer.notes, *_compared(history, stated, setting, answer))}
        )

    def _made(
        self,
        step: answers.WishStep,
        mention: Mention | None,
        setting: WishContext,
        known: frozenset[str],
        trace: list[Trace],
    ) -> list[Entry]:
        if step.op == "camera_pose":
            question: dict[str, Any] = {
                "step": step.said,
                "cameras": list(map(answers.short, setting.cameras)),
            }
            seen = partial(answers.viewpoint, cameras=setting.cameras)
            schema = schemas.of_viewpoint(setting.cameras)
            return [self._asked("renderer", question, schema, seen, trace).edit()]
        it = mention.target if mention and mention.kind == "target" else None
        question = {"step": step.said, "op": step.op, "it": it}
        check = partial(answers.edits, op=step.op, known=known, generates=setting.generates)
        return self._asked(
            "operation", question, schemas.of_edits(step.op), check, trace,
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
        found = self._endpoint.ask(messages, stage, schemas.plain(schema), check)
        output = found.model_dump() if isinstance(found, Message) else found
        label = f"{stage}.v{words.version}"
        shown = json.loads(self._endpoint.hidden(json.dumps(output)))
        trace.append(
            Trace(stage=stage, by=self._endpoint.model, input=dict(question), output=shown,
                  prompt={"file": label, "messages": messages})
        )  # fmt: skip
        return found


def _settings(plan: answers.WishPlan) -> dict[str, Any]:
    named = {"copies": plan.copies, "seed": plan.seed, "keep_originals": plan.keep_originals}
    out = {name: value for name, value in named.items() if value is not None}
    return out | ({"select": {"limit": plan.limit}} if plan.limit is not None else {})


def _unused(stated: str, plan: answers.WishPlan) -> tuple[str, ...]:
    """What of the wish no step rests on, to be told."""
    left = manager.normal(stated)
    for step in plan.steps:
        left = left.replace(manager.normal(step.said), " ")
    words = [
        word
        for word in re.findall(r"[a-z0-9]+", left)
        if word not in ("and", "then", "the", "please")
    ]
    return (f"no step rests on: {' '.join(words)}",) if words else ()


def _compared(
    history: History, stated: str, setting: WishContext, answer: Answer
) -> tuple[str, ...]:
    """What the offline grammar makes of the same wish, where it makes something else of it."""
    try:
        other = rounds.next_round(history, stated, setting)
    except RpaugError:
        return ("the offline grammar does not understand this wish",)
    if other.edits == answer.edits:
        return ()
    return (f"the offline grammar reads it as: {json.dumps(list(other.edits))}",)


def operators() -> str:
    """What can be asked for: every operator with its first sentence, and how it may be said."""
    lines = []
    for name in registry.operator_names():
        stated = ", ".join(f'"{one}"' for one in templates.examples(name))
        first = (registry.operator(name).__doc__ or "").splitlines()[0]
        lines.append(f"- {name}: {first}" + (f" e.g. {stated}" if stated else ""))
    return "\n".join(lines)
