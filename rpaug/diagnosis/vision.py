"""A vision model as the analyst: three prompts to any OpenAI-compatible endpoint that takes pictures.

The cause of each failure is asked three times; what all answers together give more than 0.8 is kept. Then what exactly
differs is asked, and the remedy in words, which must be a wish that `rpaug ask` understands: its complaint is told to
the model, a bounded number of times. Nothing that a model says is run.
"""

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from pydantic import Field

from rpaug.diagnosis import pictures
from rpaug.diagnosis.analyst import Judged, Moments
from rpaug.diagnosis.evaluation import Evaluation, Rollout
from rpaug.diagnosis.messages import FACTORS, KEPT, Cause, Factor
from rpaug.diagnosis.reference import Reference
from rpaug.language import answers, rounds, schemas
from rpaug.language.messages import Message, WishContext
from rpaug.language.prompting import prompt
from rpaug.providers.language import Endpoint

TIMES = 3  # that a cause is asked for
WARMTH = 0.7  # temperature: three answers at 0 would be one
MOST_FAILURES = 8  # that a model is shown
SHORT = 300  # characters of an instruction that is shown


class Guess(Message):
    """One possible cause."""

    factor: Factor
    confidence: float = Field(ge=0, le=1)


class Guesses(Message):
    """What the model takes for causes of one failure."""

    causes: tuple[Guess, ...] = Field(max_length=len(FACTORS))


class Detail(Message):
    """What exactly differs."""

    detail: str = Field(min_length=1, max_length=500)


class Remedy(Message):
    """A wish that `rpaug ask` understands, or nothing."""

    remedy: str = Field(max_length=300)


class Vision:
    """Asks an endpoint about the failures' pictures."""

    def __init__(self, endpoint: Endpoint, most: int = MOST_FAILURES) -> None:
        self._endpoint, self._most = endpoint, most

    @property
    def label(self) -> str:
        """The model's name, and that a model judged."""
        return f"vision model {self._endpoint.hidden(self._endpoint.model)}"

    def __call__(
        self, evaluation: Evaluation, reference: Reference | None, moments: Moments
    ) -> Judged:
        """What the model takes for the causes. Raises LanguageError where the endpoint is of no use."""
        trace: list[dict[str, Any]] = []
        failures = evaluation.failures
        step = max(1, -(-len(failures) // self._most))
        looked = failures[::step]
        found = {one.name: self._causes(one, reference, moments, trace) for one in looked}
        causes = []
        for factor in FACTORS:
            named = {
                name: sure[factor] for name, sure in found.items() if sure.get(factor, 0) > KEPT
            }
            if named:
                best = next(one for one in looked if one.name == max(named, key=lambda n: named[n]))
                rate = len(named) / len(looked) * len(failures) / len(evaluation.rollouts)
                given = (factor, len(named), len(looked), max(named.values()), rate)
                causes.append(self._cause(given, best, reference, moments, trace))
        causes.sort(key=lambda cause: -cause.rate)
        notes = () if step == 1 else (f"{len(looked)} of {len(failures)} failures were shown",)
        usage = self._endpoint.usage.describe(self._endpoint.price)
        return Judged(tuple(causes), (), notes, usage, tuple(trace))

    def _causes(
        self, rollout: Rollout, reference: Reference | None, moments: Moments, trace: list
    ) -> Mapping[Factor, float]:
        """The mean confidence of three answers by factor."""
        shown = pictures.gallery(rollout, moments[rollout.name], reference)
        question = _question(rollout, shown) | {"failed_at": rollout.failed_at}
        sums: dict[Factor, float] = {}
        for _ in range(TIMES):
            answer: Guesses = self._asked("cause", question, shown, Guesses, trace, WARMTH)
            for factor in {one.factor for one in answer.causes}:
                sure = max(one.confidence for one in answer.causes if one.factor == factor)
                sums[factor] = sums.get(factor, 0.0) + sure / TIMES
        return sums

    def _cause(
        self,
        given: tuple[Factor, int, int, float, float],
        rollout: Rollout,
        reference: Reference | None,
        moments: Moments,
        trace: list,
    ) -> Cause:
        """One cause with its detail and remedy, from the failure that shows it best."""
        factor, named, looked, sure, rate = given
        shown = pictures.gallery(rollout, moments[rollout.name], reference)
        question = {"cause": factor} | _question(rollout, shown)
        detail: Detail = self._asked("detail", question, shown, Detail, trace)
        asked = {"cause": factor, "detail": detail.detail}
        setting = WishContext() if reference is None else reference.setting
        remedy: Remedy = self._asked("remedy", asked, (), Remedy, trace, setting=setting)
        return Cause(
            factor=factor,
            confidence=min(1.0, sure),
            rate=min(1.0, rate),
            detail=self._endpoint.hidden(detail.detail),
            remedy=self._endpoint.hidden(remedy.remedy),
            named=f"{named} of {looked} failures",
        )

    def _asked(
        self,
        stage: str,
        question: Mapping[str, Any],
        shown: Sequence[tuple[str, Any]],
        kind: type[Message],
        trace: list,
        temperature: float = 0.0,
        setting: WishContext | None = None,
    ) -> Any:
        words = prompt(stage)
        text = json.dumps(question, ensure_ascii=False)
        messages: list[dict[str, Any]] = list(words.messages(text, factors=", ".join(FACTORS)))
        if shown:
            messages[-1] = {"role": "user", "content": pictures.parts(text, shown)}
        check = partial(checked, kind, setting=setting)
        answer = self._endpoint.ask(
            messages, stage, schemas.plain(kind.model_json_schema()), check, temperature
        )
        stated = json.loads(self._endpoint.hidden(json.dumps(answer.model_dump())))
        trace.append(
            {"stage": stage, "by": self.label, "prompt": f"{stage}.v{words.version}",
             "input": json.loads(self._endpoint.hidden(text)), "output": stated}
        )  # fmt: skip
        return answer


def checked(kind: type[Message], value: Any, setting: WishContext | None = None) -> Message:
    """The answer, if it is of its kind, and a remedy is a wish that is understood. Raises ValueError, NotUnderstood."""
    answer: Message = answers.valid(kind, value)
    if isinstance(answer, Remedy) and answer.remedy and setting is not None:
        rounds.said_after(answer.remedy, (), setting)
    return answer


def _question(rollout: Rollout, shown: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    return {
        "instruction": " ".join(rollout.instruction.split())[:SHORT],
        "pictures": [name for name, _ in shown],
    }
