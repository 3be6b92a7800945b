"""Is an output what was written? Every byte against the journal, and what was done to one episode."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput
from rpaug.core.files import REJECTED
from rpaug.core.fingerprint import of_file, sealed
from rpaug.pipeline import journal, report
from rpaug.pipeline.journal import Journal, Noted


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
    entries = {f"{within}/{key}" if within else key: (within, key) for within, key in held.made}
    if episode is not None:
        if episode not in entries:
            known = ", ".join([*entries][:5])
            raise BadInput(target, "episode", found=episode, expected=f"one of: {known}, ...")
        entries = {episode: entries[episode]}
        found.report = report.of(target / episode)
    for number, (name, place) in enumerate(entries.items()):
        progress(number, len(entries))
        found.episodes += 1
        if fault := _fault(target, held, place[0], place[1], held.made[place]):
            found.faults[name] = fault
    progress(len(entries), len(entries))
    if episode is None:
        _shared(target, held, found)
    else:
        ((_, line),) = journal.facts(target, [(episode, held.made[entries[episode]])])
        found.node = line.get("node")
    return found


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
