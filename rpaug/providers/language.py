"""Language models behind any OpenAI-compatible endpoint: bounded in time, size and tries, and silent about the key.

Only `POST {url}/chat/completions` is used, with `response_format` of type `json_schema`. What comes back is checked by
the caller; its complaint is told to the model, a bounded number of times. Redirects are not followed: they could carry
the key elsewhere.
"""

import contextlib
import http.client
import json
import os
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import urlsplit

from rpaug.core.errors import RpaugError

MOST_BYTES = 2**20  # of one reply
MOST_TOKENS = 1024  # asked for in one reply
LONGEST_WAIT = 10.0  # seconds that a rate limit may ask for before it is an error
FEW = 3  # tries of one question, of each kind: answers that are wrong, and servers that are busy
BUSY = (408, 429, 500, 502, 503, 504)
SHOWN = 200  # characters of what a server said, in an error

T = TypeVar("T")
Messages = Sequence[Mapping[str, Any]]
"""A talk; what is said is a text, or a list of parts, some of which may be images."""


class LanguageError(RpaugError):
    """The endpoint gave no usable answer; the message says which endpoint and why."""


class _Busy(Exception):
    """The server asks to be left alone for some seconds."""

    def __init__(self, why: str, wait: float | None) -> None:
        super().__init__(why)
        self.wait = wait


@dataclass
class Usage:
    """What was spent so far; tokens are those that the endpoint counted."""

    requests: int = 0
    retries: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    seconds: float = 0.0

    def describe(self, price: tuple[float, float] | None) -> dict[str, Any]:
        """Plain values; the cost only where a price is known."""
        out: dict[str, Any] = {**vars(self), "seconds": round(self.seconds, 2)}
        if price is not None:
            out["cost"] = round((self.tokens_in * price[0] + self.tokens_out * price[1]) / 1e6, 6)
        return out


@dataclass(frozen=True)
class Endpoint:
    """Where a model is, how to ask it, and what it has cost. `price` is for a million tokens in and out."""

    url: str
    model: str
    key: str = field(default="", repr=False)
    timeout: float = 60.0
    price: tuple[float, float] | None = None
    usage: Usage = field(default_factory=Usage)

    @classmethod
    def of(
        cls,
        url: str,
        model: str,
        *,
        key_env: str = "RPAUG_LLM_KEY",
        timeout: float = 60.0,
        price: tuple[float, float] | None = None,
    ) -> "Endpoint":
        """An endpoint with the key that is in the environment, if any. Raises LanguageError for a URL that is none."""
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise LanguageError(f"--llm: {_without_user(url)!r} is no http or https URL")
        if parts.username or parts.password or parts.query:
            raise LanguageError("--llm: give the key in the environment, not in the URL")
        return cls(url.rstrip("/"), model, os.environ.get(key_env, ""), timeout, price)

    def ask(
        self,
        messages: Messages,
        name: str,
        schema: dict[str, Any],
        check: Callable[[Any], T],
        temperature: float = 0.0,
    ) -> T:
        """The model's answer, as `check` makes it of the JSON. What it complains of is told to the model.

        With a `temperature` the same question may be answered in several ways. `check` raises ValueError or RpaugError.
        Raises LanguageError when the tries are spent.
        """
        given = [dict(message) for message in messages]
        complaint = ""
        for attempt in range(FEW):
            self.usage.retries += attempt > 0
            stated, cut = self._patiently(self._body(given, name, schema, temperature))
            try:
                if cut:
                    raise ValueError(f"it was cut off after {MOST_TOKENS} tokens; be brief")
                return check(_json(stated))
            except (ValueError, RpaugError) as error:
                complaint = self.hidden(" ".join(str(error).split()))[: 5 * SHOWN]
            given += [
                {"role": "assistant", "content": stated[: 20 * SHOWN]},
                {
                    "role": "user",
                    "content": f"That cannot be used: {complaint}\nAnswer with JSON.",
                },
            ]
        raise LanguageError(
            f"{self.url}: {self.model} gave {FEW} answers that cannot be used; the last: {complaint[: 2 * SHOWN]}"
        )

    def hidden(self, text: str) -> str:
        """The text without the key, wherever it may have come from."""
        return text.replace(self.key, "***") if self.key else text

    def _body(
        self, messages: Messages, name: str, schema: dict[str, Any], temperature: float
    ) -> bytes:
        form = {
            "type": "json_schema",
            "json_schema": {"name": name, "schema": schema, "strict": True},
        }
        body = {
            "model": self.model, "messages": list(messages), "response_format": form,
            "temperature": temperature, "max_tokens": MOST_TOKENS, "stream": False,
        }  # fmt: skip
        return json.dumps(body).encode()

    def _patiently(self, body: bytes) -> tuple[str, bool]:
        """What the model said, and whether it was cut off; a busy server is asked again. Raises LanguageError."""
        for attempt in range(FEW):
            self.usage.requests += 1
            start = time.monotonic()
            try:
                return self._stated(self._posted(body))
            except _Busy as busy:
                wait = busy.wait if busy.wait is not None else 0.5 * 2**attempt
                if attempt == FEW - 1 or wait > LONGEST_WAIT:
                    longer = f" and asks to wait {wait:g} s" if wait > LONGEST_WAIT else ""
                    raise LanguageError(
                        f"{self.url}: {busy}{longer}; asked {attempt + 1} times"
                    ) from None
                self.usage.retries += 1
                time.sleep(wait)
            finally:
                self.usage.seconds += time.monotonic() - start
        raise AssertionError("unreachable")

    def _posted(self, body: bytes) -> bytes:
        """The reply's bytes. Raises LanguageError, or _Busy."""
        parts = urlsplit(self.url)
        headers = {"Content-Type": "application/json", "Accept": "application/json"}
        if self.key:
            headers["Authorization"] = f"Bearer {self.key}"
        late = threading.Event()
        try:
            with _connection(
                parts.scheme, parts.hostname or "", parts.port, self.timeout, late
            ) as connection:
                connection.request("POST", f"{parts.path}/chat/completions", body, headers)
                reply = connection.getresponse()
                data = reply.read(MOST_BYTES + 1)
        except (OSError, http.client.HTTPException, ValueError) as error:
            if late.is_set() or isinstance(error, TimeoutError):
                raise LanguageError(
                    f"{self.url}: no whole answer within {self.timeout:g} s"
                ) from None
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise LanguageError(f"{self.url}: {self.hidden(str(why))[:SHOWN]}") from None
        if late.is_set():
            raise LanguageError(f"{self.url}: no whole answer within {self.timeout:g} s")
        if len(data) > MOST_BYTES:
            raise LanguageError(f"{self.url}: the reply exceeds {MOST_BYTES} bytes")
        if reply.status != 200:
            self._complain(reply.status, reply.getheader("Retry-After"), data)
        return data

    def _complain(self, status: int, wait: str | None, data: bytes) -> None:
        shown = self.hidden(" ".join(data.decode("utf-8", "replace").split()))[:SHOWN]
        if status in BUSY:
            seconds = float(wait) if wait and wait.strip().isdigit() else None
            raise _Busy(f"status {status} ({shown})", seconds)
        if 300 <= status < 400:
            raise LanguageError(
                f"{self.url}: it redirects, which is not followed; give the URL it leads to"
            )
        why = {
            401: "the key is not accepted",
            403: "the key is not allowed this",
            404: "no such path or model",
        }
        raise LanguageError(f"{self.url}: status {status}: {why.get(status, 'refused')} ({shown})")

    def _stated(self, data: bytes) -> tuple[str, bool]:
        """The text of the first choice, and whether it was cut off. Raises LanguageError."""
        try:
            reply = json.loads(data)
            choice = reply["choices"][0]
            stated, cut = choice["message"]["content"], choice.get("finish_reason") == "length"
            used = reply.get("usage") or {}
            self.usage.tokens_in += int(used.get("prompt_tokens") or 0)
            self.usage.tokens_out += int(used.get("completion_tokens") or 0)
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
            shown = self.hidden(data[:SHOWN].decode("utf-8", "replace"))
            raise LanguageError(f"{self.url}: that is no chat completion: {shown!r}") from None
        if not isinstance(stated, str):
            raise LanguageError(f"{self.url}: the model said nothing")
        return stated, cut


@contextlib.contextmanager
def _connection(
    scheme: str, host: str, port: int | None, timeout: float, late: threading.Event
) -> Iterator[http.client.HTTPConnection]:
    """A connection that is cut after `timeout` seconds in all, however slowly bytes trickle; then `late` is set."""
    if scheme == "https":
        context = ssl.create_default_context()
        connection: http.client.HTTPConnection = http.client.HTTPSConnection(
            host, port, timeout=timeout, context=context
        )
    else:
        connection = http.client.HTTPConnection(host, port, timeout=timeout)
    connection.connect()
    opened = connection.sock

    def cut() -> None:
        late.set()
        with contextlib.suppress(OSError):
            opened.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(timeout, cut)
    timer.daemon = True
    timer.start()
    try:
        yield connection
    finally:
        timer.cancel()
        connection.close()


def _json(stated: str) -> Any:
    """The JSON value of a reply. Raises ValueError."""
    try:
        return json.loads(stated)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"not JSON: {error}") from None


def _without_user(url: str) -> str:
    head, at, tail = url.rpartition("@")
    return f"...@{tail}" if at and head else url
