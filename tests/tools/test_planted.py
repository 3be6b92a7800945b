"""Planted bugs: what notices one, what does not count, and what of a list is refused."""

import subprocess
from pathlib import Path

import pytest

from tools import planted
from tools.planted import PlantedBug, ThrownAway

CODE = "def double(number):\n    return 2 * number\n\n\ndef half(number):\n    return number / 2\n"
TESTS = """from rpaug.core.numbers import double

def test_that_fails_anyway():
    assert double(1) == 3

def test_double():
    assert double(2) == 4
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A checkout of one module, its test, and a module and a test that use it."""
    made = tmp_path / "root"
    for name, text in {
        "rpaug/__init__.py": "",
        "rpaug/core/__init__.py": "",
        "rpaug/core/numbers.py": CODE,
        "rpaug/pages/__init__.py": "",
        "rpaug/pages/sums.py": "from rpaug.core import numbers\n",
        "tests/core/test_all.py": TESTS,
        "tests/core/test_else.py": "def test_else():\n    pass\n",
        "tests/pages/test_sums.py": "from rpaug.pages import sums\n",
        "tests/pages/test_alone.py": "",
    }.items():
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).write_text(text)
    subprocess.run(["git", "init", "-q", made], check=True)
    return made


def bug(old: str, new: str, part: str = "first", name: str = "doubled") -> PlantedBug:
    return PlantedBug(
        name=name, part=part, file="rpaug/core/numbers.py", old=old, new=new, suffers=""
    )


def test_a_test_counts_that_passes_without_the_bug(root: Path, tmp_path: Path) -> None:
    place = ThrownAway(root, tmp_path)
    found = planted.noticed(bug("2 * number", "3 * number"), place)
    assert found == "tests/core/test_all.py::test_double"
    assert (root / "rpaug/core/numbers.py").read_text() == CODE


def test_all_stages_are_run_before_it_is_unnoticed(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran = []
    monkeypatch.setattr(ThrownAway, "fails", lambda _, bug, tests, but: ran.append(tests))
    assert planted.noticed(bug("number / 2", "number // 2"), ThrownAway(root, tmp_path)) is None
    assert ran == [
        ["tests/core/test_all.py"],
        ["tests/core/test_else.py"],
        ["tests/pages/test_sums.py"],
    ]


@pytest.mark.parametrize(
    ("old", "new"), [("number", "numbers"), ("no such text", ""), ("2 * number", "2 * number")]
)
def test_a_place_that_is_not_one_is_refused(root: Path, old: str, new: str) -> None:
    with pytest.raises(ValueError, match=r"doubled: . places in rpaug/core/numbers.py"):
        bug(old, new).planted(root)


def test_figures_are_of_the_first_try_and_of_the_last() -> None:
    bugs = [bug("", "", name=name) for name in "abc"] + [bug("", "", "named", "d")]
    seen, unseen = {"commit": "1", "by": "tests/a.py::b"}, {"commit": "1", "by": None}
    tries = {"a": [seen], "b": [unseen, seen], "c": [unseen, unseen], "d": [unseen, seen]}
    table = planted.table(bugs, tries)
    assert [row[0] for row in table.rows] == ["first", "named", "all fresh ones", "core"]
    assert table.find("first", "noticed, %") == {"value": 33.3, "target": ">= 95"}
    assert table.find("core", "with the tests since, %") == 66.7
    assert table.find("named", "with the tests since, %") == 100.0


def test_intervals_are_wilsons() -> None:
    assert planted.wilson(10, 10) == pytest.approx((72.2, 100.0), abs=0.1)
    assert planted.wilson(1, 2) == pytest.approx((9.5, 90.5), abs=0.1)
