"""The documents' site is built without a dead link, shows every operator, and loads nothing from elsewhere."""

import json
import re
import shutil
from dataclasses import fields
from pathlib import Path

import browser
import pytest

from rpaug.cli import COMMANDS
from rpaug.core import registry
from tools.docs import overview, reference, site


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    site.build(folder / "site", folder / "docs")
    return folder / "site"


def test_every_operator_has_a_page_with_picture_error_and_fields(built: Path) -> None:
    for name in registry.operator_names():
        page = (built / f"operators/{name}.html").read_text()
        assert re.search(rf'<img alt="{name}" src="\.\./images/', page)
        assert ("How near the truth" in page) == (name in overview.ROWS)
        for field in fields(registry.operator(name)):
            assert f"<code>{field.name}</code>" in page


def test_the_search_index_has_every_page_that_was_laid_out(built: Path) -> None:
    index = json.loads((built / "search/search_index.json").read_text())
    found = {entry["location"].partition("#")[0] for entry in index["docs"]}
    laid = (built.parent / "docs").rglob("*.md")
    assert {
        str(path.relative_to(built.parent / "docs").with_suffix(".html")) for path in laid
    } <= found


def test_nothing_is_loaded_from_elsewhere(built: Path) -> None:
    for page in built.rglob("*.html"):
        loaded = re.findall(
            r'<(?:script|link|img|iframe)\b[^>]*(?:src|href)="([^"]+)"', page.read_text()
        )
        assert loaded
        assert not [one for one in loaded if re.match(r"(https?:)?//", one)], page


def test_references_tell_bounds_defaults_names_and_options() -> None:
    assert "|`copies`|integer ≥ 1, ≤ 10000|`1`|" in reference.recipe_page()
    assert "|`count`|" in reference.operator_fields("distractors")
    page = reference.python_page()
    assert "augment(episode: " in page
    assert "### wrap" in page
    options = reference.commands_page("# Commands\n")
    assert all(f"### rpaug {name}\n" in options for name in COMMANDS)
    assert "|`--recipe`|" in options


def test_a_link_to_a_section_of_the_operators_leads_to_that_operators_page(built: Path) -> None:
    for page in (built.parent / "docs").rglob("*.md"):
        assert page.name == "operators.md" or "operators.md#" not in page.read_text(), page


@pytest.mark.skipif(browser.CHROMIUM is None, reason=browser.WHY)
@pytest.mark.skipif(not browser.AXE, reason=browser.WHY_NO_AXE)
@pytest.mark.parametrize("width", [1400, 390])
def test_axe_has_no_serious_findings_on_the_sites_first_page(
    built: Path, width: int, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(built, tmp_path / "site"))
    axe = b"<script>" + Path(browser.AXE).read_bytes() + b"</script>"
    # The theme's own script makes wide code focusable, later, and its search wants a server.
    script = """const found=await axe.run({rules:{'scrollable-region-focusable':{enabled:false}}});
    const bad=found.violations.filter((v)=>['serious','critical'].includes(v.impact));
    return [document.querySelector('.md-search').getAttribute('aria-label'),
    bad.map((v)=>v.id+': '+v.nodes[0].html)]"""
    found = browser.run((folder / "index.html").read_bytes() + axe, script, folder, width)
    assert found == ["Search", []]
