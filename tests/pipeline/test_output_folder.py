"""The journal and what is added up from it, whatever the number of episodes."""

import errno
import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest

from rpaug.core.errors import BadInput
from rpaug.core.fingerprint import Seal, sealed
from rpaug.pipeline import journal, report
from rpaug.pipeline.made import MadeEpisodes, Noted

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
        lines = journal.facts(root, held.made.of(""))
        seen = sum(len(line["facts"]["draws"]) for _, line in lines)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert seen == 2500 * count
    assert peaks[1] < 1.5 * peaks[0]  # nearly the same: the peak is one line as text and values


def test_a_line_that_was_cut_off_counts_as_none(tmp_path: Path) -> None:
    folder(tmp_path, 3)
    path = tmp_path / journal.NAME
    path.write_bytes(path.read_bytes()[:-50])
    assert [key for key, _ in journal.read(tmp_path).made.of("")] == ["0", "1"]
    journal.begin(tmp_path, MARKER, tmp_path)
    journal.append(tmp_path, [{"gone": "0", "in": ""}])
    assert [key for key, _ in journal.read(tmp_path).made.of("")] == ["1"]


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
    assert [(key, one.seal.size, one.loose) for key, one in held.made.of("")] == [
        ("0", 2, False),
        ("7", 6, False),
    ]
    assert held.shared == {"": {"a": (3, "x")}}
    assert [line["made"] for _, line in journal.facts(tmp_path, held.made.of(""))] == ["0", "2"]
    journal.append(tmp_path, [{"apart": True, "in": ""}])
    held = journal.read(tmp_path)
    assert all(one.loose for _, one in held.made.of(""))
    assert held.open == {""}


SEAL = {"files": 1, "size": 2, "names": "n"}
MADE = {"made": "5", "in": "", "source": "e", "copy": 1, "seal": SEAL, "report": 2}


@pytest.mark.parametrize(
    "line",
    [
        {"renamed": "5", "to": "6", "in": "", "seal": {}},
        {"sealed": "5", "in": "", "seal": SEAL},
        {"gone": 5},
        {"gone": "5", "in": ["rejected"]},
        MADE | {"copy": 2**70},
        MADE | {"seal": SEAL | {"size": [2]}},
        MADE | {"made": {}},
    ],
)
def test_a_line_of_another_kind_is_named(line: dict, tmp_path: Path) -> None:
    folder(tmp_path, 1)
    journal.append(tmp_path, [line])
    with pytest.raises(BadInput, match="a line of rpaug's journal"):
        journal.read(tmp_path)


def test_many_lines_are_written_as_they_are_one_by_one(tmp_path: Path) -> None:
    lines = [{"gone": str(number), "in": ""} for number in range(2 * journal.WRITTEN + 1)]
    journal.append(tmp_path, iter(lines))
    assert [line for _, line in journal.lines(tmp_path)] == lines


def test_entries_take_no_memory_for_their_number() -> None:
    """Beside the cache of the database, that stops growing, and is not seen by what Python counts."""
    entries, seal = MadeEpisodes(), Seal(1, 2, "n" * 32, "c" * 32)
    tracemalloc.start()
    for number in range(3000):
        entries["", f"task/episode{number}"] = Noted(f"task/episode{number // 4}", 1, seal, 9, 0)
    assert tracemalloc.get_traced_memory()[1] < 100_000
    assert [key for key, _ in entries.of("")] == [f"task/episode{n}" for n in range(3000)]
    tracemalloc.stop()
    assert (len(entries), entries.count("rejected")) == (3000, 0)


def test_entries_are_found_changed_and_taken_out_by_their_place() -> None:
    entries, one = MadeEpisodes(), Noted("e", 1, Seal(1, 2, "n"), 9, 0)
    for folder_ in ("", "rejected"):
        for key in ("10", "9", "09"):
            entries[folder_, key] = one
    entries.loosen("rejected", False)
    assert [key for key, _ in entries.of("rejected")] == ["09", "9", "10"]
    assert entries["", "9"] == one
    assert entries["rejected", "9"] == replace(one, loose=False)
    assert (entries.any_loose(""), entries.any_loose("rejected")) == (True, False)
    assert entries.pop(("", "9")) == one
    assert ("", "9") not in entries
    entries.discard(("", "9"))
    with pytest.raises(KeyError):
        entries.pop(("", "9"))
    assert sorted(entries.copies()) == [("e", 1)] * 5


def test_a_temporary_folder_that_is_full_is_told() -> None:
    entries = MadeEpisodes()
    entries._rows.execute("PRAGMA max_page_count = 8")

    def fill() -> None:
        for number in range(1000):
            entries["", str(number)] = Noted("e", 1, Seal(1, 2, "n" * 32), 9, 0)

    with pytest.raises(OSError, match="full") as caught:
        fill()
    assert caught.value.errno == errno.ENOSPC


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
