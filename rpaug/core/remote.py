"""Datasets and outputs in an object store, named by an fsspec URL (`s3://bucket/open_drawer`): a copy on this machine
is worked on, and what was written there is sent when it is done.

Copies lie in the cache's folder under `remote`, beside what is kept below a size. They are brought up to date file by
file, and never go by themselves: an output may hold what was not sent yet.
"""

import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from rpaug.core import cache, fingerprint
from rpaug.core.errors import BadInput, MissingExtra, RpaugError
from rpaug.core.files import PART, natural, write_atomic
from rpaug.core.owner import owned

KIND = "remote"
VERSIONS = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "created")  # change with a file
Version = list[Any] | None  # of a file: its size, and what changes with it


def is_url(given: object) -> bool:
    """Whether a dataset or an output is named by a URL."""
    return "://" in str(given)


def is_copy(path: Path) -> bool:
    """Whether a path is a copy's, which no other machine sees."""
    return path.is_relative_to(cache.root() / KIND)


class RemoteFolder:
    """What lies at a URL, and its copy here. Raises RpaugError where the store cannot be reached."""

    def __init__(self, url: str) -> None:
        names = [name for name in url.partition("://")[2].split("/") if name]
        if not names or {".", ".."} & {*names}:
            raise BadInput(Path(url), "URL", found="no path", expected="as s3://bucket/folder")
        self.url = url
        # hidden: no entry of the cache, which would count it and throw other things out for it
        self._home = cache.root() / KIND / f".{fingerprint.of(url.encode())}"
        self.folder = self._home.joinpath("files", *names[-2:])
        """The copy; it may not be there yet. Its last names are those of the URL."""

    def is_there(self) -> bool:
        """Whether the store holds anything there."""
        with _told(self.url):
            return bool(self._versions())

    def fetch(self, keep: bool = False) -> Path:
        """Bring the copy up to date, and return it. What was changed or added here since it was fetched or sent is
        fetched anew, or stays if that is to be `keep`-ed.

        Raises BadInput where nothing lies there, and where a file to be kept was changed there as well.
        """
        with self._state() as state, _told(self.url):
            there = self._versions()
            if not there:
                found, expected = "nothing there", "a folder with files"
                raise BadInput(Path(self.url), "URL", found=found, expected=expected)
            for name, version in there.items():
                known, here = state.get(name, [None, None]), _here(self.folder / name)
                if version == known[0] and here is not None and (keep or here == known[1]):
                    continue
                if keep and here is not None and here != known[1]:
                    found, expected = "changed here and there", "changed in one place"
                    raise BadInput(self.folder / name, self.url, found=found, expected=expected)
                self._get(name)
                state[name] = [version, _here(self.folder / name)]
            for name in state.keys() - there.keys():
                (self.folder / name).unlink(missing_ok=True)
                del state[name]
        return self.folder

    def send(self, last: Collection[str] = ()) -> int:
        """Bring the store to what the copy holds, files called `last` after all others; what others put there stays.
        Returns how many were sent."""
        sent = 0
        with self._state() as state, _told(self.url):
            there, paths = self._versions(), self.folder.rglob("*")
            held = {p.relative_to(self.folder).as_posix() for p in paths if p.is_file()}
            for name in sorted(held, key=lambda name: (name in last, natural(name))):
                here = _here(self.folder / name)
                if name not in there or here != state.get(name, [None, None])[1]:
                    self._put(name)
                    state[name] = [None, here]
                    sent += 1
            for name in state.keys() - held:
                if name in there:
                    self._store.rm_file(f"{self._root}/{name}")
                del state[name]
            for name, version in self._versions().items():
                if name in state:
                    state[name][0] = version
        return sent

    @cached_property
    def _at(self) -> tuple[Any, str]:
        """The file system of the URL, and the path there."""
        try:
            from fsspec.core import url_to_fs
        except ImportError:
            raise MissingExtra("fsspec", "remote") from None
        store, root = url_to_fs(self.url, use_listings_cache=False)
        return store, root.rstrip("/")

    @property
    def _store(self) -> Any:
        return self._at[0]

    @property
    def _root(self) -> str:
        return self._at[1]

    def _versions(self) -> dict[str, Version]:
        """The store's files by their names in the folder. Raises BadInput for names that lead out of it."""
        found: dict[str, Version] = {}
        for path, about in self._store.find(self._root, detail=True).items():
            name = path.removeprefix(f"{self._root}/")
            if name == path or {"", ".", ".."} & {*name.split("/")}:
                expected = "a folder with files in it"
                raise BadInput(Path(self.url), "URL", found=path, expected=expected)
            changes = next((about[one] for one in VERSIONS if one in about), None)
            found[name] = [about.get("size"), str(changes)]
        return found

    def _get(self, name: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}{PART}")
        self._store.get_file(f"{self._root}/{name}", str(part))
        part.replace(path)

    def _put(self, name: str) -> None:
        goal = f"{self._root}/{name}"
        self._store.makedirs(str(PurePosixPath(goal).parent), exist_ok=True)
        self._store.put_file(str(self.folder / name), goal)

    @contextmanager
    def _state(self) -> Iterator[dict[str, list[Version]]]:
        """What each file was, there and here, when it was last fetched or sent; noted however the work ends."""
        path = self._home / "state.json"
        with owned(self._home):
            try:
                state: dict[str, list[Version]] = json.loads(path.read_bytes())
            except (OSError, ValueError):
                state = {}
            try:
                yield state
            finally:
                write_atomic(path, json.dumps(state).encode())


def _here(path: Path) -> Version:
    """Size and time of a file; None where there is none."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return [status.st_size, status.st_mtime_ns]


@contextmanager
def _told(url: str) -> Iterator[None]:
    """Whatever a store raises becomes an RpaugError: each has errors of its own."""
    try:
        yield
    except RpaugError:
        raise
    except Exception as error:
        raise RpaugError(f"{url}: {str(error) or type(error).__name__}") from error
