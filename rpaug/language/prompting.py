"""Prompts: versioned text files with examples, one for each stage that a model may take over.

A file begins with `stage:` and `version:`; blocks that begin with `--- system`, `--- user` and `--- assistant` follow.
The examples are sent as turns of the talk before the question. A changed prompt is a new file with a new number, so
that a log says which words a model was given.
"""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from rpaug.core.errors import BadInput

LATEST = {"wish": 4, "manager": 3, "cause": 1, "detail": 1, "remedy": 3}


@dataclass(frozen=True)
class Prompt:
    """What a model is told before the question: the system's words, and pairs of question and answer."""

    stage: str
    version: int
    system: str
    examples: tuple[tuple[str, str], ...]

    def messages(self, question: str, **values: str) -> list[dict[str, str]]:
        """The whole talk up to the question; `{name}` in the system's words takes a value."""
        system = self.system
        for name, value in values.items():
            system = system.replace("{" + name + "}", value)
        out = [{"role": "system", "content": system}]
        for asked, answered in self.examples:
            out += [{"role": "user", "content": asked}, {"role": "assistant", "content": answered}]
        return [*out, {"role": "user", "content": question}]


@cache
def prompt(stage: str) -> Prompt:
    """A stage's latest prompt. Raises BadInput."""
    number = LATEST[stage]
    name = f"{stage}.v{number}.txt"
    text = (files("rpaug.language") / "prompts" / name).read_text(encoding="utf-8")
    head, *blocks = text.split("\n--- ")
    facts = dict(line.split(": ", 1) for line in head.strip().splitlines())
    if facts != {"stage": stage, "version": str(number)}:
        raise BadInput(name, "head", found=facts, expected=f"stage: {stage}, version: {number}")
    given = [(kind, body.strip()) for kind, _, body in (block.partition("\n") for block in blocks)]
    kinds = [kind for kind, _ in given]
    if kinds != ["system", *["user", "assistant"] * (len(kinds) // 2)]:
        raise BadInput(
            name, "blocks", found=kinds, expected="system, then user and assistant in turn"
        )
    turns = [body for _, body in given[1:]]
    return Prompt(stage, number, given[0][1], tuple(zip(turns[::2], turns[1::2], strict=True)))
