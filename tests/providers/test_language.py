"""An endpoint that is dead, slow, lying, busy or too talkative is an error in words, never a hang; keys stay secret."""

import json
import time
from collections.abc import Callable
from typing import Any

import pytest
from endpoints import KEY, Handler, completion, served

from rpaug.providers.language import MOST_BYTES, Endpoint, LanguageError

ASK = [{"role": "user", "content": "say something"}]


def number(value: Any) -> int:
    if not isinstance(value, dict) or not isinstance(value.get("n"), int):
        raise ValueError("expected a whole number n")
    return value["n"]


def ask(endpoint: Endpoint) -> int:
    return endpoint.ask(ASK, "number", {"type": "object"}, number)


def test_wire_format_tokens_and_cost() -> None:
    play = lambda h, n: h.answer(completion('{"n": 3}', prompt_tokens=100, completion_tokens=7))  # noqa: E731
    with served(play) as (endpoint, seen):
        assert ask(endpoint) == 3
    headers, body = seen[0]
    assert headers["Authorization"] == f"Bearer {KEY}"
    assert body["model"] == "small"
    assert body["temperature"] == 0
    form = body["response_format"]
    assert (form["type"], form["json_schema"]["name"]) == ("json_schema", "number")
    assert form["json_schema"]["schema"] == {"type": "object"}
    used = endpoint.usage.describe(endpoint.price)
    assert (used["requests"], used["tokens_in"], used["tokens_out"]) == (1, 100, 7)
    assert used["cost"] == pytest.approx((100 * 1.0 + 7 * 2.0) / 1e6)
    assert KEY not in repr(endpoint)


def test_a_wrong_answer_is_complained_of_and_asked_again() -> None:
    answers = ["no json at all", '{"n": "three"}', '{"n": 4}']
    with served(lambda h, n: h.answer(completion(answers[n - 1]))) as (endpoint, seen):
        assert ask(endpoint) == 4
    given = seen[2][1]["messages"]
    assert [one["role"] for one in given] == ["user", "assistant", "user", "assistant", "user"]
    assert "not JSON" in given[2]["content"]
    assert "expected a whole number n" in given[4]["content"]
    assert endpoint.usage.retries == 2


def test_an_answer_that_was_cut_off_is_no_answer() -> None:
    cut = json.dumps(
        {"choices": [{"message": {"content": '{"n": 1}'}, "finish_reason": "length"}]}
    ).encode()
    with served(lambda h, n: h.answer(cut if n == 1 else completion('{"n": 12}'))) as (endpoint, _):
        assert ask(endpoint) == 12


@pytest.mark.parametrize(
    "content", ["{", "[1, 2", '{"n": null}', "[" * 50_000, "", '{"n": true, "n": 1.5}']
)
def test_a_liar_is_given_up(content: str) -> None:
    with served(lambda h, n: h.answer(completion(content))) as (endpoint, seen):
        with pytest.raises(LanguageError, match="answers that cannot be used"):
            ask(endpoint)
        assert len(seen) == 3


@pytest.mark.parametrize(
    "data",
    [
        b"<html>hello</html>",
        b"{}",
        b'{"choices": []}',
        b"\xff\xfe",
        b"[" * 10_000,
        completion(None),
    ],
)
def test_what_is_no_completion_is_an_error(data: bytes) -> None:
    with served(lambda h, n: h.answer(data)) as (endpoint, _), pytest.raises(LanguageError):
        ask(endpoint)


def test_a_dead_endpoint_is_an_error() -> None:
    with served(lambda h, n: None) as (endpoint, _):
        pass
    with pytest.raises(LanguageError, match=r"127\.0\.0\.1"):
        ask(endpoint)


def silent(handler: Handler, n: int) -> None:
    time.sleep(20)


def trickling(handler: Handler, n: int) -> None:
    handler.send_response(200)
    handler.send_header("Content-Length", "100000")
    handler.end_headers()
    for _ in range(100):
        handler.wfile.write(b" ")
        time.sleep(0.2)


def trickling_head(handler: Handler, n: int) -> None:
    for letter in b"HTTP/1.1 200 OK\r\nX-A: " + b"b" * 100:
        handler.wfile.write(bytes([letter]))
        time.sleep(0.2)


@pytest.mark.parametrize("play", [silent, trickling, trickling_head])
def test_a_slow_endpoint_is_cut(play: Callable[[Handler, int], None]) -> None:
    start = time.monotonic()
    with (
        served(play, timeout=0.8) as (endpoint, _),
        pytest.raises(LanguageError, match=r"within 0\.8 s"),
    ):
        ask(endpoint)
    assert time.monotonic() - start < 15  # it would trickle on for 20


def test_a_huge_reply_is_cut() -> None:
    def play(handler: Handler, n: int) -> None:
        handler.send_response(200)
        handler.end_headers()
        try:
            for _ in range(400):
                handler.wfile.write(b"x" * 2**16)
        except OSError:
            pass

    with served(play) as (endpoint, _), pytest.raises(LanguageError, match=str(MOST_BYTES)):
        ask(endpoint)


def test_a_rate_limit_is_waited_for() -> None:
    def play(handler: Handler, n: int) -> None:
        if n == 1:
            handler.answer(b"slow down", 429, Retry_After="0")
        else:
            handler.answer(completion('{"n": 1}'))

    with served(play) as (endpoint, seen):
        assert ask(endpoint) == 1
        assert len(seen) == 2


def test_a_long_rate_limit_and_a_broken_server_are_errors() -> None:
    with served(lambda h, n: h.answer(b"", 429, Retry_After="3600")) as (endpoint, seen):
        with pytest.raises(LanguageError, match="asks to wait 3600 s"):
            ask(endpoint)
        assert len(seen) == 1
    with served(lambda h, n: h.answer(b"", 503, Retry_After="0")) as (endpoint, seen):
        with pytest.raises(LanguageError, match="asked 3 times"):
            ask(endpoint)
        assert len(seen) == 3


@pytest.mark.parametrize("status", [301, 400, 401, 403, 404])
def test_the_key_is_in_no_message(status: int) -> None:
    echo = f"bad key {KEY}".encode()
    with served(lambda h, n: h.answer(echo, status, Location="http://elsewhere/")) as (
        endpoint,
        seen,
    ):
        with pytest.raises(LanguageError) as caught:
            ask(endpoint)
        assert len(seen) == (2 if status == 400 else 1)  # once more with all left out that may be
    assert KEY not in str(caught.value)


def test_the_key_is_not_repeated_by_a_model() -> None:
    def check(value: Any) -> int:
        raise ValueError(f"{value} is wrong")

    with served(lambda h, n: h.answer(completion(json.dumps(KEY)))) as (endpoint, seen):
        with pytest.raises(LanguageError) as caught:
            endpoint.ask(ASK, "x", {}, check)
        assert KEY not in str(caught.value)
        assert KEY not in seen[1][1]["messages"][2]["content"]


@pytest.mark.parametrize(
    "url",
    [
        "ftp://host/v1",
        "host:80",
        "http://me:secret@host/v1",
        "https://host/v1?key=secret",
        "",
        "http://",
    ],
)
def test_a_url_that_holds_a_key_or_is_none_is_refused(url: str) -> None:
    with pytest.raises(LanguageError) as caught:
        Endpoint.of(url, "small")
    assert "secret" not in str(caught.value)


def test_the_key_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_KEY", KEY)
    assert Endpoint.of("http://host/v1/", "small", key_env="MY_KEY").key == KEY
