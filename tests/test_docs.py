"""The documents keep up with the code: links resolve, examples work, nothing that ships goes unmentioned."""

import re
from dataclasses import fields
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import rpaug_recipes
import yaml
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import registry
from rpaug.core.version import __version__
from rpaug.physics import materials
from rpaug.pipeline import recipe

pytestmark = pytest.mark.usefixtures("tracked_once")
ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    ROOT / "examples/README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
SCREEN, WIDE = 50, 130  # rows of a screen and characters of a row, in an editor as on the site
FRONT = 160
ONE_ROW = ("|", "`python ")  # tables, and their commands, scroll sideways


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_links_outwards_are_whole_and_stand_once() -> None:
    """No network is asked. What lies at an address is looked up where the page needs it, not here."""
    texts = [page.read_text() for page in (*PAGES, *(ROOT / "docs/notebooks").glob("*.ipynb"))]
    found = [url for text in texts for url in re.findall(r"https?:[^\s)>\"'`]+", text)]
    outwards = [url for url in found if urlsplit(url).hostname not in ("localhost", "127.0.0.1")]
    assert len(outwards) > 5
    for url in outwards:
        parts = urlsplit(url)
        assert parts.scheme == "https", url
        assert re.fullmatch(r"[a-z0-9-]+(\.[a-z0-9-]+)+", parts.netloc), url
        assert not re.search(r"[.,;:]$|//", parts.path), url
    assert len(outwards) == len(set(outwards)), sorted(outwards)


def test_pages_are_two_screens_at_most() -> None:
    """README, the front page, is kept from growing; each operator has a page of the site to itself."""
    for page in PAGES:
        parts = [page.read_text()]
        if page == ROOT / "docs/operators.md":
            parts = parts[0].split("\n## ")
        most = FRONT if page == ROOT / "README.md" else 2 * SCREEN
        for part in parts:
            lines = part.splitlines()
            rows = sum(1 if one.startswith(ONE_ROW) else -(-len(one) // WIDE) or 1 for one in lines)
            assert rows <= most, f"{page.name}, {lines[0]}: {rows} rows"


def test_every_page_is_linked_from_another() -> None:
    linked = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in re.findall(r"\]\(([^)#]+)", page.read_text())
        if not target.startswith("http")
    }
    folders = {path for path in linked if path.is_dir()}
    for page in PAGES[1:]:
        assert page.resolve() in linked or page.resolve().parent in folders, page


def test_recipes_in_the_documents_are_valid() -> None:
    found = [block for page in PAGES for block in blocks(page, "yaml")]
    assert found
    for block in found:
        data = yaml.safe_load(block)
        if "target" in data:
            data = {"edits": [{"op": "recolor", "color": "blue", **data}]}
        recipe.build({"version": 1, **data} if "edits" in data else data)


def test_every_operator_has_its_heading_and_fields() -> None:
    text = (ROOT / "docs/operators.md").read_text()
    for name in registry.operator_names():
        section = text.split(f"## {name}\n")[1].split("\n## ")[0]
        for field in (field.name for field in fields(registry.operator(name))):
            assert f"`{field}`" in section, f"{name}: {field}"


def test_every_operator_shows_its_picture() -> None:
    text = (ROOT / "docs/operators.md").read_text()
    pictures = sorted((ROOT / "docs/images/operators").glob("*.png"))
    drawn = {picture.stem for picture in pictures} | {"stylize"}  # whose needs weights to draw
    assert drawn == set(registry.operator_names())
    for picture in pictures:
        section = text.split(f"## {picture.stem}\n")[1].split("\n## ")[0]
        assert f"(images/operators/{picture.name})" in section
        assert picture.stat().st_size < 250_000


def test_every_shipped_recipe_is_valid_and_named() -> None:
    text = (ROOT / "docs/recipes.md").read_text()
    for path in Path(rpaug_recipes.__file__).parent.rglob("*.yaml"):
        if path.name == materials.FILE:
            continue
        assert recipe.load(path).steps
        assert f"`{path.stem}`" in text


def test_the_examples_in_python_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    spaces: dict = {}
    for block in blocks(ROOT / "docs/python.md", "python"):
        exec(block, spaces)
    blue = spaces["image"][20, 20]
    assert blue[2] > blue[0]
    assert spaces["rpaug"].verify(tmp_path / "augmented", "sample").passed
    (readme,) = (text for text in blocks(ROOT / "README.md", "python") if "rpaug.read" in text)
    monkeypatch.chdir(tmp_path / "augmented")  # what it writes is new there
    exec(readme, {})


def test_the_lines_of_the_readme_run_as_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = (text for text in blocks(ROOT / "README.md", "sh") if "rpaug inspect" in text)
    lines = [line.split("#")[0].split() for line in block.strip().splitlines()]
    assert [line[1] for line in lines] == ["inspect", "init", "preview", "augment", "verify"]
    for line in lines:
        done = CliRunner().invoke(app, line[1:])
        assert done.exit_code == 0, (line, done.output)
    (training,) = (t for t in blocks(ROOT / "README.md", "python") if "AugmentedEpisodes" in t)
    spaces: dict = {}
    exec(training, spaces)
    assert spaces["rgb"].shape[-1] == 3


def test_the_strip_is_small_enough_and_the_files_of_a_project_are_there() -> None:
    assert (ROOT / "docs/images/strip.webp").stat().st_size < 2_000_000
    assert (ROOT / "docs/images/beside_truth.webp").stat().st_size < 200_000
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    assert citation["license"] == "Apache-2.0"
    for name in ("CONTRIBUTING.md", "SECURITY.md", "LICENSE"):
        assert (ROOT / name).stat().st_size > 500


def test_the_two_commands_of_the_readme_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    (setup,) = (block for block in blocks(ROOT / "README.md", "sh") if "make" in block)
    commands = re.findall(r"^make (\w+)", setup, re.MULTILINE)
    assert commands == ["demo", "test"]
    assert all(f"\n{command}:" in makefile for command in commands)
    assert "make test" in (ROOT / ".ci/run").read_text()
