"""Is an output what was written? Every byte against the journal, and what was done to one episode."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput
from rpaug.core.files import REJECTED
from rpaug.core.fingerprint import of_file, sealed
from rpaug.pipeline import journal, report
from rpaug.pipeline.journal import Journal
from rpaug.pipeline.made import Noted, Place
from rpaug.pipeline.output_folder import FOLDERS


@dataclass
class Audit:
    """How many episodes and shared files were read, what is not as it was written, and the report and the node of the
    one episode that was asked for."""

    episodes: int = 0
    files: int = 0
    faults: dict[str, str] = field(default_factory=dict)
    report: dict[str, Any] | None = None
    node: str | None = None


def audit(
    target: Path,
    episode: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Audit:
    """Read all that an output holds, or one episode's own folder, and compare it with the journal. Keys of rejected
    copies begin with `rejected/`.

    Raises BadInput where there is no journal, or no such episode.
    """
    held, found = journal.read(target), Audit()
    if episode is not None:
        _one(target, held, found, episode)
        return found
    total = len(held.made)
    for folder in FOLDERS:
        for key, one in held.made.of(folder):
            progress(found.episodes, total)
            _compare(target, held, found, (folder, key), one)
    progress(found.episodes, total)
    _shared(target, held, found)
    return found


def _one(target: Path, held: Journal, found: Audit, episode: str) -> None:
    """Compare one episode, and say what was done to it. Raises BadInput where there is none of that name."""
    apart = episode.startswith(f"{REJECTED}/")
    place = (REJECTED, episode.removeprefix(f"{REJECTED}/")) if apart else ("", episode)
    if place not in held.made:
        known = ", ".join(key for key, _ in islice(held.made.of(""), 5))
        raise BadInput(target, "episode", found=episode, expected=f"one of: {known}, ...")
    one = held.made[place]
    _compare(target, held, found, place, one)
    found.report = report.of(target / episode)
    ((_, line),) = journal.facts(target, [(episode, one)])
    found.node = line.get("node")


def _compare(target: Path, held: Journal, found: Audit, place: Place, one: Noted) -> None:
    found.episodes += 1
    if fault := _fault(target, held, place[0], place[1], one):
        found.faults["/".join(filter(None, place))] = fault


def _fault(target: Path, held: Journal, within: str, key: str, one: Noted) -> str | None:
    if within in held.open and one.loose:
        return "its run was stopped while episodes were gathered: go on with it by --resume"
    now = sealed(target / within / key)
    if now == one.seal:
        return None
    if (now.files, now.size) != (one.seal.files, one.seal.size):
        was = f"{one.seal.files} files of {one.seal.size} bytes"
        return f"found {now.files} files of {now.size} bytes; expected {was}, as were written"
    return "found other names or bytes than were written, of the same size"


def _shared(target: Path, held: Journal, found: Audit) -> None:
    """Compare files that belong to no single episode."""
    for within, named in held.shared.items():
        for name, (size, digest) in named.items():
            path = target / within / name
            found.files += 1
            if not path.is_file():
                fault = "found nothing; expected the file that was written"
            elif path.stat().st_size != size:
                fault = f"found {path.stat().st_size} bytes; expected {size}, as were written"
            elif of_file(path) != digest:
                fault = "found other bytes than were written, as many"
            else:
                continue
            found.faults[f"{within}/{name}" if within == REJECTED else name] = fault
