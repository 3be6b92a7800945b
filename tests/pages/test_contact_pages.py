"""Pages of all episodes of an output, by the command."""

import json
import shutil
from pathlib import Path

import pytest
from rpaug_adapters.rlbench import RLBench
from runs import GROUP, augment
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.pages import contact
from rpaug.pipeline import recipe, report


def test_pages_show_every_episode_once(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = {"version": 1, "copies": 2, "keep_originals": True, "edits": [{"op": "light_color"}]}
    source, out = tmp_path / "in", tmp_path / "out"
    shutil.copytree(template, source)
    augment(source, recipe.build(wanted), out)
    (out / "rejected" / GROUP).mkdir(parents=True)
    shutil.copytree(out / GROUP / "episode3", out / "rejected" / GROUP / "episode3")
    monkeypatch.setattr(contact, "ON_A_PAGE", 4)

    def page(number: int, *more: object) -> tuple[int, str]:
        html = tmp_path / f"{number}{len(more)}.html"
        given = ["contact", str(out), "--page", str(number), "--html", str(html), *map(str, more)]
        done = CliRunner().invoke(app, [*given, "--json"])
        if done.exit_code:
            return done.exit_code, json.loads(done.stdout)["error"]
        assert json.loads(done.stdout) == {"page": number, "pages": 2, "html": str(html)}
        return 0, html.read_text()

    texts = [page(1)[1], page(2)[1]]
    assert [text.count("<h2>") for text in texts] == [4, 2]
    assert [text.count("nothing was edited") for text in texts] == [2, 0]
    for number in range(6):
        assert f"<h2>{GROUP}/episode{number}</h2>" in texts[number // 4]
    assert "Episodes 5 to 6 of 6" in texts[1]
    code, said = page(3)
    assert (code, "expected a page from 1 to 2" in said) == (2, True)
    source.rename(tmp_path / "moved")
    assert page(1, "--against", tmp_path / "moved") == (0, texts[0])
    shown = contact.write(RLBench(), tmp_path / "moved", out).read_text()
    assert "4 augmented ones shown" in shown
    assert "up to page 2" in shown  # two recorded ones are left out
    assert "pixels changed</span> <b>front " in shown
    monkeypatch.setattr(contact, "ON_A_PAGE", 24)
    shown = contact.write(RLBench(), tmp_path / "moved", out).read_text()
    assert "--page 1 --html FILE</code> shows every episode." in shown
    for number in range(6):
        if report.of(out / GROUP / f"episode{number}")["copy"] == 0:
            shutil.rmtree(out / GROUP / f"episode{number}")
    shown = contact.write(RLBench(), tmp_path / "moved", out).read_text()
    assert "4 episodes, 4 augmented ones shown" in shown
    assert "--page" not in shown
