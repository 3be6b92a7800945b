"""A real OpenAI-compatible server (llama.cpp) with a real, very small model: the wire, the schema, the retry.

Its quality is printed and not asserted: 135 million parameters are too few for the task. `make test-llm` runs it.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rpaug.language import answers, schemas
from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.prompting import prompt
from rpaug.language.rounds import said_after
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
params.model.path, params.n_ctx, params.n_parallel = sys.argv[2], 4096, 1
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


def question(wish: str) -> list[dict[str, str]]:
    return prompt("renderer").messages(f'{{"step": "{wish}", "cameras": ["front", "wrist"]}}')


def test_its_json_always_fits_the_schema(endpoint: Endpoint) -> None:
    schema, right = schemas.plain(schemas.of_viewpoint(CAMERAS)), 0
    for wish in WISHES:
        found = endpoint.ask(question(wish), "viewpoint", schema, answers.Viewpoint.model_validate)
        wanted = said_after(wish, (), WishContext(cameras=CAMERAS)).edits
        right += found.edit() == wanted[0]
        print(f"{wish}: {found.edit()}")
    print(f"right: {right} of {len(WISHES)}; {endpoint.usage.describe(None)}")
    assert endpoint.usage.retries == 0


def test_a_complaint_is_told_and_answered(endpoint: Endpoint) -> None:
    asked = []

    def check(value: object) -> answers.Viewpoint:
        asked.append(value)
        if len(asked) == 1:
            raise ValueError('the camera moves up, so "up" is more than 0')
        return answers.viewpoint(value, CAMERAS)

    before = endpoint.usage.requests
    try:
        endpoint.ask(
            question(WISHES[0]),
            "viewpoint",
            schemas.plain(schemas.of_viewpoint(CAMERAS)),
            check,
        )
    except LanguageError as error:  # it may insist on a camera that there is not; that ends, too
        print(error)
    assert 2 <= endpoint.usage.requests - before <= 3


def test_what_it_cannot_do_ends_in_words(endpoint: Endpoint) -> None:
    from rpaug.language.rounds import History
    from rpaug.language.talk import WishModel

    try:
        answer = WishModel(endpoint)(
            History(), "raise the front camera 5 cm", WishContext(cameras=CAMERAS)
        )
        print(answer.edits, answer.notes)
    except (NotUnderstood, LanguageError) as error:
        print(error)
