"""Every page fits a desk's screen and a phone's, and axe-core finds nothing serious in it."""

from pathlib import Path

import browser
import numpy as np
import pytest
from rollouts import SAMPLE, evaluation

import rpaug
from rpaug.core import registry
from rpaug.diagnosis import diagnose, page, read, reference
from rpaug.pages import contact, instances, preview
from rpaug.pipeline import inspect, recipe

PAGES = ("preview", "contact sheet", "instances", "diagnosis")
RECIPE = {"version": 1, "edits": [{"op": "light_color"}]}
SETTLED = """do await new Promise((done)=>setTimeout(done,20));
while(document.querySelector('canvas[aria-busy=true]'));"""
pytestmark = pytest.mark.skipif(browser.CHROMIUM is None, reason=browser.WHY)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("pages")
    sample = rpaug.read("sample")
    copy = rpaug.augment(sample, RECIPE)
    rpaug.write(copy, folder / "out")
    (folder / "out/rpaug.summary.json").write_text('{"recipe": {}}')
    described, rows, seen = inspect.inspect(sample)
    usual = reference.learn(SAMPLE)
    dark = read(evaluation(folder / "eval", lambda image: (image * 0.5).astype(np.uint8)))
    keys = preview.chosen(registry.SAMPLE, None, 1)
    return {
        "preview": preview.page(registry.SAMPLE, keys, recipe.build(RECIPE), draws=1, frames=2),
        "contact sheet": contact.write(
            registry.adapter_for(folder / "out"), SAMPLE, folder / "out"
        ).read_bytes(),
        "instances": instances.page(seen, described, rows),
        "diagnosis": page.page(diagnose(dark, SAMPLE, reference=usual), dark, usual),
    }


@pytest.mark.parametrize("width", [1400, 390])
@pytest.mark.parametrize("name", PAGES)
def test_nothing_is_wider_than_the_screen(
    pages: dict[str, bytes], name: str, width: int, tmp_path: Path
) -> None:
    script = f"{SETTLED}return [document.documentElement.scrollWidth, innerWidth]"
    wide, inner = browser.run(pages[name], script, tmp_path, width)
    assert wide <= inner
    assert b"<main>" in pages[name]  # the one frame and style of all pages


@pytest.mark.skipif(not browser.AXE, reason=browser.WHY_NO_AXE)
@pytest.mark.parametrize("width", [1400, 390])
@pytest.mark.parametrize("name", PAGES)
def test_axe_has_no_serious_findings(
    pages: dict[str, bytes], name: str, width: int, tmp_path: Path
) -> None:
    with_axe = pages[name] + b"<script>" + Path(browser.AXE).read_bytes() + b"</script>"
    assert browser.run(with_axe, SETTLED + browser.FINDINGS, tmp_path, width) == []
