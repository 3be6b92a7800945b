"""How a server wants to be asked: which form holds the answer, how its length is bounded, with or without temperature.

Servers that call themselves OpenAI-compatible differ in these. What one refuses is left out or said otherwise, one
thing at a time, as the error names it: OpenAI has `param`, vLLM pydantic's `loc`, llama.cpp and Ollama a sentence. What
a server took is remembered for its URL and model as long as the process lives.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rpaug.providers import strict_schema

Messages = Sequence[Mapping[str, Any]]
"""A talk; what is said is a text, or a list of parts, some of which may be images."""

FORMS = ("strict", "schema", "tools", "object", "plain")
LIMITS = ("max_tokens", "max_completion_tokens", "")  # who does not know the first says so
NAMED = re.compile(
    r"(?P<limit>max_(?:completion_)?tokens)|(?P<temperature>temperature)"
    r"|(?P<form>response_format|structured|schema|json_object|\btool|grammar|guided|additionalprop)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Way:
    """One way to ask. Forms: a strict schema, any schema, a tool's arguments, any JSON object, words alone."""

    form: str = FORMS[0]
    limit: str = LIMITS[0]
    temperature: bool = True

    def body(
        self,
        model: str,
        messages: Messages,
        name: str,
        schema: Mapping[str, Any],
        temperature: float,
        tokens: int,
    ) -> dict[str, Any]:
        """The request. Where the form holds no schema, the schema is told in words."""
        out: dict[str, Any] = {"model": model, "messages": list(messages), "stream": False}
        out |= {"temperature": temperature} if self.temperature else {}
        out |= {self.limit: tokens} if self.limit else {}
        narrow = strict_schema.strict(schema) if self.form in ("strict", "tools") else None
        if self.form in ("strict", "schema"):
            held = narrow is not None
            form = {"name": name, "schema": narrow if held else schema, "strict": held}
            out["response_format"] = {"type": "json_schema", "json_schema": form}
        elif self.form == "tools":
            function = {
                "name": name,
                "description": "Gives the answer.",
                "parameters": narrow or schema,
            }
            out["tools"] = [{"type": "function", "function": function}]
            out["tool_choice"] = {"type": "function", "function": {"name": name}}
        else:
            out["messages"] = _instructed(messages, wanted(schema))
            out |= {"response_format": {"type": "json_object"}} if self.form == "object" else {}
        return out

    def otherwise(self, refusal: str) -> "Way | None":
        """The next way after a refusal in these words; None where nothing is left to leave out.

        The thing that is named first is changed. Where nothing is named, all is left out at once: if even that is
        refused, the refusal is about something else.
        """
        for found in NAMED.finditer(refusal):
            if found["limit"] and self.limit:
                return replace(self, limit=LIMITS[LIMITS.index(self.limit) + 1])
            if found["temperature"] and self.temperature:
                return replace(self, temperature=False)
            if found["form"] and self.form != FORMS[-1]:
                return replace(self, form=FORMS[FORMS.index(self.form) + 1])
        bare = Way(FORMS[-1], LIMITS[-1], False)
        return None if self == bare or NAMED.search(refusal) else bare


TAKEN: dict[tuple[str, str], Way] = {}
"""By URL and model: what the server took last."""


def wanted(schema: Mapping[str, Any]) -> str:
    """What is asked of the answer, in words."""
    return f"Answer with one JSON value that fits this JSON schema, and nothing else: {json.dumps(schema)}"


def _instructed(messages: Messages, words: str) -> list[dict[str, Any]]:
    """The talk with these words at the end of its first system message."""
    out = [dict(message) for message in messages]
    if out and out[0]["role"] == "system" and isinstance(out[0]["content"], str):
        out[0]["content"] += f"\n\n{words}"
        return out
    return [{"role": "system", "content": words}, *out]
