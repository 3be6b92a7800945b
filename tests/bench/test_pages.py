"""The pages of docs/benchmarks say what the committed results say, and each figure names where it comes from."""

import importlib.util
import re
import shlex
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from rpaug.cli import COMMANDS, GROUPS
from tools.bench.harness import pages

ROOT = pages.DOCS.parent
TABLES = [
    pytest.param(table, id=f"{name}-{table.id}")
    for name in pages.names()
    for table in pages.load(name).tables
]
MADE_UP = pages.Table(
    id="moved",
    title="Moved cameras",
    command="python tools/bench/surfels.py --seeds 10",
    commit="0123abc",
    date="2026-01-31",
    machine="a laptop",
    seeds="seeds 0 to 9",
    columns=["method", "dB", "ms"],
    rows=[
        ["surfels", {"value": "30.4", "target": ">= 29.5"}, {"value": 19.5, "target": "<= 15"}],
        ["unchanged", 14.7, "-"],
    ],
)


def test_pages_say_what_the_results_say() -> None:
    for page, text in pages.pages().items():
        assert page.read_text() == text, f"{page}: run python -m tools.bench.harness.pages"


def test_every_topic_has_one_line_in_the_index_and_no_page_is_without_results() -> None:
    listed = re.findall(pages.TOPIC, (pages.DOCS / "benchmarks.md").read_text(), re.MULTILINE)
    assert sorted(listed) == pages.names()
    assert sorted(path.stem for path in (pages.DOCS / "benchmarks").glob("*.md")) == pages.names()


@pytest.mark.parametrize("page", sorted((pages.DOCS / "benchmarks").glob("*.md")), ids=str)
def test_a_page_fits_a_screen_or_so(page: Path) -> None:
    assert len(page.read_text().splitlines()) <= 75


@pytest.mark.parametrize("table", TABLES)
def test_every_table_says_where_it_comes_from(table: pages.Table) -> None:
    assert re.fullmatch(r"[0-9a-f]{7,40}", table.commit)
    assert date.fromisoformat(table.date)
    assert table.machine
    assert table.seeds
    assert table.rows
    assert all(len(row) == len(table.columns) for row in table.rows)


@pytest.mark.parametrize("table", TABLES)
def test_every_command_exists(table: pages.Table) -> None:
    words = [word for word in shlex.split(table.command) if not re.match(r"\w+=", word)]
    match words:
        case ["python", "-m", module, *_]:
            assert importlib.util.find_spec(module)
        case ["python", script, *_]:
            assert (ROOT / script).is_file()
        case ["pytest", path, *_]:
            assert (ROOT / path).exists()
        case ["make", target]:
            assert f"\n{target}:" in (ROOT / "Makefile").read_text()
        case ["rpaug", group, command, *_] if group in GROUPS:
            assert command in GROUPS[group][1]
        case ["rpaug", command, *_]:
            assert command in COMMANDS
        case _:
            pytest.fail(f"not a command of this project: {table.command}")


def test_a_missed_target_is_marked() -> None:
    shown = MADE_UP.markdown()
    assert "|surfels|30.4 (≥29.5)|**19.5 missed** (≤15)|" in shown
    assert "0123abc 2026-01-31; a laptop; seeds 0 to 9" in shown
    assert "2026-01-31; seeds 0" in replace(MADE_UP, machine="2 cores x86_64").markdown()
    assert "; 2 cores, busy; seeds 0" in replace(MADE_UP, machine="2 cores, busy").markdown()
    assert "\n\nMeasured as above.\n" in MADE_UP.markdown(MADE_UP)
    assert "above; seeds 0 to 9\n" in MADE_UP.markdown(replace(MADE_UP, seeds="seed 1"))
    assert "0123abc" in MADE_UP.markdown(replace(MADE_UP, date="2026-01-30"))
    rows = [["held: a", 1, 2], ["held: b", 3, 4]]
    assert "|held: a|1|2|" in replace(MADE_UP, rows=rows).markdown()
    assert "|a|1|2|\n|b|3|4|" in replace(MADE_UP, rows=rows, title="Moved, held").markdown()
    assert list(MADE_UP.misses()) == ["surfels, ms: 19.5 (≤15)"]
    assert pages.Topic("Cameras", "fair", [MADE_UP]).line("x").endswith(": fair; **1 missed**")


def test_a_bench_records_its_table_and_replaces_it(tmp_path: Path) -> None:
    (tmp_path / "benchmarks/results").mkdir(parents=True)
    (tmp_path / "benchmarks.md").write_text("# Index\n\n- [](benchmarks/cameras.md)\n")
    page = tmp_path / "benchmarks/cameras.md"
    page.write_text("# Cameras\n\n<!-- table: moved -->\n<!-- end -->\nProse.\n")
    pages.save("cameras", pages.Topic("Cameras", "{moved|surfels|dB} dB", []), tmp_path)
    other = replace(MADE_UP, id="other", rows=[["a", 1, 2], ["b", 'said "so"', "µs"]])
    for table in (MADE_UP, other, replace(MADE_UP, rows=[["surfels", 31.5, 12]])):
        pages.record("cameras", table, tmp_path)
    assert [table.id for table in pages.load("cameras", tmp_path).tables] == ["moved", "other"]
    assert pages.load("cameras", tmp_path).tables[1] == other
    with pytest.raises(ValueError, match="0 places for 'table: other'"):
        pages.pages(tmp_path)
    page.write_text(page.read_text() + "<!-- table: other -->\nstale\n<!-- end -->\n")
    said = pages.pages(tmp_path)
    assert "- [Cameras](benchmarks/cameras.md): 31.5 dB\n" in said[tmp_path / "benchmarks.md"]
    assert "|surfels|31.5|12|" in said[page]
    assert "stale" not in said[page]
    assert "Prose." in said[page]
    assert "19.5" not in said[page]


def test_figures_are_stamped_with_this_commit_and_day() -> None:
    stamp = pages.stamp()
    assert re.fullmatch(r"[0-9a-f]{7,}", stamp["commit"])
    assert date.fromisoformat(stamp["date"])
