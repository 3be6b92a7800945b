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
OTHERS = """from rpaug.pages import sums

def test_that_fails_anyway():
    assert sums.numbers.half(2) == 3

def test_half():
    assert sums.numbers.half(1) == 0.5
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
        "tests/pages/test_sums.py": OTHERS,
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


def test_stages_begin_with_the_nearest(root: Path) -> None:
    assert planted.stages("rpaug/core/numbers.py", root) == [
        ["tests/core/test_all.py"],
        ["tests/core/test_else.py"],
        ["tests/pages/test_sums.py"],
    ]
    assert planted.stages("rpaug/pages/sums.py", root)[0] == ["tests/pages/test_sums.py"]


def test_those_that_nothing_near_tells_are_planted_at_once(root: Path, tmp_path: Path) -> None:
    """Two of one file; a test that fails with both is held against each."""
    place = ThrownAway(root, tmp_path)
    half, doubled = bug("number / 2", "number // 2", name="halved"), bug("2 * number", "3 * number")
    assert planted.noticed(half, place) is None
    assert list(planted.noticed_by_others([doubled, half], place)) == [
        (half, "tests/pages/test_sums.py::test_half"),
        (doubled, None),
    ]
    named = ["tests/core/test_all.py"]
    (told,) = planted.noticed_by_others([doubled], place, named)
    assert told == (doubled, "tests/core/test_all.py::test_double")
    assert (place.copy / "rpaug/core/numbers.py").read_text() == CODE


@pytest.mark.parametrize(
    ("old", "new"), [("number", "numbers"), ("no such text", ""), ("2 * number", "2 * number")]
)
def test_a_place_that_is_not_one_is_refused(root: Path, old: str, new: str) -> None:
    with pytest.raises(ValueError, match=r"doubled: . places in rpaug/core/numbers.py"):
        bug(old, new).planted(root)


def test_figures_are_of_the_first_try_and_of_the_last() -> None:
    bugs = [bug("", "", name=name) for name in "abc"] + [bug("", "", "named", "d")]
    seen, unseen = {"commit": "1", "by": "tests/a.py::b"}, {"commit": "1", "by": None}
    later = {"commit": "2", "by": "tests/a.py::b"}
    tries = {"a": [unseen, seen], "b": [unseen, later], "c": [unseen, unseen], "d": [unseen, later]}
    known = [["first", 1, 0.0, "", 0.0], ["an earlier part", 4, 50.0, "15 to 85", 100.0]]
    table = planted.table(bugs, tries, known)
    assert [row[0] for row in table.rows] == ["first", "an earlier part", "named"]
    assert table.find("first", "noticed, %") == {"value": 33.3, "target": ">= 95"}
    assert table.find("first", "with the tests since, %") == 66.7
    assert table.find("named", "with the tests since, %") == 100.0


def test_intervals_are_wilsons() -> None:
    assert planted.wilson(10, 10) == pytest.approx((72.2, 100.0), abs=0.1)
    assert planted.wilson(1, 2) == pytest.approx((9.5, 90.5), abs=0.1)
