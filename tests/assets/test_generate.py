"""A generator is asked by command or over HTTP; what is dead, slow or lying is told as such, and nothing joins."""

import http.server
import json
import sys
import threading
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from rpaug.assets import generate, library
from rpaug.cli import app
from rpaug.core.errors import BadInput, RpaugError, Unsupported
from rpaug.core.types import Gaussians
from rpaug.gaussians import ply

WISH = generate.GenerationRequest("a grey ball")


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(library.FOLDER, str(tmp_path / "assets"))


@pytest.fixture(scope="module")
def made():
    rng = np.random.default_rng(0)
    way = rng.normal(size=(200, 3))
    means = 0.04 * way / np.linalg.norm(way, axis=1, keepdims=True)
    ball = Gaussians(
        means.astype(np.float32), np.tile(np.float32([1, 0, 0, 0]), (200, 1)),
        np.full((200, 3), 0.005, np.float32), np.full(200, 0.9, np.float32), np.zeros((200, 4, 3), np.float32),
        np.zeros(200, np.int32),
    )  # fmt: skip
    return ply.encoded(ball)


def program(folder, body):
    script = folder / "model.py"
    script.write_text(f"import sys, time\nout, text = sys.argv[1:3]\n{body}\n")
    return f"{sys.executable} {script} {{out}} {{text}}"


@pytest.fixture
def endpoint():
    """Starts a server that answers with what it is given: a function on the request's handler."""
    servers = []

    def start(answer):
        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                self.asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                answer(self)

            def log_message(self, *_):
                pass

        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        servers.append(server)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{server.server_port}/make"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def send(data, promised=None, code=200, pause=0.0, parts=1):
    def answer(handler):
        handler.send_response(code)
        handler.send_header("Content-Length", str(len(data) if promised is None else promised))
        handler.end_headers()
        try:
            for part in np.array_split(np.frombuffer(data, np.uint8), parts):
                handler.wfile.write(part.tobytes())
                handler.wfile.flush()
                time.sleep(pause)
        except OSError:
            pass  # whoever asked has gone

    return answer


def test_a_command_makes_a_thing_that_joins_with_its_provenance(tmp_path, made):
    (tmp_path / "ball.ply").write_bytes(made)
    copy = f"open(out, 'wb').write(open({str(tmp_path / 'ball.ply')!r}, 'rb').read())"
    command = program(tmp_path, copy)
    words = ["assets", "generate", "ball_grey", "--text", "a grey ball", "--command", command]
    done = CliRunner().invoke(app, [*words, "--category", "ball", "--json"])
    assert done.exit_code == 0, done.output
    asset = library.get("ball_grey")
    assert asset.gaussians == 200
    assert asset.source == "generated"
    assert asset.provenance["text"] == "a grey ball"
    assert asset.provenance["made by"] == command
    assert len(asset.provenance["sha256"]) == 64
    assert library.gaussians("ball_grey").sh.shape == (200, 4, 3)
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 2
    assert "a name that is free" in again.output


def test_words_are_not_seen_by_a_shell_nor_filled_twice(tmp_path):
    command = program(tmp_path, "open(out, 'w').write(text)")
    wish = generate.GenerationRequest("a {out} $(touch x); 'quoted'")
    assert generate.by_command(command, wish).decode() == wish.text


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("raise SystemExit('no weights found')", "ended with code 1: no weights found"),
        ("pass", "wrote no {out}"),
        ("time.sleep(30)", "took longer than 0.5 s"),
        ("open(out, 'wb').write(bytes(5000))", "5000 bytes, and 4000 are allowed"),
    ],
)
def test_a_command_that_fails_is_told(tmp_path, body, says):
    start = time.monotonic()
    limits = generate.Limits(0.5 if "sleep" in body else 20, 4000)
    with pytest.raises(Unsupported, match=says):
        generate.by_command(program(tmp_path, body), WISH, limits)
    assert time.monotonic() - start < 20


def test_a_program_that_is_not_there_is_told():
    with pytest.raises(Unsupported, match="cannot be started"):
        generate.by_command("no-such-program {out}", WISH)
    with pytest.raises(RpaugError, match="name where the"):
        generate.by_command("true", WISH)
    with pytest.raises(RpaugError, match=r"it takes \{image\}"):
        generate.by_command("true {image} {out}", WISH)


def test_an_endpoint_gets_the_wish_and_answers_with_gaussians(endpoint, made):
    asked = []

    def answer(handler):
        asked.append(handler.asked)
        send(made)(handler)

    address = endpoint(answer)
    asset = generate.keep(generate.by_endpoint(address, WISH), "ball", WISH, address)
    assert asked == [{"text": "a grey ball", "image": None}]
    assert asset.gaussians == 200
    assert asset.size == pytest.approx((0.09, 0.09, 0.09), abs=0.02)


def test_an_endpoint_that_fails_is_told(endpoint, made):
    limits = generate.Limits(1.0, 2 * len(made))
    for answer, says in (
        (send(b"out of memory", code=500), "answered 500 .*out of memory"),
        (send(made, promised=len(made) + 100), r"sent \d+ bytes and had promised|took longer"),
        (send(3 * made), "bytes, and"),
        (send(made, pause=0.3, parts=40), "took longer than 1 s"),
        (lambda handler: time.sleep(3), "took longer than 1 s"),
        (lambda handler: handler.wfile.write(b"not HTTP\r\n\r\n"), "broken answer|no answer"),
    ):
        with pytest.raises(Unsupported, match=says):
            generate.by_endpoint(endpoint(answer), WISH, limits)
    with pytest.raises(Unsupported, match="no answer"):
        generate.by_endpoint("http://127.0.0.1:9/make", WISH, limits)
    with pytest.raises(RpaugError, match="begins with http"):
        generate.by_endpoint("file:///etc/passwd", WISH)


@pytest.mark.parametrize("kind", ["cut", "foreign", "nan", "mesh", "empty", "huge"])
def test_what_is_no_thing_does_not_join(made, kind):
    header = made.index(b"end_header\n") + len(b"end_header\n")
    broken = bytearray(made)
    broken[header : header + 4] = np.float32("nan").tobytes()
    faint = made.replace(b"element vertex 200", b"element vertex 0")[: header - 2]
    wrong = {
        "cut": made[:-7],
        "foreign": b"<html>sorry</html>",
        "nan": bytes(broken),
        "mesh": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n.1 0 0\n0 .1 0\n3 0 1 2\n",
        "empty": faint,
        "huge": made,
    }[kind]
    with pytest.raises(BadInput, match=r"the-model: "):
        generate.keep(wrong, "thing", WISH, "the-model", scale=1e4 if kind == "huge" else 1.0)
    assert "thing" not in {asset.name for asset in library.assets()}


def test_nothing_to_make_is_told(tmp_path):
    with pytest.raises(RpaugError, match="--text or --image"):
        generate.GenerationRequest().check()
    (tmp_path / "x.png").write_bytes(b"no picture")
    with pytest.raises(BadInput, match="PNG"):
        generate.GenerationRequest(image=tmp_path / "x.png").check()
    done = CliRunner().invoke(app, ["assets", "generate", "x", "--text", "y"])
    assert done.exit_code == 2
