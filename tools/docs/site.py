"""Build the documents' site: docs/, README, a page for each operator and reference pages, with search, without network.

    python -m tools.docs.site [--out build/site]

Markdown is laid out below build/docs and built by MkDocs in its strict mode: a dead link fails. `make docs` runs it.
Search wants a server: `python -m http.server --directory build/site`. Nothing is loaded from elsewhere.
"""

import argparse
import logging
import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpaug.core import registry
from tools.docs import overview, reference

ROOT = Path(__file__).parents[2]
ROOT_PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "tools/bench/wishes/written.md": "wishes.md",
    "examples/README.md": "examples/index.md",
}
NAVIGATION: Mapping[str, tuple[str, ...]] = {
    "Start": (
        "index.md",
        "quickstart.md",
        "commands.md",
        "preview.md",
        "python.md",
        "examples/index.md",
    ),
    "Recipes": (
        "recipes.md",
        "recipe-reference.md",
        "targets.md",
        "ask.md",
        "gates.md",
        "reports.md",
    ),
    "Operators": ("operators.md", "operators/*", "objects.md", "physics.md", "textures.md"),
    "Datasets": (
        "formats.md",
        "convert.md",
        "video.md",
        "rgb_only.md",
        "calibrate.md",
        "readers.md",
        "scale.md",
    ),
    "Training": ("training.md", "diagnose.md", "loop.md", "twin.md"),
    "How it works": ("tiers.md", "fit.md", "models.md", "weights.md", "cache.md", "why/*"),
    "Figures": ("benchmarks.md", "bench.md", "foreign.md", "benchmarks/*", "wishes.md"),
    "Develop": (
        "python-reference.md",
        "architecture.md",
        "extending.md",
        "contributing.md",
        "security.md",
        "changelog.md",
    ),
}
CONFIG: Mapping[str, Any] = {
    "site_name": "rpaug",
    "site_description": "Multiplies robot demonstrations.",
    "theme": {
        "name": "material",
        "font": False,
        "features": [
            "navigation.tabs",
            "navigation.prune",
            "content.code.copy",
            "search.highlight",
        ],
    },
    "extra_css": ["site.css"],
    "extra_javascript": ["site.js"],
    "plugins": ["search"],
    "use_directory_urls": False,
    "markdown_extensions": [
        "tables",
        "fenced_code",
        "sane_lists",
        "pymdownx.highlight",
        "pymdownx.superfences",
        {"toc": {"permalink": True, "toc_depth": 3}},
    ],
    "validation": {"links": {"anchors": "warn"}, "nav": {"omitted_files": "warn"}},
}


def pages() -> dict[str, str]:
    """Every page of the site by its path, links as they lead there."""
    docs = ROOT / "docs"
    found = {str(path.relative_to(docs)): path.read_text() for path in sorted(docs.rglob("*.md"))}
    sections = operator_sections(found["operators.md"])
    found["commands.md"] = reference.commands_page(found["commands.md"])
    found["recipe-reference.md"] = reference.recipe_page()
    found["python-reference.md"] = reference.python_page()
    found["why/index.md"] = _listing("Why things are as they are", found, "why")
    found["operators.md"] = sections.pop("") + "\n".join(
        f"- [{name}](operators/{name}.md)" for name in sections
    )
    found |= {f"operators/{name}.md": operator_page(name, body) for name, body in sections.items()}
    found |= {there: _from_root((ROOT / here).read_text()) for here, there in ROOT_PAGES.items()}
    return {path: _led(text) for path, text in found.items()}


def operator_sections(text: str) -> dict[str, str]:
    """What docs/operators.md says of each operator; what it says of all of them under ""."""
    first, *others = re.split(r"^## (\w+)\n", text, flags=re.MULTILINE)
    return {"": first} | dict(zip(others[::2], others[1::2], strict=True))


def operator_page(name: str, body: str) -> str:
    """What is written of an operator, its error, and its fields from the schema."""
    body = re.sub(r"\]\((?!http)(?=[\w#])", "](../", body).replace("](../#", "](#")
    parts = [f"# {name}", body.strip()]
    if name in overview.ROWS:
        table = "\n".join(overview.table((name,)).splitlines())
        parts += ["## How near the truth", table.replace("](docs/", "](../"), _WORDS]
    return "\n\n".join([*parts, "## Fields", reference.operator_fields(name)])


_WORDS = (
    "*exact*: 40 dB or more in the pixels that change; *good*: 28 or more; *rough*: less; *no*: refused, or no better "
    "than no edit. *2D*: the best edit of each image alone. [How this is measured](../index.md#how-near-the-truth)."
)


def _listing(title: str, found: Mapping[str, str], folder: str) -> str:
    rows = (
        f"- [{text.splitlines()[0].removeprefix('# ')}]({Path(path).name})"
        for path, text in found.items()
        if path.startswith(f"{folder}/")
    )
    return f"# {title}\n\n" + "\n".join(rows) + "\n"


def _from_root(text: str) -> str:
    """A page of the root, which lies beside those of docs/ on the site."""
    for here, there in ROOT_PAGES.items():
        text = text.replace(f"]({here})", f"]({there})")
    text = text.replace("](docs/notebooks/)", "](python.md)").replace(
        "](docs/why/)", "](why/index.md)"
    )
    return text.replace("](docs/", "](")


def _led(text: str) -> str:
    """Links to what lies elsewhere on the site: sections of operators.md have pages of their own."""
    names = "|".join(registry.operator_names())
    text = re.sub(rf"\]\(((?:\.\./)*)operators\.md#({names})\)", r"](\1operators/\2.md)", text)
    text = text.replace("](../examples/glow/)", "](examples/glow/glow.py)")
    text = (
        text.replace("](../examples/", "](examples/")
        .replace("](../../../docs/", "](")
        .replace("](../../tools/bench/wishes/written.md)", "](../wishes.md)")
    )
    return text.replace("](../why/)", "](../why/index.md)")


def navigation(found: Mapping[str, str]) -> list[dict[str, list[str]]]:
    """NAVIGATION with each `folder/*` spelled out, a folder's index first."""

    def spelled(entry: str) -> list[str]:
        if not entry.endswith("/*"):
            return [entry]
        inside = [path for path in found if path.startswith(entry[:-1])]
        return sorted(inside, key=lambda path: (not path.endswith("index.md"), path))

    return [
        {name: [p for e in entries for p in spelled(e)]} for name, entries in NAVIGATION.items()
    ]


def build(out: Path, staged: Path) -> None:
    """The site in `out`. Raises mkdocs' Abort where a page has a dead link or no place in the navigation."""
    from mkdocs.commands.build import build as made
    from mkdocs.config import load_config

    shutil.rmtree(staged, ignore_errors=True)
    for folder, place in ((ROOT / "docs", staged), (ROOT / "examples", staged / "examples")):
        shutil.copytree(
            folder, place, ignore=shutil.ignore_patterns("*.md", "results", "__pycache__")
        )
    here = Path(__file__)
    for file in (ROOT / "CITATION.cff", here.with_suffix(".css"), here.with_suffix(".js")):
        shutil.copy(file, staged)
    found = pages()
    for path, text in found.items():
        (staged / path).parent.mkdir(parents=True, exist_ok=True)
        (staged / path).write_text(text)
    os.environ.setdefault(
        "NO_MKDOCS_2_WARNING", "1"
    )  # Material's notice, which strict mode takes for a fault
    given = {**CONFIG, "nav": navigation(found), "docs_dir": str(staged), "site_dir": str(out)}
    (staged.parent / "mkdocs.yml").write_text("site_name: rpaug\n")
    config = load_config(str(staged.parent / "mkdocs.yml"), strict=True, **given)
    made(config)


def main() -> None:
    """Build the site and say where it is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build/site")
    out = parser.parse_args().out.resolve()
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    build(out, ROOT / "build/docs")
    print(f"{out / 'index.html'}: {sum(1 for _ in out.rglob('*.html'))} pages")


if __name__ == "__main__":
    main()
