"""The output folder of a run: episodes that are there and whole, numbers without gaps, shared files, card."""

import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput
from rpaug.core.files import PART, REJECTED, write_atomic
from rpaug.core.fingerprint import same_files, sealed
from rpaug.pipeline import card, journal, report
from rpaug.pipeline.copies import ORIGINAL
from rpaug.pipeline.journal import Journal, Noted
from rpaug.pipeline.run import Run, group_of

FOLDERS = ("", REJECTED)  # of an output, that hold episodes
OWN = {journal.NAME, report.SUMMARY, card.NAME, report.CONTACT_SHEET}  # files of rpaug in an output


def missing(target: Path) -> list[Path]:
    """The folders that making `target` makes, innermost first; none if it is there."""
    found = []
    while not target.exists():
        found.append(target)
        target = target.parent
    return found


def sweep(target: Path) -> None:
    """Remove what a killed run had half written."""
    for folder, subfolders, files in os.walk(target):
        for name in [name for name in subfolders if name.startswith(".") and name.endswith(PART)]:
            shutil.rmtree(Path(folder) / name, ignore_errors=True)
            subfolders.remove(name)
        for name in files:
            if name.startswith(".") and name.endswith(PART):
                (Path(folder) / name).unlink(missing_ok=True)


def mend(run: Run) -> Journal:
    """See that all that the journal names is there and as large as when it was written; remove what is not, and what
    was written and not noted, so that it is made again. Returns what is left.

    Raises BadInput for episodes that no run wrote, and where shared files are spoilt beyond taking them apart.
    """
    held = journal.read(run.target)
    for within in FOLDERS:
        root = run.target / within
        if root.is_dir() and (lost := run.adapter.missing(root)):
            expected = "the file as it was written; without it nothing here can be read"
            raise BadInput(lost, "file", found="nothing", expected=expected)
        there = keys(run, within)
        spoilt = [
            name for name in held.shared.get(within, ()) if not _as_noted(root, held, within, name)
        ]
        damaged = _damaged(run, held, within, there)
        if spoilt or damaged:
            journal.append(run.target, [{"apart": True, "in": within}])
            if run.adapter.gathers:
                run.adapter.scatter(root, {root / name for name in spoilt})
                there = keys(run, within)
            else:
                for name in spoilt:  # brought along anew at the end
                    (root / name).unlink(missing_ok=True)
            held = journal.read(run.target)
            damaged = _damaged(run, held, within, there)
        _drop(run, held, within, there, damaged)
    return held


def _as_noted(root: Path, held: Journal, within: str, name: str) -> bool:
    """Whether a shared file is as large as it was."""
    size, _ = held.shared[within][name]
    return (root / name).is_file() and (root / name).stat().st_size == size


def _damaged(run: Run, held: Journal, within: str, there: list[str]) -> list[str]:
    """Keys of episodes that are not whole, by those that the adapter finds."""
    known = set(there)
    return [
        key
        for key, one in held.of(within)
        if key not in known or not _whole(run, within in held.open, run.target / within / key, one)
    ]


def _whole(run: Run, open_: bool, folder: Path, one: Noted) -> bool:
    if same_files(one.seal, sealed(folder, read=False)):
        return True
    if not (run.adapter.gathers and open_ and one.loose):
        return False
    described = folder / report.NAME  # some of the rest may lie in shared files
    return described.is_file() and described.stat().st_size == one.report


def _drop(run: Run, held: Journal, within: str, there: list[str], damaged: list[str]) -> None:
    """Remove episodes that are not whole, and those that are not noted. Raises BadInput for what is no run's."""
    root, gone = run.target / within, []
    for key in damaged:
        shutil.rmtree(root / key, ignore_errors=True)
        gone.append({"gone": key, "in": within})
    unnoted = [key for key in there if (within, key) not in held.made]
    if gone:
        journal.append(run.target, gone)
        for one in gone:
            held.add(one, 0)
    for key in unnoted:
        if not (root / key / report.NAME).is_file():
            expected = f"only episodes of this run: those that {journal.NAME} names"
            raise BadInput(root / key, "episode", found="one of no run of rpaug", expected=expected)
        shutil.rmtree(root / key)


def keys(run: Run, within: str = "") -> list[str]:
    """The episodes in the target, or in a folder of it; rejected copies are none of the target's own."""
    root = run.target / within
    held = run.adapter.episodes(root) if root.is_dir() else ()
    apart = f"{REJECTED}/"
    return [key for key in held if not key.startswith(apart)]


def close_gaps(run: Run, held: Journal, within: str) -> None:
    """Renumber so that each group counts from 0 without holes: readers walk the numbers until one is missing."""
    counts: dict[str, int] = {}
    for key, _ in [*held.of(within)]:
        group = group_of(run.adapter, key)
        wanted = run.adapter.key_at(key, counts.get(group, 0))
        counts[group] = counts.get(group, 0) + 1
        if wanted != key:
            root = run.target / within
            run.adapter.rename(root, key, wanted)
            line = {
                "renamed": key,
                "to": wanted,
                "in": within,
                "seal": asdict(sealed(root / wanted)),
            }
            journal.append(run.target, [line])
            held.add(line, 0)


def gather(run: Run, held: Journal, within: str) -> None:
    """Bring along what belongs to no single episode, and note what is there then."""
    root = run.target / within
    journal.append(run.target, [{"gathering": True, "in": within}])
    run.adapter.finish(run.source, root)
    lines = []
    for key, one in held.of(within):
        brought = one.loose and run.adapter.gathers
        if brought and not same_files(one.seal, sealed(root / key, read=False)):
            lines.append({"sealed": key, "in": within, "seal": asdict(sealed(root / key))})
    lines += [journal.shared(root, within, name) for name in shared(root, held, within)]
    journal.append(run.target, [*lines, {"gathered": True, "in": within}])


def shared(root: Path, held: Journal, within: str) -> Iterator[str]:
    """Files of a folder that belong to no single episode."""
    episodes = {key for folder, key in held.made if folder == within}
    for folder, subfolders, names in os.walk(root):
        at = os.path.relpath(folder, root)
        at = "" if at == "." else f"{at}/".replace(os.sep, "/")
        apart = {REJECTED} if not at and not within else ()
        subfolders[:] = sorted(
            name for name in subfolders if f"{at}{name}" not in episodes and name not in apart
        )
        for name in sorted(names):
            if at or within or name not in OWN:
                yield f"{at}{name}"


def stale(held: Journal, within: str) -> bool:
    """Whether a folder holds episodes that were not gathered, or is open."""
    entries = [one for _, one in held.of(within)]
    return bool(entries) and (within in held.open or any(one.loose for one in entries))


def write_card(run: Run, held: Journal) -> None:
    """The dataset card; it counts the episodes that are there."""
    kept = {key: _origin(one) for key, one in held.of("")}
    given = card.text(
        run.source,
        run.adapter.name,
        kept,
        recipe=run.recipe.source,
        rejected=sum(within == REJECTED for within, _ in held.made),
        licence=run.licence,
        ratio=run.ratio and f"{run.ratio[0]}:{run.ratio[1]}",
    )
    write_atomic(run.target / card.NAME, given.encode())


def _origin(one: Noted) -> Mapping[str, Any]:
    """What the card needs of a report."""
    return {"source": one.source, "synthetic": one.copy != ORIGINAL}
