"""Any OpenAI-compatible server works: four documented shapes, and no reply gives a traceback or half an answer."""

import email.utils
import json
import time
from functools import partial
from typing import Any

import pytest
from endpoints import KEY, Handler, completion, served
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from server_shapes import SHAPES, refuse, reply

from rpaug.language import answers, schemas
from rpaug.language.messages import WishContext
from rpaug.providers import negotiation, replies
from rpaug.providers.language import Endpoint, LanguageError

ASK = [{"role": "system", "content": "You edit."}, {"role": "user", "content": "the cup in blue"}]
WISH = schemas.of_wish(("front",))
RECOLOR = {"op": "recolor", "target": "cup", "color": "blue"}
EDIT = {"said": "the cup in blue", "probability": None, "options": [RECOLOR]}
ANSWER = {"refuse": "", "drop": [], "edits": [EDIT], "settings": None, "notes": []}
STEPS = [{"said": "the cup in blue", "op": "recolor"}]
PLAN = {"steps": STEPS, "drop": [], "settings": None, "refuse": ""}


def edits(endpoint: Endpoint) -> list[Any]:
    def check(value: Any) -> list[Any]:
        found = answers.understood(value, "the cup in blue", 0)
        return [answers.entry(one, "the cup in blue", WishContext()) for one in found.edits]

    return endpoint.ask(ASK, "wish", WISH, check)


def plan(endpoint: Endpoint) -> Any:
    check = partial(answers.planned, stated="the cup in blue", earlier=0)
    return endpoint.ask(ASK, "plan", schemas.of_plan(), check)


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_of_server_gives_whole_edits(shape: str) -> None:
    stated: list[Any] = [ANSWER]
    play = lambda h, n: SHAPES[shape](h, h.server.seen[-1][1], stated[0])  # noqa: E731
    with served(play) as (endpoint, seen):
        assert edits(endpoint) == [RECOLOR]
        first = len(seen)
        stated[0] = PLAN
        assert plan(endpoint).steps[0].op == "recolor"
        once = 2 if shape == "ollama" else 1  # that one takes no notice of the schema, and is told
        assert len(seen) - first == once  # how it wants to be asked is known
        assert first <= 5


def test_openai_takes_what_it_is_asked_after_two_refusals() -> None:
    with served(lambda h, n: SHAPES["openai"](h, h.server.seen[-1][1], ANSWER)) as (endpoint, seen):
        edits(endpoint)
    bodies = [body for _, body in seen]
    assert [("max_tokens" in body, "temperature" in body) for body in bodies] == [
        (True, True), (False, True), (False, False),
    ]  # fmt: skip
    assert bodies[-1]["max_completion_tokens"] > 0
    assert bodies[-1]["response_format"]["json_schema"]["strict"] is True


@pytest.mark.parametrize("status", [400, 422])
def test_a_refusal_that_names_nothing_ends_in_a_bare_question(status: int) -> None:
    def play(handler: Handler, n: int) -> None:
        body = handler.server.seen[-1][1]  # type: ignore[attr-defined]
        if set(body) - {"model", "messages", "stream"}:
            refuse(handler, status, {"detail": "bad request"})
        else:
            reply(handler, {"content": json.dumps(ANSWER)})

    with served(play) as (endpoint, seen):
        assert edits(endpoint) == [RECOLOR]
        assert edits(endpoint) == [RECOLOR]
    assert len(seen) == 3
    assert "JSON schema" in seen[1][1]["messages"][0]["content"]


def test_a_server_that_refuses_everything_is_given_up() -> None:
    words = {"error": {"message": "response_format, temperature, max_tokens, tools: no"}}
    with served(lambda h, n: refuse(h, 400, words)) as (endpoint, seen):
        with pytest.raises(LanguageError, match="max_tokens, tools: no"):
            edits(endpoint)
        assert len(seen) <= 8
        assert not [one for one in negotiation.TAKEN if one[0] == endpoint.url]


def test_a_refusal_of_what_was_not_sent_is_about_something_else() -> None:
    without = negotiation.Way(temperature=False)
    assert without.otherwise("temperature: out of range") is None
    bare = negotiation.Way(negotiation.FORMS[-1], negotiation.LIMITS[-1], False)
    assert without.otherwise("bad request") == bare
    assert bare.otherwise("bad request") is None


TEXT = json.dumps(ANSWER)


@pytest.mark.parametrize(
    "message",
    [
        {"content": f"\n {TEXT} \n"},
        {"content": [{"type": "text", "text": TEXT[:20]}, {"type": "text", "text": TEXT[20:]}]},
        {"content": ANSWER},
        {"content": f"Okay, {{thinking}}.</think>{TEXT}"},
        {"content": f"[THINK]{{[/THINK]Here: {TEXT}. Done."},
        {"content": f"<|channel|>analysis<|message|>{{<|end|><|channel|>final<|message|>{TEXT}"},
        {"content": f"```\n{TEXT}\n```"},
        {"content": "", "tool_calls": [{"function": {"name": "edits", "arguments": ANSWER}}]},
        {"content": None, "function_call": {"name": "edits", "arguments": TEXT}},
    ],
)
def test_json_is_found_wherever_it_stands(message: dict[str, Any]) -> None:
    with served(lambda h, n: reply(h, message)) as (endpoint, seen):
        assert edits(endpoint) == [RECOLOR]
        assert len(seen) == 1


@pytest.mark.parametrize(
    "text",
    [
        TEXT[:-1], TEXT[:-3], f"```json\n{TEXT[:-2]}", f"<think>{TEXT}", f"First {TEXT}, or {TEXT}",
        f"```\n{TEXT}\n```\n```\n{TEXT}\n```", '{"a": NaN}', '{"a": 1e999}', '{"a": 1, "a": 2}',
        '{"a": "\\ud800"}', "[" * 5000, "1" * 5000, "",
    ],
)  # fmt: skip
def test_half_a_value_is_none(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        replies.parsed(text)


@pytest.mark.parametrize(
    ("message", "more"),
    [
        ({"content": None, "refusal": "I will not paint cups."}, {}),
        ({"content": [{"type": "refusal", "refusal": "I will not paint cups."}]}, {}),
        ({"content": TEXT[:30]}, {"finish_reason": "content_filter"}),
    ],
)
def test_a_refusal_is_shown(message: dict[str, Any], more: dict[str, Any]) -> None:
    with served(lambda h, n: reply(h, message, **more)) as (endpoint, seen):
        with pytest.raises(
            LanguageError, match=r"refuses: (I will not paint cups|a content filter)"
        ):
            edits(endpoint)
        assert len(seen) == 1


def test_an_answer_that_was_cut_off_gets_more_room() -> None:
    def play(handler: Handler, n: int) -> None:
        if handler.server.seen[-1][1]["max_tokens"] < 5000:  # type: ignore[attr-defined]
            reply(handler, {"content": None, "reasoning": "Hm"}, finish_reason="length")
        else:
            reply(handler, {"content": TEXT})

    with served(play) as (endpoint, _):
        assert edits(endpoint) == [RECOLOR]


def test_an_error_inside_a_good_status_is_one() -> None:
    words = {"error": {"code": 401, "message": f"no such user: {KEY}"}}
    with served(lambda h, n: refuse(h, 200, words)) as (endpoint, _):
        with pytest.raises(LanguageError, match="the key is not accepted") as caught:
            edits(endpoint)
        assert KEY not in str(caught.value)


def test_the_key_that_a_server_echoes_is_in_no_answer() -> None:
    spelled = KEY.replace("v", "\\u0076")
    with served(lambda h, n: h.answer(completion(f'{{"a": ["{spelled}"], "{KEY}": 1}}'))) as (
        endpoint,
        _,
    ):
        assert endpoint.ask(ASK, "x", {}, lambda value: value) == {"a": ["***"], "***": 1}


@pytest.mark.parametrize(
    ("headers", "seconds"),
    [
        ({"retry-after": "0.25"}, 0.25),
        ({"retry-after": "3"}, 3),
        ({"retry-after-ms": "1500", "retry-after": "9"}, 1.5),
        ({"retry-after": "Wed, 21 Oct 2015 07:28:00 GMT"}, 0),
    ],
)
def test_waits_are_read_in_every_form(headers: dict[str, str], seconds: float) -> None:
    assert replies.wait(headers) == seconds
    later = email.utils.formatdate(time.time() + 1000, usegmt=True)
    assert 500 < (replies.wait({"retry-after": later}) or 0) <= 1000


@pytest.mark.parametrize("stated", ["", "soon", "-1", "nan", "inf", "1e9", "٣", "Mon, 99 Foo 2026"])
def test_a_wait_that_is_none_is_none(stated: str) -> None:
    assert replies.wait({"retry-after": stated}) is None


NAMES = [
    "choices", "message", "content", "error", "code", "detail", "param", "tool_calls", "function", "arguments",
    "finish_reason", "usage", "prompt_tokens", "refusal", "text", "type", "edits", "said", "options", "op", "target",
    "color",
]  # fmt: skip
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9)
    | st.sampled_from(["recolor", "cup", "blue", ANSWER, EDIT, TEXT, TEXT[:-4], KEY]),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(NAMES), inner, max_size=4),
    max_leaves=12,
)  # fmt: skip


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(value=VALUES, wrapped=st.sampled_from(["no", "content", "text"]))
def test_whatever_is_said_is_edits_or_a_line(value: Any, wrapped: str) -> None:
    """A completion, an error or an answer of any shape: whole valid edits, or LanguageError."""
    endpoint = Endpoint("http://host/v1", "small", KEY)
    if wrapped != "no":
        said = json.dumps(value) if wrapped == "text" else value
        value = {"choices": [{"message": {"content": said}}]}
    data = json.dumps(value).encode()
    endpoint.__dict__["_posted"] = lambda body: endpoint._opened(200, {}, data)
    found, line = [], ""
    try:
        found = edits(endpoint)
    except LanguageError as error:
        line = str(error)
    assert KEY not in line
    assert not (line and found)
    assert all(edit["op"] == "recolor" for edit in found)
