"""Seconds of the suite: each test's, its processes' among them, by folder, before and now in one table."""

import sys
from pathlib import Path

import pytest

from tools.bench import suite

MADE = """
import subprocess, sys, time

BUSY = "import time; end = time.process_time() + {}\\nwhile time.process_time() < end: pass"

def test_here():
    exec(BUSY.format(0.05))

def test_elsewhere():
    subprocess.run([sys.executable, "-S", "-c", BUSY.format(0.1)], check=True)
"""


def test_each_test_is_timed_with_the_processes_that_it_waits_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    (tmp_path / "test_made.py").write_text(MADE)
    where = [f"--rootdir={tmp_path}", "-c", str(tmp_path / "none.ini"), "-p", "no:cacheprovider"]
    (tmp_path / "none.ini").write_text("[pytest]\n")
    command = [sys.executable, "-m", "pytest", "-q", *where, str(tmp_path / "test_made.py")]
    seconds, tests = suite.tested(command)
    names = {name.split("::")[1]: taken for name, taken in tests.items()}
    assert names.keys() == {"test_here", "test_elsewhere"}
    assert names["test_here"] >= 0.05  # processor time that it surely takes
    assert names["test_elsewhere"] >= 0.1
    assert seconds >= sum(names.values())


def test_seconds_are_added_up_by_folder_or_by_file() -> None:
    tests = {"tests/core/a/test_a.py::one": 1.0, "tests/core/test_b.py::two": 2.0}
    tests |= {"tests/test_c.py::three": 5.0}
    folders = suite.grouped(10.0, tests)
    assert folders == {"starting": 2.0, "tests/test_c.py": 5.0, "tests/core": 3.0}
    assert list(folders) == ["starting", "tests/test_c.py", "tests/core"]
    files = suite.grouped(10.0, tests, by_file=True)
    assert files["tests/core/a/test_a.py"] == 1.0
    assert sum(files.values()) == 10.0


def test_a_column_is_written_beside_the_other_and_the_whole_has_its_target() -> None:
    before = suite.table(None, "before", {suite.WHOLE: 1500.0, "gone": 9.0}, [])
    assert before.rows[0] == [suite.WHOLE, "1500.0", "-"]
    now = suite.table(before, "now", {suite.WHOLE: 730.0, "new": 1.0}, [])
    assert now.rows[0][:2] == [suite.WHOLE, "1500.0"]
    assert list(now.misses()) == [f"{suite.WHOLE}, now: 730.0 (≤720)"]
    assert now.rows[1:] == [["new", "-", "1.0"]]
    assert now.seeds == before.seeds
    chosen = suite.table(None, "now", {"pytest": 3.0}, ["tests/core"])
    assert (chosen.id, chosen.command) == ("chosen", "python -m tools.bench.suite tests/core")
