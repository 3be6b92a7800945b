"""A language model words the instruction; rules check what it says against the edited scene, and stand in for it."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from rpaug.instruct.judging import Judge, Untrue
from rpaug.providers import llm_settings
from rpaug.providers.language import Endpoint, LanguageError

LONGEST = 300  # characters of an instruction
REWRITE = (
    "You keep the instruction of a recorded robot demonstration true after its recording was edited. Change only the "
    "words that are no longer true or no longer clear, keep its language and its capitals, and name nothing that is "
    "not there. `things` are what the recording shows, `edits` what was changed. Answer with `text`, and with "
    "`english` and `recorded_english`, what your text and the recorded one say in English."
)
PARAPHRASE = (
    "You say the instruction of a robot demonstration in other words, in its own language: the same things, colors, "
    "places, sizes, numbers and order, nothing added and nothing left out. Answer with `texts`, as many as `count`."
)
STRING = {"type": "string", "maxLength": LONGEST}
REWRITTEN = {"text": STRING, "english": STRING, "recorded_english": STRING}
PARAPHRASED = {"texts": {"type": "array", "items": STRING, "maxItems": 20}}

T = TypeVar("T")


@dataclass(frozen=True)
class Wording:
    """What asks the model: to rewrite (`first`, before the rules), and for so many `paraphrases` of each text.

    One question is asked once: copies that are edited alike are worded alike.
    """

    endpoint: Endpoint
    first: bool = False
    paraphrases: int = 0
    _answers: dict[str, Any] = field(default_factory=dict, repr=False)

    def rewritten(self, text: str, judge: Judge, readable: bool) -> str:
        """The instruction after the edits. Raises LanguageError where no answer holds.

        What the rules cannot read is checked by the model's own English.
        """

        def check(value: Any) -> str:
            new = _plain(value["text"])
            pair = (new, text) if readable else (value["english"], value["recorded_english"])
            judge.hold(*pair)
            return new

        question = {"instruction": text, "things": judge.things, "edits": judge.edits}
        return self._asked(REWRITE, "instruction", question, REWRITTEN, check)

    def varied(self, text: str, judge: Judge, rng: np.random.Generator) -> tuple[str, str]:
        """The text or one of its paraphrases that hold, drawn; and in a sentence what was missing."""

        def check(value: Any) -> list[str]:
            found: list[str] = []
            for one in map(_plain, value["texts"][: self.paraphrases]):
                try:
                    judge.hold(one, text)
                except Untrue:
                    continue
                found += [one] if one not in (text, *found) else []
            if not found:
                raise Untrue("none of the texts says the same of the same things")
            return found

        question = {"instruction": text, "count": self.paraphrases}
        why = ""
        try:
            texts = self._asked(PARAPHRASE, "paraphrases", question, PARAPHRASED, check)
        except LanguageError as error:
            texts, why = [], f"{text!r} has no paraphrase: {error}"
        if texts and len(texts) < self.paraphrases:
            why = f"{text!r} has {len(texts)} of {self.paraphrases} paraphrases that hold"
        return [text, *texts][int(rng.integers(len(texts) + 1))], why

    def _asked(
        self,
        words: str,
        name: str,
        question: dict[str, Any],
        properties: dict[str, Any],
        check: Callable[[Any], T],
    ) -> T:
        asked = json.dumps(question, ensure_ascii=False)
        if asked not in self._answers:
            messages = [{"role": "system", "content": words}, {"role": "user", "content": asked}]
            schema = {
                "type": "object",
                "properties": properties,
                "required": [*properties],
                "additionalProperties": False,
            }
            try:
                self._answers[asked] = self.endpoint.ask(messages, name, schema, check)
            except LanguageError as error:
                self._answers[asked] = error
        answer: T | LanguageError = self._answers[asked]
        if isinstance(answer, LanguageError):
            raise answer
        return answer


def wording(first: bool, paraphrases: int) -> Wording | None:
    """What a recipe's `instructions` ask for; None where that is no model. Raises LanguageError where none is named."""
    if not (first or paraphrases):
        return None
    endpoint = llm_settings.endpoint(None, None)
    if endpoint is None:
        raise LanguageError(
            f"the recipe's `instructions` need a language model: name one by {llm_settings.URL} and "
            f"{llm_settings.MODEL}, or in {llm_settings.path()}"
        )
    return Wording(endpoint, first, paraphrases)


def _plain(text: str) -> str:
    """One line. Raises Untrue where there is none, or no end of it."""
    line = " ".join(text.split())
    if not line.isprintable() or not 0 < len(line) <= LONGEST:
        raise Untrue(f"an instruction is one line of 1 to {LONGEST} characters")
    return line
