"""The preview for editing: frames under the form's recipe, for this machine's own page alone."""

import json
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import browser
import pytest

from rpaug.core import registry
from rpaug.core.errors import BadInput
from rpaug.pages import serve
from rpaug.pipeline import recipe

RECIPE = {
    "version": 1,
    "edits": [{"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"}],
}


@pytest.fixture(scope="module")
def running() -> Iterator[serve.Server]:
    with serve.server(registry.SAMPLE, recipe.build(RECIPE), None, 0) as made:
        thread = threading.Thread(target=made.serve_forever, daemon=True)
        thread.start()
        yield made
        made.shutdown()
        thread.join()


def ask(running: serve.Server, path: str, body: Any = None, **headers: str) -> tuple[int, bytes]:
    data = None if body is None else json.dumps(body).encode()
    asked = urllib.request.Request(running.url + path, data, headers)
    try:
        with urllib.request.urlopen(asked, timeout=60) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def drawn(running: serve.Server, given: Any, **more: Any) -> tuple[int, Any]:
    asked = {"episode": running.keys[0], "recipe": given, "copy": 1, "frame": 8} | more
    code, data = ask(running, "draw", asked)
    return code, json.loads(data)


def test_a_frame_is_drawn_under_the_recipe_of_the_form(running: serve.Server) -> None:
    code, told = drawn(running, RECIPE)
    assert code == 200
    assert told["draw"]["words"] == [["recolor", "manipulated: brown and gray → blue"]]
    assert told["draw"]["images"]["front"]["after"]["columns"] == 1
    assert recipe.build(recipe.parse(told["yaml"].encode(), "y")[0]).source == RECIPE
    edit = {**RECIPE["edits"][0], "color": {serve.WRITTEN: "{rgb: [1, 0, 0]}"}}  # type: ignore[index]
    code, told = drawn(running, {"version": 1, "edits": [edit]})
    assert told["draw"]["words"][0][1].endswith("→ red")


def test_what_is_wrong_is_told_in_the_words_of_recipes(running: serve.Server) -> None:
    code, told = drawn(running, {"version": 1, "edits": [{"op": "recolour"}]})
    assert code == 400
    assert "did you mean recolor" in told["error"]
    assert "no such frame" in drawn(running, RECIPE, frame=99)[1]["error"]
    assert "episode" in drawn(running, RECIPE, episode="../x")[1]["error"]
    assert ask(running, "draw", [])[0] == 400
    assert ask(running, "elsewhere")[0] == 404


def test_the_page_lists_episodes_and_what_is_in_one(running: serve.Server) -> None:
    code, page = ask(running, "")
    assert code == 200
    assert b'"served": true' in page
    told = json.loads(ask(running, f"episode?key={running.keys[0]}")[1])
    assert told["frames"] == list(range(17))
    assert told["roles"]["manipulated"]["ids"] == [94, 201]


def test_nobody_else_is_answered(running: serve.Server) -> None:
    assert running.server_address[0] == "127.0.0.1"
    assert ask(running, "", Host="evil.example")[0] == 403
    assert ask(running, "draw", RECIPE, Origin="http://evil.example")[0] == 403
    assert ask(running, "draw", RECIPE, Origin="null")[0] == 403


def test_a_connection_that_stays_silent_holds_up_nobody(running: serve.Server) -> None:
    with socket.create_connection(running.server_address[:2]):
        assert ask(running, "")[0] == 200


def test_a_taken_port_and_an_unknown_episode_are_named(running: serve.Server) -> None:
    made = recipe.build(RECIPE)
    with (
        pytest.raises(BadInput, match="expected a free port"),
        serve.server(registry.SAMPLE, made, None, running.server_port),
    ):
        pass
    with pytest.raises(BadInput, match="episode"), serve.server(registry.SAMPLE, made, "none", 0):
        pass


@pytest.mark.skipif(browser.CHROMIUM is None, reason=browser.WHY)
def test_the_form_edits_in_a_browser(
    running: serve.Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = """
    const status=()=>document.querySelector('#status').textContent;
    const until=async(ready)=>{while(!ready()) await new Promise((done)=>setTimeout(done,50))};
    const drawn=()=>until(()=>/^[0-9.]+ s$/.test(status())&&!document.querySelector('canvas[aria-busy=true]'));
    const seen=()=>{const c=document.querySelector('canvas[data-camera=front]');
        return [...c.getContext('2d').getImageData(0,0,c.width,c.height).data].reduce((a,b)=>a+b,0)};
    const field=(name)=>document.querySelector('#'+[...document.querySelectorAll('#editor label')]
        .find((one)=>one.textContent===name).htmlFor);
    const type=async(value,words)=>{const one=field('color');one.value=value;one.dispatchEvent(new Event('input'));
        await until(()=>document.querySelector('#yaml').textContent.includes(words)||status().includes(words))};
    await drawn();
    const blue=seen();
    await type('yellow','yellow');await drawn();
    const yellow=seen();
    await type('bluu','did you mean');
    const said=status();
    await type('red','red');
    const add=document.querySelector('#editor select[aria-label="add an edit"]');
    add.value='light_color';add.dispatchEvent(new Event('change'));
    await until(()=>document.querySelector('#yaml').textContent.includes('light_color'));
    return [blue!==yellow,said,document.querySelectorAll('#editor fieldset').length];
    """
    page = running.page()
    monkeypatch.setattr(running, "page", lambda: page + browser.asking(script))
    changed, said, edits = browser.visit(running.url, tmp_path)
    assert changed
    assert "blue" in said
    assert edits == 2
