"""The journal and what is added up from it, whatever the number of episodes."""

import tracemalloc
from pathlib import Path

import pytest

from rpaug.core.errors import BadInput
from rpaug.core.fingerprint import sealed
from rpaug.pipeline import journal, report

MARKER = {"version": "0"}


def folder(root: Path, count: int) -> None:
    """An output whose journal has as many episodes; what the summary needs of each fills some 100 kB."""
    described = {"source": "e", "copy": 1}
    facts = {"draws": [[0, 0, None, {f"{n} things found no room": [n, n]}] for n in range(2500)]}
    journal.begin(root, MARKER, root)
    for number in range(count):
        (root / str(number)).mkdir()
        (root / str(number) / report.NAME).write_text("{}")
        journal.made(root, ("", str(number)), described, facts)


def test_one_line_is_in_memory_however_many_there_are(tmp_path: Path) -> None:
    peaks = []
    for count in (2, 40):
        root = tmp_path / str(count)
        folder(root, count)
        tracemalloc.start()
        held = journal.read(root)
        lines = journal.facts(root, held.of(""))
        seen = sum(len(line["facts"]["draws"]) for _, line in lines)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert seen == 2500 * count
    assert peaks[1] < 1.5 * peaks[0]  # nearly the same: the peak is one line as text and values


def test_a_line_that_was_cut_off_counts_as_none(tmp_path: Path) -> None:
    folder(tmp_path, 3)
    path = tmp_path / journal.NAME
    path.write_bytes(path.read_bytes()[:-50])
    assert [key for key, _ in journal.read(tmp_path).of("")] == ["0", "1"]
    journal.begin(tmp_path, MARKER, tmp_path)
    journal.append(tmp_path, [{"gone": "0", "in": ""}])
    assert [key for key, _ in journal.read(tmp_path).of("")] == ["1"]


def test_later_lines_count(tmp_path: Path) -> None:
    folder(tmp_path, 3)
    (tmp_path / "2").rename(tmp_path / "7")
    (tmp_path / "7/more").write_bytes(b"more")
    seal = {"files": 2, "size": 6, "names": "n", "contents": "c"}
    lines = [
        {"renamed": "2", "to": "7", "in": "", "seal": seal},
        {"gone": "1", "in": ""},
        {"shared": "a", "in": "", "bytes": 3, "contents": "x"},
        {"gathered": True, "in": ""},
    ]
    journal.append(tmp_path, lines)
    held = journal.read(tmp_path)
    assert [(key, one.seal.size, one.loose) for key, one in held.of("")] == [
        ("0", 2, False),
        ("7", 6, False),
    ]
    assert held.shared == {"": {"a": (3, "x")}}
    assert [line["made"] for _, line in journal.facts(tmp_path, held.of(""))] == ["0", "2"]
    journal.append(tmp_path, [{"apart": True, "in": ""}])
    held = journal.read(tmp_path)
    assert all(one.loose for _, one in held.of(""))
    assert held.open == {""}


def test_a_line_of_another_kind_is_named(tmp_path: Path) -> None:
    folder(tmp_path, 1)
    journal.append(tmp_path, [{"renamed": "5", "to": "6", "in": "", "seal": {}}])
    with pytest.raises(BadInput, match="a line of rpaug's journal"):
        journal.read(tmp_path)


def test_a_seal_tells_names_sizes_and_bytes(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in/a").write_bytes(b"one")
    (tmp_path / ".b").write_bytes(b"three")
    first = sealed(tmp_path)
    assert (first.files, first.size) == (2, 8)
    assert sealed(tmp_path) == first
    (tmp_path / "in/a").write_bytes(b"two")
    other = sealed(tmp_path)
    assert (other.names, other.contents != first.contents) == (first.names, True)
    (tmp_path / "in/a").rename(tmp_path / "in/c")
    assert sealed(tmp_path, read=False).names != first.names
