"""A real OpenAI-compatible server (llama.cpp) with a real, very small model: the wire, the schema, the retry.

Its quality is printed and not asserted: 135 million parameters are too few for the task. `make test-llm` runs it.
"""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rpaug.language import answers, schemas
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import History, said_after
from rpaug.language.talk import WishModel
from rpaug.providers.language import Endpoint, LanguageError

FOLDER = os.environ.get("RPAUG_LLM")
pytestmark = [
    pytest.mark.llm,
    pytest.mark.skipif(not FOLDER, reason="make test-llm brings the model"),
]
SERVE = """
import sys, time
sys.path.insert(0, sys.argv[1])
import xllamacpp
params = xllamacpp.CommonParams()
params.model.path, params.n_ctx, params.n_parallel = sys.argv[2], 16384, 1
params.cpuparams.n_threads = 1
server = xllamacpp.Server(params)
print(server.listening_address, flush=True)
time.sleep(3600)
"""
CAMERAS = ("front", "wrist")
WISHES = (
    "raise the front camera 5 cm",
    "move the wrist camera back 1 cm",
    "look from further left",
)


@pytest.fixture(scope="module")
def endpoint() -> Iterator[Endpoint]:
    (model,) = Path(FOLDER or "").rglob("*.gguf")
    server = subprocess.Popen(
        [sys.executable, "-c", SERVE, str(FOLDER), str(model)],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert server.stdout
        url = next(line.strip() for line in server.stdout if line.startswith("http"))
        yield Endpoint(f"{url}/v1", "smollm2-135m", timeout=400)
    finally:
        server.kill()
        server.wait()


def test_its_answers_come_to_recipes_or_end_in_words(endpoint: Endpoint) -> None:
    setting, right = WishContext(cameras=CAMERAS), 0
    for wish in WISHES:
        try:
            found = WishModel(endpoint)(History(), wish, setting).edits
            right += found == said_after(wish, (), setting).edits
            print(f"{wish}: {found}")
        except (NotUnderstood, LanguageError) as error:
            print(f"{wish}: {error}")
    print(f"right: {right} of {len(WISHES)}; {endpoint.usage.describe(None)}")
    assert endpoint.usage.tokens_out > 0


def test_a_complaint_is_told_and_answered(endpoint: Endpoint) -> None:
    asked = []

    def check(value: object) -> object:
        asked.append(value)
        if len(asked) == 1:
            raise ValueError('the camera moves up, so "up" is more than 0')
        return answers.valid(answers.Viewpoint, value)

    before = endpoint.usage.requests
    schema = schemas.plain(answers.Viewpoint.model_json_schema())
    messages = [{"role": "user", "content": f"As JSON, a camera's motion: {WISHES[0]}"}]
    with contextlib.suppress(LanguageError):  # it may insist on what it said; that ends, too
        endpoint.ask(messages, "viewpoint", schema, check)
    assert 2 <= endpoint.usage.requests - before <= 3
