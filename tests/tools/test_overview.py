"""README's table says what the committed results say, for each operator that there is."""

import re

from rpaug.core import registry
from tools.bench.harness import pages
from tools.docs import overview


def test_the_table_in_readme_is_made_from_the_results() -> None:
    assert overview.table() in overview.README.read_text(), "run python -m tools.docs.overview"


def test_a_cell_says_the_figure_of_its_page_and_the_word_of_its_size() -> None:
    cell = overview.Measured("appearance", "ten", "table_color", "estimated")
    (table,) = (one for one in pages.load("appearance").tables if one.id == "ten")
    shown = pages.plain(table.find("table_color", "estimated"))
    assert str(cell) == f"**exact** [{shown} dB](docs/benchmarks/appearance.md)"
    words = {
        float(x): word
        for word, x in re.findall(r"\*\*(exact|good|rough)\*\* \[([\d.]+) dB", overview.table())
    }
    assert len(words) > 15
    for value, word in words.items():
        assert (word == "exact") == (value >= 40)
        assert (word == "rough") == (value < 28)


def test_several_rows_have_their_median_and_a_refusal_no_part_in_it() -> None:
    rows = ("open_drawer", "pick_block", "slide_block", "stack_cups")  # the first is refused
    cell = overview.Measured("rgb_only", "twin", rows, "inside, dB (unedited)")
    (table,) = (one for one in pages.load("rgb_only").tables if one.id == "twin")
    figures = sorted(float(pages.plain(table.find(r, cell.column)).split()[0]) for r in rows[1:])
    assert cell.value(cell.column) == figures[1]


def test_every_row_is_an_operator_and_what_needs_depth_is_refused_without() -> None:
    assert set(overview.ROWS) == set(registry.operator_names())
    for name, cells in overview.ROWS.items():
        assert len(cells) == len(overview.COLUMNS)
        if registry.operator(name).needs.depth:
            assert cells[overview.COLUMNS.index("color alone")] == overview.NO


def test_every_operator_and_format_stands_in_the_table() -> None:
    shown = overview.table()
    for name in registry.operator_names():
        assert shown.count(f"(docs/operators.md#{name})") == 1
    head = shown.splitlines()[0]
    assert all(f"`{name}`" in head for name in registry.adapter_names())


def test_a_quoted_figure_is_the_one_of_its_table() -> None:
    (table,) = (one for one in pages.load("physics").tables if one.id == "rigid")
    worst = pages.plain(table.find("box's lid pushed shut on its hinge", "at worst"))
    cell = str(overview.ROWS["physics"][0])
    assert f"off by [{worst.split(',')[0]}](docs/benchmarks/physics.md) mm" in cell


def test_several_columns_have_their_median_too() -> None:
    (table,) = (one for one in pages.load("photographed_moves").tables if one.id == "worked")
    tasks = ("slide_block", "stack_cups", "put_in_box")
    figures = sorted(float(pages.plain(table.find("moved", task)).split()[0]) for task in tasks)
    assert f"[{figures[1]} dB]" in str(overview.ROWS["move"][3])


def test_an_edit_that_is_no_better_than_none_is_a_no() -> None:
    (table,) = (one for one in pages.load("photographed").tables if one.id == "middle")
    unedited = pages.plain(table.find("lamp's direction", "unedited, dB"))
    said = str(overview.photographed("lamp's direction", table="middle"))
    assert said.startswith("**no** [")
    assert said.endswith(f", no better than no edit ({unedited})")
    assert str(overview.photographed("lamps' color", table="middle")).startswith("**good** [")
