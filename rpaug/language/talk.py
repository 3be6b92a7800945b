"""A language model understands a wish: it sees what the recording holds, and what it answers must hold there.

One call does the work of manager, operation and renderer; `staged` asks them one after the other, for models that do
better with little at a time. What is wrong with an answer (an invalid field, a thing that is not there) is told to the
model, a bounded number of times.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from rpaug.assets import library
from rpaug.assets.textures import shipped
from rpaug.core import registry
from rpaug.language import answers, declared, rounds, schemas, templates
from rpaug.language.answers import WishAnswer
from rpaug.language.messages import Answer, Entry, Mention, NotUnderstood, Trace, WishContext
from rpaug.language.prompting import prompt
from rpaug.language.recording import Recording
from rpaug.language.rounds import History
from rpaug.pipeline import recipe
from rpaug.providers.language import Endpoint


class WishModel:
    """Understands wishes by asking an endpoint; `usage` says what that has cost.

    `staged`: the wish is split first, and each step asked alone. `pictures`: the model sees a numbered image too.
    """

    def __init__(self, endpoint: Endpoint, *, staged: bool = False, pictures: bool = False) -> None:
        self._endpoint = endpoint
        self._staged = staged
        self._pictures = pictures

    @property
    def usage(self) -> dict[str, Any]:
        """Requests, retries, tokens, seconds, and the cost if prices are known."""
        return self._endpoint.usage.describe(self._endpoint.price)

    def __call__(
        self,
        history: History,
        stated: str,
        setting: WishContext,
        recording: Recording | None = None,
    ) -> Answer:
        """What a wish comes to. Raises NotUnderstood, or LanguageError where the endpoint is of no use."""
        if not 0 < len(stated.strip()) <= rounds.LONGEST:
            raise NotUnderstood(
                f"a wish has 1 to {rounds.LONGEST} characters, not {len(stated.strip())}"
            )
        talk = _Talk(self._endpoint, history, setting, recording, self._pictures)
        if not self._staged:
            return talk.ask(stated, stated)
        plan = talk.split(stated)
        answer = talk.before.model_copy(
            update={"edits": tuple(_without(talk.before.edits, plan.drop))}
        )
        for step in plan.steps:
            answer = talk.ask(step.said, stated, [step.op], answer)
        if not (plan.steps or plan.drop or _settings(plan.settings)):
            raise NotUnderstood(f"{self._endpoint.model} finds no change in {stated!r}")
        return answer.model_copy(
            update={
                "settings": {**answer.settings, **_settings(plan.settings)},
                "trace": tuple(talk.trace),
            }
        )


class _Talk:
    """What is asked for one wish."""

    def __init__(
        self,
        endpoint: Endpoint,
        history: History,
        setting: WishContext,
        recording: Recording | None,
        pictures: bool,
    ) -> None:
        self._endpoint, self._setting, self._recording = endpoint, setting, recording
        last = history.rounds[-1] if history.rounds else None
        self.before = (
            Answer(edits=last.edits, settings=last.settings, mention=last.mention)
            if last
            else Answer(edits=())
        )
        self._said = [one.said for one in history.rounds]
        self._picture = recording.picture() if recording and pictures else None
        self.trace: list[Trace] = []

    def split(self, stated: str) -> answers.WishPlan:
        """The wish as steps, by the manager. Raises NotUnderstood where it refuses."""
        check = partial(answers.planned, stated=stated, earlier=len(self.before.edits))
        plan: answers.WishPlan = self._asked(
            "manager", self._question(stated), schemas.of_plan(), check
        )
        self._heed(plan.refuse)
        return plan

    def ask(
        self,
        asked: str,
        stated: str,
        ops: Sequence[str] | None = None,
        before: Answer | None = None,
    ) -> Answer:
        """What comes after `before` (all earlier rounds, if None) of the words that are asked for."""
        before = before or self.before
        took: list[WishAnswer] = []

        def check(value: Any) -> Answer:
            found = answers.understood(value, stated, len(before.edits))
            took[:] = [found]
            if found.refuse:
                return before
            answer = _after(before, found, self._setting, stated)
            if self._recording and answer.edits:
                list(self._recording.ground(answer))
                self._recording.check(answer)
            return answer

        schema = schemas.of_wish(self._setting.cameras, ops)
        answer: Answer = self._asked("wish", self._question(asked, before), schema, check, ops)
        self._heed(took[0].refuse)
        if answer.edits == before.edits and answer.settings == before.settings:
            raise NotUnderstood(f"{self._endpoint.model} finds no change in {asked!r}")
        return answer.model_copy(update={"trace": tuple(self.trace)})

    def _question(self, asked: str, before: Answer | None = None) -> dict[str, Any]:
        before, seen = before or self.before, self._recording
        question: dict[str, Any] = {
            "wish": asked,
            "cameras": [answers.short(name) for name in self._setting.cameras],
            "instructions": [answers.short(text) for text in self._setting.instructions[:5]],
            "instances": seen.inventory if seen else [],
            "axes": seen.axes if seen else None,
            "said": self._said[-5:],
            "earlier": list(before.edits),
        }
        if seen and before.edits:
            question["drawn"] = seen.drawn(before)
        return question

    def _asked(
        self,
        stage: str,
        question: Mapping[str, Any],
        schema: dict[str, Any],
        check: Any,
        ops: Sequence[str] | None = None,
    ) -> Any:
        words = prompt(stage)
        messages: list[dict[str, Any]] = [
            *words.messages(
                json.dumps(question, ensure_ascii=False),
                operators=operators(ops),
                things=things(),
                textures=", ".join(shipped.NAMES),
            )
        ]
        logged = {"file": f"{stage}.v{words.version}", "messages": [*messages]}
        if self._picture:
            messages[-1] = {"role": "user", "content": _shown(messages[-1], self._picture)}
        found = self._endpoint.ask(messages, stage, schema, check)
        output = json.loads(self._endpoint.hidden(json.dumps(found.model_dump(exclude={"trace"}))))
        self.trace.append(
            Trace(stage=stage, by=self._endpoint.model, input=dict(question), output=output,
                  prompt=logged)
        )  # fmt: skip
        return found

    def _heed(self, refuse: str) -> None:
        if refuse:
            raise NotUnderstood(f"{self._endpoint.model}: {self._endpoint.hidden(refuse)}")


def _after(before: Answer, found: WishAnswer, setting: WishContext, stated: str) -> Answer:
    """The recipe after an answer: without what it drops, with what it adds."""
    new = [answers.entry(edit, stated, setting) for edit in found.edits]
    options = [one for edit in new for one in edit.get("one_of", [edit])]
    named = [target for one in options for target in declared.targets(one)]
    return Answer(
        edits=(*_without(before.edits, found.drop), *new),
        settings={**before.settings, **_settings(found.settings)},
        mention=Mention(kind="target", target=named[-1]) if named else before.mention,
        notes=tuple(answers.short(note) for note in found.notes),
    )


def _settings(given: answers.WishSettings | None) -> dict[str, Any]:
    return given.entries() if given else {}


def _without(edits: Sequence[Entry], drop: Sequence[int]) -> list[Entry]:
    return [edit for number, edit in enumerate(edits) if number not in drop]


def _shown(message: Mapping[str, Any], picture: bytes) -> list[dict[str, Any]]:
    """A question in parts: its words, and the picture."""
    url = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
    return [
        {"type": "text", "text": message["content"]},
        {"type": "image_url", "image_url": {"url": url}},
    ]


def things() -> str:
    """What can be inserted: each category with its things."""
    kinds: dict[str, list[str]] = {}
    for one in library.assets():
        kinds.setdefault(one.category, []).append(one.name)
    return ", ".join(f"{kind} ({', '.join(kinds[kind])})" for kind in sorted(kinds))


def operators(ops: Sequence[str] | None = None) -> str:
    """What can be asked for: each operator's meaning, its fields, and wishes with what they come to."""
    lines, definitions = [], recipe.schema()["$defs"]
    for name in ops or registry.operator_names():
        kind = registry.operator(name)
        lines.append(f"- {name}: {' '.join((kind.__doc__ or '').split())}")
        if name != "camera_pose":  # given as a viewpoint
            lines.append(f"  fields: {schemas.fields(name, definitions)}")
        lines += [f"  {wish!r}: {json.dumps(given)}" for wish, given in kind.examples]
        if not kind.examples:
            lines += [f"  {wish!r}" for wish in templates.examples(name)]
    return "\n".join(lines)
