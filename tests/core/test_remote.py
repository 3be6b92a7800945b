"""Copies of what lies in an object store: brought up to date, sent back, never mixed up."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.remote import RemoteFolder, is_copy, is_url

fsspec = pytest.importorskip("fsspec", reason="the extra `remote` is not installed")

URL = "memory://bucket/train/open_drawer"


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> fsspec.AbstractFileSystem:
    """A store with three files."""
    monkeypatch.setenv("RPAUG_CACHE", str(tmp_path / "cache"))
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    for name in ("a", "in/b", "in/c"):
        memory.pipe_file(f"/bucket/train/open_drawer/{name}", name.encode())
    return memory


def held(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_urls_are_told_from_paths() -> None:
    assert [is_url(one) for one in (URL, "s3://b/x", "data/x", Path("s3:/b"))] == [
        True,
        True,
        False,
        False,
    ]
    for url in ("memory://", "s3://bucket/../x"):
        with pytest.raises(BadInput, match="as s3://bucket/folder"):
            RemoteFolder(url)


def test_a_copy_follows_the_store(store: fsspec.AbstractFileSystem) -> None:
    folder = RemoteFolder(URL).fetch()
    assert folder.parts[-2:] == ("train", "open_drawer")
    assert is_copy(folder)
    assert held(folder) == {"a": b"a", "in/b": b"in/b", "in/c": b"in/c"}
    before = (folder / "in/c").stat().st_mtime_ns
    store.pipe_file("/bucket/train/open_drawer/a", b"other")
    store.rm_file("/bucket/train/open_drawer/in/b")
    (folder / "more").touch()
    assert held(RemoteFolder(URL).fetch()) == {"a": b"other", "in/c": b"in/c", "more": b""}
    assert (folder / "in/c").stat().st_mtime_ns == before  # not fetched again
    (folder / "in/c").write_bytes(b"spoilt here")
    assert RemoteFolder(URL).fetch() == folder
    assert (folder / "in/c").read_bytes() == b"in/c"


def test_what_was_done_here_is_kept_and_sent_once(
    store: fsspec.AbstractFileSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = RemoteFolder(URL).fetch()
    (folder / "in/c").write_bytes(b"here")
    (folder / "in/b").unlink()
    (folder / "summary").write_bytes(b"s")
    (folder / "z").write_bytes(b"z")
    RemoteFolder(URL).fetch(keep=True)
    assert held(folder)["in/c"] == b"here"
    (folder / "in/b").unlink(missing_ok=True)
    store.pipe_file("/bucket/train/open_drawer/theirs", b"t")
    order, put = [], type(store).put_file

    def noted(self: fsspec.AbstractFileSystem, home: str, goal: str) -> None:
        order.append(goal.rpartition("/")[2])
        put(self, home, goal)

    monkeypatch.setattr(type(store), "put_file", noted)
    assert RemoteFolder(URL).send(last=("summary",)) == 3
    assert RemoteFolder(URL).send(last=("summary",)) == 0
    assert order == ["c", "z", "summary"]
    names = {one.removeprefix("/bucket/train/open_drawer/") for one in store.find("/bucket")}
    assert names == {"a", "in/c", "summary", "z", "theirs"}
    assert store.cat_file("/bucket/train/open_drawer/in/c") == b"here"


def test_changes_here_and_there_are_refused(store: fsspec.AbstractFileSystem) -> None:
    folder = RemoteFolder(URL).fetch()
    (folder / "a").write_bytes(b"here")
    store.pipe_file("/bucket/train/open_drawer/a", b"there")
    with pytest.raises(BadInput, match="changed here and there"):
        RemoteFolder(URL).fetch(keep=True)
    assert (folder / "a").read_bytes() == b"here"


@pytest.mark.parametrize("name", ["x/../../../out", "", "./x"])
def test_a_name_that_leads_out_is_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    remote = RemoteFolder(URL)
    root = "/bucket/train/open_drawer"
    found = SimpleNamespace(find=lambda root, detail: {f"{root}/{name}": {"size": 1}})
    monkeypatch.setitem(remote.__dict__, "_at", (found, root))
    with pytest.raises(BadInput, match="a folder with files in it"):
        remote.fetch()


def test_what_cannot_be_reached_is_told_in_one_line() -> None:
    with pytest.raises(BadInput, match="nothing there"):
        RemoteFolder("memory://bucket/nowhere").fetch()
    with pytest.raises(RpaugError, match=r"nonsense://b/x: .*nonsense"):
        RemoteFolder("nonsense://b/x").fetch()
