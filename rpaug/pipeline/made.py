"""The episodes that a journal names, in a temporary database: memory does not grow with their number."""

import errno
import sqlite3
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from rpaug.core.files import natural
from rpaug.core.fingerprint import Seal

Place = tuple[str, str]  # a folder of the output ("", or that of rejected copies), and a key there
CACHE = 16  # MB of the database that are kept in memory
TABLE = """
    CREATE TABLE made (
        folder TEXT, place BLOB, key TEXT, source TEXT, copy INT, report INT, at INT, loose INT,
        files INT, size INT, names TEXT, contents TEXT, PRIMARY KEY (folder, place, key)
    ) WITHOUT ROWID
"""
ONE = "WHERE folder = ? AND place = ? AND key = ?"
ENTRY = "source, copy, report, at, loose, files, size, names, contents"


@dataclass(frozen=True, slots=True)
class Noted:
    """An episode that was made: from what, the seal of its folder, the bytes of its report, where its line begins.

    It is `loose` until it was gathered: its files may be brought into shared ones.
    """

    source: str
    copy: int
    seal: Seal
    report: int
    at: int
    loose: bool = True


class MadeEpisodes:
    """Entries by place. What iterates must have come to its end before entries are changed."""

    def __init__(self) -> None:
        self._rows = sqlite3.connect("", isolation_level=None)  # "": a file that goes with it
        self._rows.execute(f"PRAGMA cache_size = {-1000 * CACHE}")
        self._rows.execute("PRAGMA journal_mode = OFF")
        self._rows.execute(TABLE)
        self._rows.execute("BEGIN")  # never ended: nobody else reads it

    def __len__(self) -> int:
        return int(self._run("SELECT count(*) FROM made").fetchone()[0])

    def __contains__(self, place: Place) -> bool:
        return self._found("1", place) is not None

    def __getitem__(self, place: Place) -> Noted:
        row = self._found(ENTRY, place)
        if row is None:
            raise KeyError(place)
        return _entry(row)

    def __setitem__(self, place: Place, one: Noted) -> None:
        seal = one.seal
        entry = one.source, one.copy, one.report, one.at, one.loose
        row = (*_at(place), *entry, seal.files, seal.size, seal.names, seal.contents)
        self._run(f"INSERT OR REPLACE INTO made VALUES ({','.join('?' * len(row))})", row)

    def pop(self, place: Place) -> Noted:
        """Take an entry out. Raises KeyError."""
        entry = self[place]
        self.discard(place)
        return entry

    def discard(self, place: Place) -> None:
        """Take an entry out if it is there."""
        self._run(f"DELETE FROM made {ONE}", _at(place))

    def loosen(self, folder: str, loose: bool) -> None:
        """Say of all entries of a folder whether they are loose."""
        self._run("UPDATE made SET loose = ? WHERE folder = ?", (loose, folder))

    def any_loose(self, folder: str) -> bool:
        """Whether one entry of a folder is."""
        asked = "SELECT 1 FROM made WHERE folder = ? AND loose LIMIT 1"
        return self._run(asked, (folder,)).fetchone() is not None

    def count(self, folder: str) -> int:
        """Entries of a folder."""
        asked = "SELECT count(*) FROM made WHERE folder = ?"
        return int(self._run(asked, (folder,)).fetchone()[0])

    def of(self, folder: str) -> Iterator[tuple[str, Noted]]:
        """Keys and entries of a folder, in natural order."""
        asked = f"SELECT key, {ENTRY} FROM made WHERE folder = ? ORDER BY place, key"
        return ((key, _entry(row)) for key, *row in self._run(asked, (folder,)))

    def copies(self) -> Iterator[tuple[str, int]]:
        """The source and the copy number of each entry."""
        rows = self._run("SELECT source, copy FROM made")
        return ((sys.intern(source), copy) for source, copy in rows)

    def _run(self, asked: str, values: Sequence[Any] = ()) -> sqlite3.Cursor:
        """Raises TypeError for values that are none of an entry's, and OSError where there is no room for it."""
        try:
            return self._rows.execute(asked, values)
        except (sqlite3.InterfaceError, sqlite3.ProgrammingError, OverflowError) as error:
            raise TypeError(str(error)) from None
        except sqlite3.OperationalError as error:
            raise OSError(errno.ENOSPC, str(error), tempfile.gettempdir()) from None

    def _found(self, columns: str, place: Place) -> Sequence[Any] | None:
        row: Sequence[Any] | None = self._run(
            f"SELECT {columns} FROM made {ONE}", _at(place)
        ).fetchone()
        return row


def _at(place: Place) -> tuple[str, bytes, str]:
    folder, key = place
    return folder, natural(key).encode(), key


def _entry(row: Sequence[Any]) -> Noted:
    source, copy, report, at, loose, *seal = row
    return Noted(source, copy, Seal(*seal), report, at, bool(loose))
