"""What a chat completion says, whatever its shape: its text or refusal, the JSON within, an error, a wait."""

import email.utils
import json
import math
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

THOUGHT = re.compile(r"</think(?:ing)?>|\[/THINK\]|<\|channel\|>final<\|message\|>")
FENCED = re.compile(r"```[a-zA-Z0-9]*[ \t]*\n(.*?)\n?[ \t]*```", re.DOTALL)
SECONDS = re.compile(r"[0-9]{1,9}(?:\.[0-9]{0,9})?")


@dataclass(frozen=True)
class Reply:
    """The first choice: its text, why there is none, whether it was cut off, and the tokens in and out."""

    text: str
    refusal: str = ""
    cut: bool = False
    tokens: tuple[int, int] = (0, 0)


def read(value: Any) -> Reply:
    """The reply in a completion's JSON value. Raises ValueError where it is no completion."""
    choices = value.get("choices") if isinstance(value, dict) else None
    choice = choices[0] if isinstance(choices, list) and choices else None
    message = choice.get("message") if isinstance(choice, dict) else None
    if not isinstance(choice, dict) or not isinstance(message, dict):
        raise ValueError("no chat completion")
    ended = choice.get("finish_reason")
    text, refusal = _content(message.get("content"))
    refusal = str(message.get("refusal") or refusal or "")
    if ended == "content_filter" and not refusal:
        refusal = "a content filter withheld the answer"
    used = value.get("usage")
    used = used if isinstance(used, dict) else {}
    tokens = (_count(used.get("prompt_tokens")), _count(used.get("completion_tokens")))
    return Reply(_called(message) or text, refusal, ended == "length", tokens)


def error(value: Any) -> tuple[int | None, str] | None:
    """The status, if one is named, and words of an error in a reply; None where it is none.

    Known are OpenAI's `{"error": {"message", "param", "code"}}`, vLLM's flat one, a bare text, and FastAPI's `detail`.
    """
    if not isinstance(value, dict) or value.get("choices"):
        return None
    found = value.get("error") or value.get("detail")
    found = value if found is None and value.get("object") == "error" else found
    if not found:
        return None
    given = found if isinstance(found, dict) else {}
    words = [given[name] for name in ("param", "message") if given.get(name)] or [found]
    shown = " ".join(one if isinstance(one, str) else json.dumps(one) for one in words)
    code = given.get("code")
    return (code if type(code) is int and 400 <= code < 600 else None), shown


def parsed(text: str) -> Any:
    """The one JSON value in a model's words: bare, fenced, after its thoughts, or between other words.

    A value that is not whole, numbers that are none, names given twice and texts that are no Unicode are refused.
    Raises ValueError.
    """
    try:
        return _value(text)
    except ValueError as first:
        fault = first
    rest = THOUGHT.split(text)[-1].strip()
    fences = FENCED.findall(rest)
    if len(fences) > 1:
        raise ValueError("more than one JSON value")
    rest = fences[0] if fences else rest
    begin = re.search(r"[\[{]", rest)
    end = max(rest.rfind("}"), rest.rfind("]"))
    if begin is None or rest.lstrip().startswith(("<think", "[THINK]")):
        raise ValueError(f"not JSON: {fault}")
    return _value(rest[begin.start() : end + 1])


def wait(headers: Mapping[str, str]) -> float | None:
    """Seconds to wait, as `Retry-After-Ms` or `Retry-After` (seconds or a date) say; None where neither does."""
    for name, unit in (("retry-after-ms", 1e-3), ("retry-after", 1.0)):
        stated = (headers.get(name) or "").strip()
        if SECONDS.fullmatch(stated):
            return float(stated) * unit
        try:
            return max(0.0, email.utils.parsedate_to_datetime(stated).timestamp() - time.time())
        except (ValueError, TypeError, OverflowError, IndexError):
            continue
    return None


def _content(content: Any) -> tuple[str, str]:
    """The text and the refusal of a message's content: a text, parts, a value, or nothing."""
    if isinstance(content, list):
        parts = [part for part in content if isinstance(part, dict)]
        texts = [part["text"] for part in parts if isinstance(part.get("text"), str)
                 and part.get("type") in ("text", "output_text", None)]  # fmt: skip
        refused = [str(part["refusal"]) for part in parts if part.get("refusal")]
        return "".join(texts), " ".join(refused)
    if isinstance(content, dict):
        return json.dumps(content), ""
    return (content if isinstance(content, str) else ""), ""


def _called(message: Mapping[str, Any]) -> str:
    """The arguments of the first tool that is called; nothing where none is."""
    calls = message.get("tool_calls")
    call = calls[0] if isinstance(calls, list) and calls else None
    function = call.get("function") if isinstance(call, dict) else message.get("function_call")
    given = function.get("arguments") if isinstance(function, dict) else None
    return json.dumps(given) if isinstance(given, dict) else str(given or "")


def _count(value: Any) -> int:
    return value if type(value) is int and value >= 0 else 0


def _value(text: str) -> Any:
    try:
        value = json.loads(
            text.strip(), parse_constant=_number, parse_float=_number, object_pairs_hook=_once
        )
        json.dumps(value, ensure_ascii=False).encode()
        return value
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except UnicodeEncodeError:
        raise ValueError("a text that is no Unicode") from None


def _number(text: str) -> float:
    if not math.isfinite(float(text)):
        raise ValueError(f"{text[:20]} is no number")
    return float(text)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) < len(pairs):
        raise ValueError("a name is given twice")
    return out
