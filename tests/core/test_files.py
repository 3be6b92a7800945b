"""Files that are whole or absent."""

import errno
import os
import re
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug import BadInput
from rpaug.core.files import (
    atomic_folder,
    flush,
    leads_out,
    natural,
    read_bytes,
    write_atomic,
)


def test_a_folder_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b"

    def fail() -> None:
        with atomic_folder(target) as work:
            (work / "half").write_text("x")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not list((tmp_path / "a").iterdir())
    with atomic_folder(target) as work:
        (work / "whole").write_text("x")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["whole"]
    with pytest.raises(BadInput, match="does not exist"), atomic_folder(target):
        pass


def test_a_folder_is_on_the_disk_before_it_appears(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, done = tmp_path / "out/episode0", []
    sync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        done.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        sync(descriptor)

    def renamed(home: Path, goal: Path) -> None:
        done.append(f"{home} -> {goal}")
        replace(home, goal)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", renamed)
    with atomic_folder(target) as work:
        (work / "front").mkdir()
        (work / "front/0.png").write_bytes(b"0")
        (work / "report").write_bytes(b"1")
    written = {f"{work}/front/0.png", f"{work}/report", f"{work}/front", f"{work}"}
    assert set(done[:4]) == written
    assert done[3:] == [f"{work}", f"{work} -> {target}", f"{target.parent}"]


@pytest.mark.parametrize("code", [errno.EINVAL, errno.ENOTSUP, errno.EIO, errno.ENOSPC])
def test_a_file_system_that_cannot_sync_folders_is_no_fault(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any other error is one, and every error is one for a file."""
    sync = os.fsync

    def refused(descriptor: int, folders: bool = True) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode) == folders:
            raise OSError(code, os.strerror(code))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", refused)
    target = tmp_path / "episode0"
    if code in (errno.EINVAL, errno.ENOTSUP):
        with atomic_folder(target) as work:
            (work / "0.png").write_bytes(b"0")
        assert [path.name for path in target.iterdir()] == ["0.png"]
    else:
        with pytest.raises(OSError, match=re.escape(os.strerror(code))):
            flush(tmp_path)
    (tmp_path / "1.png").write_bytes(b"1")
    monkeypatch.setattr(os, "fsync", lambda descriptor: refused(descriptor, folders=False))
    with pytest.raises(OSError, match=re.escape(os.strerror(code))):
        flush(tmp_path / "1.png")


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    write_atomic(tmp_path / "x", b"1")
    write_atomic(tmp_path / "x", b"2")
    assert (tmp_path / "x").read_bytes() == b"2"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_pipe_or_a_folder_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "3.png")
    with pytest.raises(BadInput, match=r"3\.png.*a pipe, a socket or a device.*a regular file"):
        read_bytes(tmp_path / "3.png")
    with pytest.raises(BadInput, match="a folder"):
        read_bytes(tmp_path)


@pytest.mark.parametrize("durable", [False, True])
def test_what_is_written_is_whole(tmp_path: Path, durable: bool) -> None:
    for data in (b"one", b"other"):
        write_atomic(tmp_path / "report.json", data, durable)
        assert (tmp_path / "report.json").read_bytes() == data
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


def test_a_file_is_never_half_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who reads meanwhile reads the old one to its end, and what fails leaves the old one."""
    path = tmp_path / "a.json"
    write_atomic(path, b"old" * 50_000)
    with path.open("rb") as reading:
        assert reading.read(3) == b"old"
        write_atomic(path, b"new")
        assert reading.read() == b"old" * 49_999
    assert path.read_bytes() == b"new"

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        write_atomic(path, b"newer")
    assert [(one.name, one.read_bytes()) for one in tmp_path.iterdir()] == [("a.json", b"new")]


@given(st.lists(st.text("ab/._-9081\u0663", max_size=8), max_size=12))
def test_numbers_in_keys_count_as_numbers(keys: list[str]) -> None:
    def parts(key: str) -> list[tuple[int, str]]:
        found = re.split(r"(\d+)", key)
        return [(int(part), "") if part.isdecimal() else (-1, part) for part in found]

    assert sorted(keys, key=natural) == sorted(keys, key=parts)


def test_where_a_path_of_a_dataset_leads(tmp_path: Path) -> None:
    root, beside = tmp_path / "data", tmp_path / "data2"
    for folder in (root / "deep", beside):
        folder.mkdir(parents=True)
        (folder / "file").write_text("x")
    links = {
        "in": root / "deep/file",
        "again": root / "in",
        "beside": beside / "file",  # its path begins like the root's
        "back": Path("../data2/../data/deep/file"),
        "up": Path("../data2/file"),
        "nowhere": tmp_path / "nowhere",
        "folder": beside,
    }
    for name, target in links.items():
        (root / name).symlink_to(target)
    found = {name for name in links if leads_out(root, root / name) is not None}
    assert found == {"beside", "up", "nowhere", "folder"}
    assert leads_out(root, root / "folder/file") == str(beside / "file")
    assert leads_out(root, root / "not_there") is None
    (tmp_path / "link").symlink_to(root)
    assert leads_out(tmp_path / "link", tmp_path / "link/deep/file") is None
