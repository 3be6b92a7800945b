"""Language models behind any OpenAI-compatible endpoint: bounded in time, size and tries, and silent about the key.

Only `POST {url}/chat/completions` is used. How a server wants to be asked is found out (`rpaug.providers.negotiation`).
What comes back is checked by the caller; its complaint is told to the model, a bounded number of times. Redirects are
not followed: they could carry the key elsewhere.
"""

import contextlib
import http.client
import json
import os
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import urlsplit

from rpaug.core.errors import RpaugError
from rpaug.providers import negotiation, replies, strict_schema
from rpaug.providers.negotiation import Messages

MOST_BYTES = 2**20  # of one reply
MOST_TOKENS = 2048  # asked for in one reply; four times as many after one that was cut off
LONGEST_WAIT = 10.0  # seconds that a rate limit may ask for before it is an error
FEW = 3  # tries of one question, of each kind: answers that are wrong, and servers that are busy
BUSY = (408, 429, 500, 502, 503, 504)
SHOWN = 200  # characters of what a server said, in an error
STUMBLES = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)
"""What a caller's check may raise of an answer that it did not reckon with."""

T = TypeVar("T")


class LanguageError(RpaugError):
    """The endpoint gave no usable answer; the message says which endpoint and why."""


class _Busy(Exception):
    """The server asks to be left alone for some seconds."""

    def __init__(self, why: str, wait: float | None) -> None:
        super().__init__(why)
        self.wait = wait


class _Declined(Exception):
    """The server does not take the request; `words` are its own, without the key."""

    def __init__(self, why: str, words: str) -> None:
        super().__init__(why)
        self.words = words


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
        key: str | None = None,
        timeout: float = 60.0,
        price: tuple[float, float] | None = None,
    ) -> "Endpoint":
        """An endpoint with the key that is in the environment, if any.

        Raises LanguageError for a URL that is none, and for a key that stands in URL or model or that no header takes.
        """
        try:
            parts = urlsplit(url)
            sound = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
        except ValueError:
            sound = False
        if not sound:
            raise LanguageError(f"--llm: {_without_user(url)!r} is no http or https URL")
        key = os.environ.get(key_env, "").strip() if key is None else key.strip()
        if not (key.isascii() and key.isprintable()):
            raise LanguageError("the endpoint's key has characters that no HTTP header may have")
        if parts.username or parts.password or parts.query or (key and key in url + model):
            raise LanguageError("--llm: give the key in the environment, not in the URL")
        return cls(url.rstrip("/"), model, key, timeout, price)

    def ask(
        self,
        messages: Messages,
        name: str,
        schema: dict[str, Any],
        check: Callable[[Any], T],
        temperature: float = 0.0,
    ) -> T:
        """The model's answer, as `check` makes it of the JSON. What it complains of is told to the model.

        A property that `schema` does not require is left out of what `check` is given where the model says null. The
        key, should the model repeat it, is stars. With a `temperature` the same question may be answered in several
        ways. Raises LanguageError when the tries are spent, and with the model's words when it refuses to answer.
        """
        given = [dict(message) for message in messages]
        complaint, tokens = "", MOST_TOKENS
        for attempt in range(FEW):
            self.usage.retries += attempt > 0
            reply = self._reply(given, name, schema, temperature, tokens)
            if reply.refusal:
                shown = self.hidden(" ".join(reply.refusal.split()))[: 2 * SHOWN]
                raise LanguageError(f"{self.url}: {self.model} refuses: {shown}")
            try:
                if reply.cut:
                    tokens *= 4
                    raise ValueError("it was cut off; be brief")
                value = strict_schema.answered(replies.parsed(reply.text), schema)
                return check(json.loads(self.hidden(json.dumps(value, ensure_ascii=False))))
            except (RpaugError, *STUMBLES) as error:
                complaint = self.hidden(" ".join(str(error).split()))[: 5 * SHOWN]
            # A server may have taken no notice of the schema: the first complaint tells it in words.
            wanted = "Answer with JSON." if attempt else negotiation.wanted(schema)
            said = self.hidden(reply.text)[: 20 * SHOWN] or "(nothing)"
            given += [
                {"role": "assistant", "content": said},
                {"role": "user", "content": f"That cannot be used: {complaint}\n{wanted}"},
            ]
        raise LanguageError(
            f"{self.url}: {self.model} gave {FEW} answers that cannot be used; the last: {complaint[: 2 * SHOWN]}"
        )

    def hidden(self, text: str) -> str:
        """The text without the key, wherever it may have come from."""
        for key in filter(None, {self.key, json.dumps(self.key)[1:-1]}):
            text = text.replace(key, "***")
        return text

    def _reply(
        self,
        messages: Messages,
        name: str,
        schema: dict[str, Any],
        temperature: float,
        tokens: int,
    ) -> replies.Reply:
        """What the model said, asked in the way that the server takes. Raises LanguageError."""
        server = (self.url, self.model)
        way = negotiation.TAKEN.get(server, negotiation.Way())
        while True:
            body = way.body(self.model, messages, name, schema, temperature, tokens)
            try:
                reply = self._patiently(json.dumps(body).encode())
            except _Declined as declined:
                other = way.otherwise(declined.words)
                if other is None:
                    raise LanguageError(f"{self.url}: {declined}") from None
                way = other
                self.usage.retries += 1
                continue
            negotiation.TAKEN[server] = way
            self.usage.tokens_in += reply.tokens[0]
            self.usage.tokens_out += reply.tokens[1]
            return reply

    def _patiently(self, body: bytes) -> replies.Reply:
        """The completion; a busy server is asked again. Raises LanguageError, or _Declined."""
        for attempt in range(FEW):
            self.usage.requests += 1
            start = time.monotonic()
            try:
                return self._posted(body)
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

    def _posted(self, body: bytes) -> replies.Reply:
        """The completion. Raises LanguageError, _Busy, or _Declined."""
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
        headers = {name.lower(): value for name, value in reply.getheaders()}
        return self._opened(reply.status, headers, data)

    def _opened(self, status: int, headers: Mapping[str, str], data: bytes) -> replies.Reply:
        """The completion in a reply that is no error, wherever it says so."""
        try:
            value = json.loads(data)
        except (ValueError, RecursionError):
            value = None
        text = data.decode("utf-8", "replace")
        inner = replies.error(value)
        if status == 200 and inner is not None:
            status = inner[0] or 400
        if status != 200:
            self._complain(status, replies.wait(headers), inner[1] if inner else text)
        try:
            return replies.read(value)
        except ValueError:
            shown = self.hidden(text)[:SHOWN]
            raise LanguageError(f"{self.url}: that is no chat completion: {shown!r}") from None

    def _complain(self, status: int, wait: float | None, words: str) -> None:
        words = self.hidden(" ".join(words.split()))
        shown = words[:SHOWN]
        if 300 <= status < 400:
            raise LanguageError(
                f"{self.url}: it redirects, which is not followed; give the URL it leads to"
            )
        # Some servers (llama.cpp) answer 500 to a parameter that they do not take, some gateways 404.
        named = status not in (401, 403, 408, 429) and negotiation.NAMED.search(words)
        if status in BUSY and not named:
            raise _Busy(f"status {status} ({shown})", wait)
        why = {
            401: "the key is not accepted",
            403: "the key is not allowed this",
            404: "no such path or model; most servers' URLs end in /v1",
        }
        fault = f"status {status}: {why.get(status, 'refused')} ({shown})"
        if named or status in (400, 422):
            raise _Declined(fault, words)
        raise LanguageError(f"{self.url}: {fault}")


@contextlib.contextmanager
def _connection(
    scheme: str, host: str, port: int | None, timeout: float, late: threading.Event
) -> Iterator[http.client.HTTPConnection]:
    """A connection that is cut after `timeout` seconds in all, however slowly bytes trickle; then `late` is set."""
    secure = scheme == "https"
    connection = http.client.HTTPConnection(host, port or (443 if secure else 80), timeout=timeout)
    opened = socket.create_connection((connection.host, connection.port), timeout)

    def cut() -> None:
        late.set()
        with contextlib.suppress(OSError):
            opened.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(timeout, cut)
    timer.daemon = True
    timer.start()
    connection.sock = opened
    try:
        if secure:
            opened = connection.sock = ssl.create_default_context().wrap_socket(
                opened, server_hostname=host, do_handshake_on_connect=False
            )
            opened.do_handshake()  # only now: it may be cut like all that follows
        yield connection
    finally:
        timer.cancel()
        connection.close()


def _without_user(url: str) -> str:
    head, at, tail = url.rpartition("@")
    return f"...@{tail}" if at and head else url
