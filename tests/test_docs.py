"""The documents keep up with the code: links resolve, examples work, nothing that ships goes unmentioned."""

import re
from dataclasses import fields
from pathlib import Path

import pytest
import rpaug_recipes
import yaml

from rpaug.core import registry
from rpaug.physics import materials
from rpaug.pipeline import recipe

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


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


def test_every_drawn_operator_shows_its_picture() -> None:
    text = (ROOT / "docs/operators.md").read_text()
    pictures = sorted((ROOT / "docs/images/operators").glob("*.png"))
    assert len(pictures) >= 12
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


def test_the_two_commands_of_the_readme_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    (setup,) = (block for block in blocks(ROOT / "README.md", "sh") if "make" in block)
    commands = re.findall(r"^make (\w+)", setup, re.MULTILINE)
    assert commands == ["demo", "test"]
    assert all(f"\n{command}:" in makefile for command in commands)
    assert "make test" in (ROOT / ".ci/run").read_text()
