"""The journal of an output: a line of JSON for each thing that was done there, written when it was done.

`rpaug.journal.jsonl` says of every episode what it was made from, what its files held when they were written, and what
the summary needs of its report, so that nobody has to read the output for it. Workers append to it as well: a line is
one write. A line that a power cut spoilt or took counts as none, and what it was about is made again.
"""

import json
import os
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput
from rpaug.core.fingerprint import Seal, of_file, sealed
from rpaug.pipeline import report
from rpaug.pipeline.made import MadeEpisodes, Noted, Place

NAME = "rpaug.journal.jsonl"
SYNC = 1.0  # seconds: what is noted within it after the last is made again if power fails
WRITTEN = 1000  # lines in one write
_last = [-SYNC]  # when this process waited last


@dataclass
class Journal:
    """What the lines come to: the run's marker, what is there, what shared files of each folder held (bytes, digest),
    and the folders whose episodes are being gathered or are apart again."""

    marker: dict[str, Any] | None = None
    made: MadeEpisodes = field(default_factory=MadeEpisodes)
    shared: dict[str, dict[str, tuple[int, str]]] = field(default_factory=dict)
    open: set[str] = field(default_factory=set)

    def add(self, line: Mapping[str, Any], at: int) -> None:
        """Take in a line that begins at a byte of the file. Raises KeyError, TypeError, ValueError for another's."""
        within = line.get("in", "")
        if "begun" in line:
            self.marker = dict(line["begun"])
        elif "made" in line:
            seal, source, copy = Seal(**line["seal"]), str(line["source"]), int(line["copy"])
            self.made[within, line["made"]] = Noted(source, copy, seal, int(line["report"]), at)
        elif "gone" in line:
            self.made.discard((within, line["gone"]))
        elif "renamed" in line:
            entry = self.made.pop((within, line["renamed"]))
            self.made[within, line["to"]] = replace(entry, seal=Seal(**line["seal"]))
        elif "sealed" in line:
            place = within, line["sealed"]
            self.made[place] = replace(self.made[place], seal=Seal(**line["seal"]))
        elif "shared" in line:
            held = int(line["bytes"]), str(line["contents"])
            self.shared.setdefault(within, {})[line["shared"]] = held
        elif "apart" in line or "gathering" in line:
            self.open.add(within)
            if "apart" in line:
                self.made.loosen(within, True)
            else:
                self.shared.pop(within, None)
        elif "gathered" in line:
            self.open.discard(within)
            self.made.loosen(within, False)


def append(target: Path, lines: Iterable[Mapping[str, Any]], durable: bool = True) -> None:
    """Add lines, a few in one write, and see them onto the disk if they are `durable`."""
    encoded = (json.dumps(line, ensure_ascii=False).encode() + b"\n" for line in lines)
    descriptor = os.open(target / NAME, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        while data := b"".join(islice(encoded, WRITTEN)):
            while data:
                data = data[os.write(descriptor, data) :]
        if durable:
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def begin(target: Path, marker: Mapping[str, Any], dataset: Path) -> None:
    """Say which run goes on here, and who runs it. A line that was cut off is ended."""
    path = target / NAME
    target.mkdir(parents=True, exist_ok=True)
    if path.exists() and path.stat().st_size:
        with path.open("r+b") as stream:
            stream.seek(-1, os.SEEK_END)
            if stream.read(1) != b"\n":
                stream.write(b"\n")
    who = {"host": socket.gethostname(), "pid": os.getpid(), "time": round(time.time(), 3)}
    append(target, [{"begun": dict(marker), "dataset": str(dataset), **who}])


def made(
    target: Path, place: Place, described: Mapping[str, Any], facts: Mapping[str, Any]
) -> None:
    """Say that an episode is there, by its report, and what the summary needs of that."""
    within, key = place
    folder = target / within / key
    line = {
        "made": key,
        "in": within,
        "source": described["source"],
        "copy": described["copy"],
        "seal": asdict(sealed(folder)),
        "report": (folder / report.NAME).stat().st_size,
        "node": socket.gethostname(),
        "facts": dict(facts),
    }
    append(target, [line], durable=due())


def due() -> bool:
    """Whether the disk was last waited for more than `SYNC` ago by this process."""
    now = time.monotonic()
    if now - _last[0] < SYNC:
        return False
    _last[0] = now
    return True


def shared(root: Path, within: str, path: str) -> dict[str, Any]:
    """The line about a file that belongs to no single episode; `root` is the folder that the path lies in."""
    held = (root / path).stat().st_size
    return {"shared": path, "in": within, "bytes": held, "contents": of_file(root / path)}


def read(target: Path) -> Journal:
    """What the journal of an output says, line by line. Raises BadInput where there is none."""
    found = Journal()
    for at, line in lines(target):
        try:
            found.add(line, at)
        except (KeyError, TypeError, ValueError) as error:
            expected = "a line of rpaug's journal"
            raise BadInput(
                target / NAME, f"byte {at}", found=repr(error), expected=expected
            ) from None
    if found.marker is None:
        expected = "the --out of a run of rpaug"
        raise BadInput(target / NAME, "--out", found="no run of rpaug here", expected=expected)
    return found


def begun(target: Path) -> dict[str, Any]:
    """The line that says which run goes on in an output, and on which dataset; nothing where there is no journal."""
    return next((line for _, line in lines(target) if "begun" in line), {})


def marker(target: Path) -> dict[str, Any] | None:
    """What tells the run of an output from others; None where there is no journal."""
    return begun(target).get("begun")


def lines(target: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """The lines that can be read, each with the byte that it begins at."""
    try:
        stream = (target / NAME).open("rb")
    except OSError:
        return
    with stream:
        at = 0
        for data in stream:
            try:
                given = json.loads(data)
            except ValueError:
                given = None
            if isinstance(given, dict):
                yield at, given
            at += len(data)


def facts(
    target: Path, entries: Iterable[tuple[str, Noted]]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The line of each entry, one in memory at a time."""
    with (target / NAME).open("rb") as stream:
        for key, entry in entries:
            stream.seek(entry.at)
            yield key, json.loads(stream.readline())
