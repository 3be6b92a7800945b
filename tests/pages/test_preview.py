"""The preview: one page with images, words and gates of copies made ahead; in a browser it shows them."""

import base64
import json
import os
import re
import shutil
from pathlib import Path

import browser
import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.cli.progress import Position
from rpaug.core import owner, progress, registry
from rpaug.pages import preview
from rpaug.pages.session import Session, packed, smallest, tiles
from rpaug.pipeline import journal, recipe

RECIPE = {
    "version": 1,
    "seed": 3,
    "edits": [
        {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"},
        {"op": "distractors", "count": 1},
    ],
}
needs_chromium = pytest.mark.skipif(browser.CHROMIUM is None, reason=browser.WHY)
SETTLED = """
const settled=async()=>{do await new Promise((done)=>setTimeout(done,20));
while(document.querySelector('canvas[aria-busy=true]'))};await settled();
"""
MEAN = """
const mean=(name)=>{const c=document.querySelector(`canvas[data-camera=${name}]`),d=c.getContext('2d')
.getImageData(0,0,c.width,c.height).data;let s=[0,0,0];for(let i=0;i<d.length;i+=4)for(let k=0;k<3;k++)s[k]+=d[i+k];
return s.map((v)=>v/(d.length/4))};
const press=async(words)=>{const all=[...document.querySelectorAll('#bar button')];
all.find((b)=>b.textContent===words).click();await settled()};
"""


@pytest.fixture(scope="module")
def page() -> bytes:
    keys = preview.chosen(registry.SAMPLE, None, 1)
    return preview.page(registry.SAMPLE, keys, recipe.build(RECIPE), draws=2, frames=3)


def held(page: bytes) -> dict:
    found = re.search(rb"<script type=application/json id=data>(.*?)</script>", page, re.DOTALL)
    assert found
    return json.loads(found[1])


def test_the_page_holds_copies_as_a_run_makes_them(page: bytes) -> None:
    (episode,) = held(page)["episodes"]
    assert episode["frames"] == [0, 8, 16]
    first, second = episode["draws"]
    assert first["words"][0] == ["recolor", "manipulated: brown and gray → blue"]
    assert (first["copy"], second["copy"], first["seed"]) == (1, 2, 3)
    assert first["faults"] == []
    assert first["added"][0]["name"].startswith("new: ")
    assert {"after", "depth", "ids"} == set(first["images"]["front"])
    assert episode["roles"]["manipulated"]["why"]
    assert b"http" not in re.sub(rb"data:[^\"']*", b"", page)  # it needs no network


def test_frames_lie_in_a_sheet_block_by_block() -> None:
    view = registry.read(registry.SAMPLE, None).views["front"]
    numbers = {one: n for n, one in enumerate(np.unique(view.ids(0)).tolist(), 1)}  # type: ignore[misc]
    made = packed(tiles(view, "ids", [0, 4, 8], numbers))
    assert (made["columns"], made["tile"]) == (2, [128, 128])
    assert made["url"].startswith("data:image/webp;base64,")
    data = np.frombuffer(base64.b64decode(made["url"].split(",")[1]), np.uint8)
    tile = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)[:128, 128:256]
    assert view.ids is not None
    expected = np.vectorize(lambda one: numbers.get(one, 0))(view.ids(4))
    np.testing.assert_array_equal(tile[..., 0], expected)


def test_frames_are_exact_where_that_is_no_larger_and_each_picture_is_there_once(
    page: bytes,
) -> None:
    data = held(page)
    (episode,) = data["episodes"]
    view = registry.read(registry.SAMPLE, None).views["front"]
    assert smallest(view, range(17))["exact"]  # rendered frames repeat what rests
    assert not smallest(view, [0, 8, 16])["exact"]
    for name, images in episode["before"].items():
        assert episode["draws"][0]["images"][name]["after"]["exact"] == images["before"]["exact"]
    assert len(set(data["images"])) == len(data["images"])
    colors = recipe.build({"version": 1, "edits": RECIPE["edits"][:1]})  # type: ignore[index]
    keys = preview.chosen(registry.SAMPLE, None, 1)
    (same,) = held(preview.page(registry.SAMPLE, keys, colors, draws=2, frames=2))["episodes"]
    first, second = (one["images"]["front"] for one in same["draws"])
    assert (first["depth"], first["ids"]) == (second["depth"], second["ids"])


def test_frames_that_are_left_out_are_said(page: bytes) -> None:
    assert preview.thinned(200, preview.FEWER)[::11] == [0, 199]
    assert b"of which" in page


def test_what_is_not_to_be_judged_renders_the_shown_frames_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("gates take all frames")

    monkeypatch.setattr(Session, "judged", refuse)
    keys = preview.chosen(registry.SAMPLE, None, 1)
    made = preview.page(
        registry.SAMPLE, keys, recipe.build(RECIPE), draws=1, frames=2, judged=False
    )
    (draw,) = held(made)["episodes"][0]["draws"]
    assert not draw["judged"]
    assert draw["change"]["front"] > 0


def test_a_dataset_that_is_being_written_is_named(
    tmp_path: Path,
) -> None:
    shutil.copytree(registry.SAMPLE, root := tmp_path / "data")
    assert preview.unfinished(root) == []
    with owner.owned(root):
        (note,) = preview.unfinished(root)
        assert f"process {os.getpid()}" in note
        given = ["preview", str(root), "--out", str(tmp_path / "p.html"), "--draws", "1"]
        done = CliRunner().invoke(app, [*given, "--frames", "1"])
        assert "is being written" in done.stderr
        (told,) = held((tmp_path / "p.html").read_bytes())["notes"]
        assert f"process {os.getpid()}" in told  # for how many minutes differs
    (root / journal.NAME).write_text("{}\n")
    assert "has not ended" in preview.unfinished(root)[0]


def test_a_scene_is_built_once_for_recipes_that_need_the_same() -> None:
    session = Session(registry.SAMPLE)
    first = session.prepared(recipe.build(RECIPE))
    other = json.loads(json.dumps(RECIPE).replace("blue", "red"))
    assert session.prepared(recipe.build(other)).scene is first.scene
    drawn = session.drawn(recipe.build(other), 1, [8], judged=False)
    assert drawn["words"][0][1].endswith("red")


def test_progress_goes_on_from_episode_to_episode() -> None:
    position, reached = Position("previewing"), []

    def hear(told: progress.Told) -> None:
        position.hear(told)
        if told["stage"] == progress.COPY:
            reached.append(position.reached)

    key = registry.adapter("rlbench").episodes(registry.SAMPLE)[0]
    same = recipe.build({"version": 1, "edits": [{"op": "light_color"}]})
    with progress.heard(hear):
        preview.page(registry.SAMPLE, [key] * 3, same, draws=2, frames=1, count=position.count)
    assert reached == [1, 2, 3, 4, 5, 6]


def test_the_command_writes_a_page_and_spares_what_is_not_one(tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(json.dumps(RECIPE))
    out = tmp_path / "p.html"
    given = [
        "preview",
        "sample",
        "--recipe",
        str(tmp_path / "r.yaml"),
        "--out",
        str(out),
        "--draws",
        "1",
        "--frames",
        "2",
    ]
    assert CliRunner().invoke(app, given).exit_code == 0
    assert CliRunner().invoke(app, given).exit_code == 0  # an earlier preview is replaced
    out.write_text("mine")
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 2
    assert "earlier preview" in done.stderr
    assert out.read_text() == "mine"


@needs_chromium
def test_episodes_are_turned_to_by_key_and_by_number(tmp_path: Path) -> None:
    for number in range(3):
        shutil.copytree(registry.SAMPLE, tmp_path / f"data{number}")
        there = next((tmp_path / f"data{number}").rglob("episode0"))
        there.rename(place := there.with_name(f"episode{number}"))
        if number:
            shutil.move(place, next((tmp_path / "data0").rglob("episodes")))
    keys = preview.chosen(tmp_path / "data0", None, 3)
    shown = preview.page(tmp_path / "data0", keys, recipe.build(RECIPE), draws=1, frames=1)
    script = f"""{SETTLED}
    const facts=()=>document.getElementById('facts').textContent.match(/(\\d) of 3/)[1];
    const press=async(key)=>{{document.dispatchEvent(new KeyboardEvent('keydown',{{key}}));await settled()}};
    const out=[facts()];await press(']');out.push(facts());await press('[');await press('[');out.push(facts());
    const number=document.getElementById('episode');out.push(number.value);
    for(const value of [2,9]){{number.value=value;number.dispatchEvent(new Event('change'));await settled();
        out.push(facts())}}
    return out;"""
    assert browser.run(shown, script, tmp_path) == ["1", "2", "3", "3", "2", "3"]


@needs_chromium
@pytest.mark.parametrize("width", [1400, 390])
def test_a_browser_shows_it(page: bytes, tmp_path: Path, width: int) -> None:
    script = f"""{SETTLED}{MEAN}
    const out={{wide:document.documentElement.scrollWidth,cameras:document.querySelectorAll('canvas').length}};
    for(const mode of ['before','after','difference','depth','instances','split']){{
        await press(mode);out[mode]=mean('wrist')}}
    document.dispatchEvent(new KeyboardEvent('keydown',{{key:'ArrowRight'}}));await settled();
    out.frame=document.getElementById('frame-label').textContent;
    out.first=document.getElementById('facts').textContent;await press('next draw');
    out.next=document.getElementById('facts').textContent;
    out.drawn=document.getElementById('drawn').textContent;out.inner=innerWidth;return out;"""
    out = browser.run(page, script, tmp_path, width)
    assert out["wide"] <= out["inner"]
    assert out["cameras"] == 5
    before, after, difference = (np.array(out[name]) for name in ("before", "after", "difference"))
    assert np.abs(after - before).max() > 0.5
    np.testing.assert_allclose(difference, 128 + after - before, atol=2)
    assert max(out["depth"]) - min(out["depth"]) < 1  # gray
    assert np.abs(np.array(out["instances"]) - after).max() > 0.5  # outlines
    assert out["frame"] == "frame 8 of 16"
    assert "copy 1" in out["first"]
    assert "copy 2" in out["next"]
    assert "blue" in out["drawn"]
