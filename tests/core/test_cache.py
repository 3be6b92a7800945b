"""The one cache: where things lie, what is used last stays, what was fetched or is in use is not thrown out."""

import os
import time
from pathlib import Path

import pytest

from rpaug.core import cache
from rpaug.core.errors import RpaugError
from rpaug.core.files import write_atomic


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RPAUG_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("RPAUG_CACHE_GB", raising=False)
    return tmp_path / "cache"


def put(kind: str, name: str, size: int, days: float) -> Path:
    """A folder of one file that was last used so many days ago."""
    path = cache.place(kind, name)
    write_atomic(path / "data", bytes(size))
    long_ago = time.time() - 86400 * days
    os.utime(path, (long_ago, long_ago))
    return path


def names() -> list[str]:
    return [entry.name for entry in cache.entries()]


def test_a_cache_that_does_not_exist_is_empty(root: Path) -> None:
    assert cache.root() == root
    assert cache.entries() == []
    assert cache.trim() == []
    assert not root.exists()


def test_by_default_it_lies_in_the_users_cache_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RPAUG_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.root().name == "rpaug"


def test_entries_are_files_and_folders_by_kind_the_last_used_first(root: Path) -> None:
    put("videos", "old", 30, days=9)
    put("videos", "new", 20, days=1)
    write_atomic(cache.place("weights", "w.npz"), bytes(5))
    found = cache.entries()
    assert [(one.kind, one.name, one.bytes) for one in found] == [
        ("weights", "w.npz", 5),
        ("videos", "new", 20),
        ("videos", "old", 30),
    ]
    assert found[2].days == pytest.approx(9, abs=0.01)


def test_to_ask_for_an_entry_is_to_use_it(root: Path) -> None:
    put("videos", "a", 1, days=5)
    put("videos", "b", 1, days=2)
    assert names() == ["b", "a"]
    assert cache.place("videos", "a") == root / "videos" / "a"
    assert names() == ["a", "b"]


def test_what_is_unfinished_is_no_entry(root: Path) -> None:
    (root / "videos").mkdir(parents=True)
    (root / "videos" / ".half-x.part").write_bytes(b"x")
    assert names() == []


def test_trim_takes_what_was_used_longest_ago_and_no_more(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, days in (("a", 4), ("b", 3), ("c", 2), ("d", 1)):
        put("videos", name, 400, days)
    monkeypatch.setenv("RPAUG_CACHE_GB", "1e-6")  # 1000 bytes
    assert [entry.name for entry in cache.trim()] == ["a", "b"]
    assert names() == ["d", "c"]
    assert cache.trim() == []


def test_trim_spares_what_it_is_told_to_and_what_was_fetched(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put("weights", "fetched", 400, days=9)
    mine = put("videos", "mine", 400, days=8)
    put("videos", "other", 400, days=1)
    monkeypatch.setenv("RPAUG_CACHE_GB", "0")
    assert [entry.name for entry in cache.trim(keep=[mine])] == ["other"]
    assert sorted(names()) == ["fetched", "mine"]


def test_removing_leaves_nothing_behind(root: Path) -> None:
    put("videos", "a", 10, days=1)
    write_atomic(cache.place("videos", "b"), bytes(3))
    for entry in cache.entries():
        cache.remove(entry)
    assert list((root / "videos").iterdir()) == []


@pytest.mark.parametrize("stated", ["much", "-1", "inf", "nan"])
def test_a_limit_that_is_none_is_refused(
    root: Path, monkeypatch: pytest.MonkeyPatch, stated: str
) -> None:
    monkeypatch.setenv("RPAUG_CACHE_GB", stated)
    with pytest.raises(RpaugError, match="expected gigabytes"):
        cache.limit()


def test_the_limit_is_twenty_gigabytes(root: Path) -> None:
    assert cache.limit() == 20_000_000_000
