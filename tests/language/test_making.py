"""What the library lacks is made by a generator where one is named, joins the library, and is in the recipe."""

import http.server
import json
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import little_generator
import pytest
from tabletop import gl, scene, take
from typer.testing import CliRunner

from rpaug.assets import library
from rpaug.cli import app
from rpaug.language import asking
from rpaug.language.making import Maker, NotMade
from rpaug.language.messages import NotUnderstood, WishContext

COMMAND = f"{sys.executable} {little_generator.__file__} {{out}} {{text}}"
SETTING = WishContext(cameras=("front",))


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(library.FOLDER, str(tmp_path / "assets"))


@pytest.fixture
def address() -> Iterator[str]:
    """A generator behind HTTP."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            data = little_generator.ball(asked["text"])
            self.send_response(200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_: object) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/make"
    server.shutdown()
    server.server_close()


def ask(wish: str, who: str | None, **more: object) -> asking.AskResult:
    return asking.ask(wish, SETTING, maker=Maker(who) if who else None, **more)  # type: ignore[arg-type]


def test_without_a_generator_it_says_what_is_missing() -> None:
    with pytest.raises(NotUnderstood, match=r"no 'beach ball'.*assets add.*--generator"):
        ask("put a blue beach ball on the table", None)


def test_a_command_makes_what_the_library_lacks() -> None:
    asked = ask("put two blue marbles near the cup and add a red mug", COMMAND)
    name = "made_marble_blue"
    assert asked.recipe["edits"] == [
        {"op": "insert", "asset": name, "near": "cup"},
        {"op": "insert", "asset": name, "near": "cup"},
        {"op": "insert", "category": "mug", "color": "red"},
    ]
    made = library.get(name)
    assert (made.category, made.gaussians, made.source) == ("marble", 300, "generated")
    assert made.color == "blue"
    assert made.provenance["text"] == "a blue marble"
    done = [one.output["made"] for one in asked.trace if one.stage == "assets" and one.prompt]
    assert done == [True, False]  # once for both
    again = ask("add a blue marble", "no-such-program {out} {text}")
    assert again.recipe["edits"] == [{"op": "insert", "category": "marble", "color": "blue"}]


def test_an_endpoint_makes_it(address: str) -> None:
    asked = ask("add an orange marble", address)
    assert asked.recipe["edits"] == [{"op": "insert", "asset": "made_marble_orange"}]
    assert library.get("made_marble_orange").provenance["made by"] == address


@pytest.mark.parametrize("wish", ["add the recipe", "put a delete the files near the cup"])
def test_what_is_no_thing_is_not_made(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        ask(wish, COMMAND)
    assert not list(library.folder().glob("*"))


def test_what_fails_is_told_and_leaves_nothing() -> None:
    for wish, who, why in (
        ("add a nothing_at_all", COMMAND, "no idea what that is"),
        ("add a marble", "no-such-program {out} {text}", "cannot be started"),
        ("add a marble", "http://127.0.0.1:9/make", "no answer"),
        ("either add a marble or add a mug", COMMAND, "without `either`"),
    ):
        with pytest.raises(NotMade, match=why):
            ask(wish, who)
    assert not list(library.folder().glob("*"))


def test_what_may_be_secret_is_nowhere(address: str) -> None:
    host = address.removeprefix("http://")
    for who, shown in (
        (f"http://me:s3cret@{host}?key=s3cret", address),
        (f"{COMMAND} --key s3cret", f"{sys.executable} {little_generator.__file__}"),
    ):
        assert Maker(who).called == shown
    asked = ask("add a marble", f"{COMMAND} --key s3cret")
    given = asked.yaml + asked.log + json.dumps(dict(library.get("made_marble").provenance))
    assert "s3cret" not in given
    with pytest.raises(NotMade) as caught:
        ask("add a kite", "http://me:s3cret@127.0.0.1:9/make?key=s3cret")
    assert "s3cret" not in str(caught.value)


@gl
def test_it_stands_in_the_scene_before_the_recipe_is_shown() -> None:
    wish = "add a blue marble near the cylinder"
    maker = Maker(COMMAND)
    asked = asking.ask(wish, asking.setting_of(take().episode), scene, maker=maker)
    assert asked.recipe["edits"][0]["asset"] == "made_marble_blue"


def test_the_command_line_takes_a_generator(template: Path) -> None:
    words = ["ask", str(template), "add a blue marble", "--no-ground", "--json"]
    done = CliRunner().invoke(app, [*words, "--generator", COMMAND])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["recipe"]["edits"][0]["asset"] == "made_marble_blue"
    failed = CliRunner().invoke(app, ["ask", str(template), "add a kite", "--generator", "x {out}"])
    assert failed.exit_code == 2
    assert "cannot be started" in failed.output
