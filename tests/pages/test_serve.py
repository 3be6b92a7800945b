"""The preview for editing: frames under the form's recipe, for this machine's own page alone."""

import io
import json
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import browser
import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import registry
from rpaug.core.errors import BadInput
from rpaug.pages import serve
from rpaug.pipeline import copies, recipe

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


def judged(running: serve.Server, given: Any, **more: Any) -> Any:
    asked = {"episode": running.keys[0], "recipe": given, "copy": 1} | more
    return json.loads(ask(running, "judge", asked)[1])


def test_gates_say_of_a_drawn_copy_what_a_run_says(running: serve.Server) -> None:
    moved = [{"op": "camera_pose", "camera": "front", "shift": 0.2}]
    strict = {"version": 1, "edits": moved, "gates": {"holes": 0.0, "tries": 2}}
    assert not drawn(running, strict)[1]["draw"]["judged"]
    told = judged(running, strict)
    prepared = running.session(running.keys[0]).prepared(recipe.build(strict))
    run = copies.draw_copy(prepared, 1)
    assert run.faults
    assert (told["judged"], told["faults"], told["again"]) == (True, list(run.faults), True)
    assert told["failed"][0].startswith("holes ")
    shown = drawn(running, strict, frame=3)[1][
        "draw"
    ]  # the copy that was judged, not the first draw of it
    assert shown["judged"]
    assert shown["faults"] == list(run.faults)
    assert judged(running, RECIPE)["faults"] == []


def test_judging_gives_way_to_who_asks(running: serve.Server) -> None:
    with running._rehearsal.asked():
        waiting = threading.Thread(target=lambda: said.append(judged(running, RECIPE, copy=9)))
        said: list[Any] = []
        waiting.start()
        while running._rehearsal._waiting < 2:
            time.sleep(0.01)
        with running._rehearsal.asked():
            pass
        with running._rehearsal._counting:
            running._rehearsal._waiting += 1  # one more, who comes while it is judged
    waiting.join()
    with running._rehearsal._counting:
        running._rehearsal._waiting -= 1
    assert said == [{"judged": False}]


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
    told = json.loads(ask(running, f"found?key={running.keys[0]}")[1])
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


def test_a_page_that_is_closed_while_it_waits_is_no_fault() -> None:
    class Gone(io.BytesIO):
        def write(self, _: Any) -> int:
            raise ConnectionResetError

    handler = serve._Handler.__new__(serve._Handler)
    handler.request_version, handler.requestline, handler.wfile = "HTTP/1.1", "GET /", Gone()
    handler._answer(200, b"late", "text/plain")


def test_a_taken_port_and_an_unknown_episode_are_named(running: serve.Server) -> None:
    made = recipe.build(RECIPE)
    with (
        pytest.raises(BadInput, match="expected a free port"),
        serve.server(registry.SAMPLE, made, None, running.server_port),
    ):
        pass
    with pytest.raises(BadInput, match="episode"), serve.server(registry.SAMPLE, made, "none", 0):
        pass


def test_the_recorded_frame_is_there_before_anything_is_found(running: serve.Server) -> None:
    told = json.loads(ask(running, f"episode?key={running.keys[0]}")[1])
    assert (told["length"], told["instances"]) == (17, [])
    assert told["before"]["front"]["before"]["url"].startswith("data:image/")
    later = json.loads(ask(running, f"recorded?key={running.keys[0]}&frame=8")[1])
    assert later["before"]["front"] != told["before"]["front"]
    assert ask(running, f"recorded?key={running.keys[0]}&frame=17")[0] == 400
    assert "doing" in json.loads(ask(running, "doing")[1])


def test_ctrl_c_is_how_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(_: serve.Server) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(serve.Server, "serve_forever", stopped)
    start = time.monotonic()
    done = CliRunner().invoke(app, ["preview", "sample", "--serve", "--port", "0", "--no-open"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert time.monotonic() - start < 20  # what was being drawn is not waited for


FORM = """
const status=()=>document.querySelector('#status').textContent;
const until=async(ready)=>{while(!ready()) await new Promise((done)=>setTimeout(done,50))};
const drawn=()=>until(()=>/^drawn in [0-9.]+ s$/.test(status())&&!document.querySelector('canvas[aria-busy=true]'));
const yaml=(words)=>until(()=>document.querySelector('#yaml').textContent.includes(words));
const inside=(edit,label)=>document.querySelector(`[data-edit="${edit}"] :is(input,select)[aria-label="${label}"]`);
const unfold=async()=>{for(const one of document.querySelectorAll('#editor details')) one.open=true;
    await new Promise((done)=>setTimeout(done,300))};
const give=(one,value)=>{one.value=value;one.dispatchEvent(new Event('input'));one.dispatchEvent(new Event('change'))};
const press=(label)=>document.querySelector(`#editor button[aria-label="${label}"]`).click();
const add=(label,name)=>{give(document.querySelector(`#editor select[aria-label="${label}"]`),name);press(label)};
await drawn();
"""


@pytest.fixture
def form(
    running: serve.Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Any]:
    """Runs a script in the page of the server, which starts with `RECIPE`."""
    if browser.CHROMIUM is None:
        pytest.skip(browser.WHY)
    running.recipe = recipe.build(RECIPE)
    page = running.page()

    def run(script: str, width: int = 1400, more: bytes = b"") -> Any:
        monkeypatch.setattr(running, "page", lambda: page + more + browser.asking(FORM + script))
        return browser.visit(running.url, tmp_path, width)

    return run


def test_the_form_edits_in_a_browser(form: Callable[..., Any]) -> None:
    script = """
    const seen=()=>{const c=document.querySelector('canvas[data-camera=front]');
        return [...c.getContext('2d').getImageData(0,0,c.width,c.height).data].reduce((a,b)=>a+b,0)};
    const blue=seen();
    give(inside('1','color'),'yellow');await yaml('yellow');await drawn();
    const yellow=seen();
    const told=()=>status()+document.querySelector('#drawn').textContent;
    give(inside('1','role'),'nobody');await until(()=>/left out|nobody/.test(told()));
    give(inside('1','role'),'manipulated');give(document.querySelector('#editor input[type=number]'),'-1');
    await until(()=>status().includes('seed'));
    const said=[status(),document.body.classList.contains('stale')];
    give(document.querySelector('#editor input[type=number]'),'3');await yaml('seed: 3');
    return [blue!==yellow,...said,document.body.classList.contains('stale')];
    """
    changed, said, stale, later = form(script)
    assert changed
    assert "at least 0" in said
    assert (stale, later) == (True, False)  # pictures of another recipe are shown as such


def test_lists_gates_and_ranges_have_fields_of_their_own(form: Callable[..., Any]) -> None:
    script = """
    add('add an edit','one_of');await yaml('one_of');
    add('add an alternative to edit 2','light_color');
    await yaml('light_color');
    press('remove edit 2.1');await until(()=>!document.querySelector('[data-edit="2.3"]'));
    give(inside('2','probability'),'0.5');await yaml('0.5');
    add('add an edit','distractors');await unfold();give(inside('3','size, from'),'0.05');
    give(inside('3','size, to'),'0.1');await yaml('[0.05, 0.1]');
    press('move edit 3 earlier');
    give(inside('gates','gates: what a copy must keep'),'limits');
    give(inside('gates','holes'),'0.3');await yaml('holes: 0.3');
    const none=inside('gates','no limit of torn');none.checked=true;none.dispatchEvent(new Event('change'));
    await yaml('torn: null');
    await unfold();
    const controls=[...document.querySelectorAll('#editor input,#editor select,#editor button')];
    const named=(one)=>one.getAttribute('aria-label')||(one.labels&&one.labels.length)||one.textContent;
    const nameless=controls.filter((one)=>!named(one));
    return [document.querySelector('#yaml').textContent,controls.length,nameless.length,
        controls.filter((one)=>one.tabIndex<0).length,
        document.querySelector('[data-edit=gates]').textContent.includes('invented pixels')];
    """
    text, controls, nameless, unreachable, told = form(script)
    made = recipe.build(recipe.parse(text.encode(), "y")[0]).source
    assert [one.get("op", "one_of") for one in made["edits"]] == [
        "recolor",
        "distractors",
        "one_of",
    ]
    assert [one["op"] for one in made["edits"][2]["one_of"]] == ["retexture", "light_color"]
    assert made["edits"][1]["size"] == [0.05, 0.1]
    assert made["gates"] == {"holes": 0.3, "torn": None}
    assert controls > 60
    assert (nameless, unreachable) == (0, 0)
    assert told


def test_instances_of_the_episode_are_picked_by_their_words(form: Callable[..., Any]) -> None:
    script = """
    await unfold();
    const pick=inside('1','instances of this episode'),offered=[...pick.options].map((one)=>one.textContent);
    give(inside('1','role'),'');
    give(pick,'94');await yaml('handle: 94');
    give(pick,'201');give(pick,'94');await yaml('[94, 201]');await drawn();
    give(inside('1','handle'),'4711');await yaml('handle: 4711');
    return [offered,document.querySelector('[data-edit="1"] input[aria-label=handle]').value];
    """
    offered, typed = form(script)
    assert "94: manipulated, brown" in offered
    assert typed == "4711"


OPENED = """
give(inside('gates','gates: what a copy must keep'),'limits');await yaml('gates');
add('add an edit','one_of');await yaml('one_of');await unfold();
"""


@pytest.mark.parametrize("width", [1400, 390])
def test_the_form_fits_a_desk_and_a_phone(form: Callable[..., Any], width: int) -> None:
    wide, inner = form(f"{OPENED}return [document.documentElement.scrollWidth,innerWidth]", width)
    assert wide <= inner


@pytest.mark.skipif(not browser.AXE, reason=browser.WHY_NO_AXE)
@pytest.mark.parametrize("width", [1400, 390])
def test_axe_has_no_serious_findings_in_the_form(form: Callable[..., Any], width: int) -> None:
    axe = b"<script>" + Path(browser.AXE).read_bytes() + b"</script>"
    assert form(OPENED + browser.FINDINGS, width, axe) == []
