"""The output folder of a run: episodes that are there and whole, numbers without gaps, shared files, card."""

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput
from rpaug.core.files import PART, REJECTED, write_changed
from rpaug.core.fingerprint import same_files, sealed
from rpaug.pipeline import card, journal, report
from rpaug.pipeline.copies import ORIGINAL
from rpaug.pipeline.journal import Journal
from rpaug.pipeline.made import Noted
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


def sweep(folder: Path) -> None:
    """Remove what a killed run had half written."""
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        for one in entries:
            is_folder = one.is_dir(follow_symlinks=False)
            if one.name.startswith(".") and one.name.endswith(PART):
                if is_folder:
                    shutil.rmtree(one.path, ignore_errors=True)
                else:
                    Path(one.path).unlink(missing_ok=True)
            elif is_folder:
                sweep(Path(one.path))


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
        spoilt = [
            name for name in held.shared.get(within, ()) if not _as_noted(root, held, within, name)
        ]
        damaged, unnoted = _compared(run, held, within)
        if spoilt or damaged:
            journal.append(run.target, [{"apart": True, "in": within}])
            if run.adapter.gathers:
                run.adapter.scatter(root, {root / name for name in spoilt})
            else:
                for name in spoilt:  # brought along anew at the end
                    (root / name).unlink(missing_ok=True)
            held = journal.read(run.target)
            damaged, unnoted = _compared(run, held, within)
        _drop(run, held, within, damaged, unnoted)
    return held


def _as_noted(root: Path, held: Journal, within: str, name: str) -> bool:
    """Whether a shared file is as large as it was."""
    size, _ = held.shared[within][name]
    return (root / name).is_file() and (root / name).stat().st_size == size


def _compared(run: Run, held: Journal, within: str) -> tuple[list[str], list[str]]:
    """Keys of episodes that are not whole, and of those that the adapter finds and the journal does not name."""
    there, damaged = set(keys(run, within)), []
    for key, one in held.made.of(within):
        open_ = within in held.open
        if key not in there or not _whole(run, open_, run.target / within / key, one):
            damaged.append(key)
        there.discard(key)
    return damaged, sorted(there)


def _whole(run: Run, open_: bool, folder: Path, one: Noted) -> bool:
    if same_files(one.seal, sealed(folder, read=False)):
        return True
    if not (run.adapter.gathers and open_ and one.loose):
        return False
    described = folder / report.NAME  # some of the rest may lie in shared files
    return described.is_file() and described.stat().st_size == one.report


def _drop(run: Run, held: Journal, within: str, damaged: list[str], unnoted: list[str]) -> None:
    """Remove episodes that are not whole, and those that are not noted. Raises BadInput for what is no run's."""
    root, gone = run.target / within, []
    for key in damaged:
        shutil.rmtree(root / key, ignore_errors=True)
        gone.append({"gone": key, "in": within})
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
    moved, root = [], run.target / within
    for key, _ in held.made.of(within):
        group = group_of(run.adapter, key)
        wanted = run.adapter.key_at(key, counts.get(group, 0))
        counts[group] = counts.get(group, 0) + 1
        if wanted != key:
            moved.append((key, wanted))
    for key, wanted in moved:
        run.adapter.rename(root, key, wanted)
        seal = asdict(sealed(root / wanted))
        line = {"renamed": key, "to": wanted, "in": within, "seal": seal}
        journal.append(run.target, [line])
        held.add(line, 0)


def gather(run: Run, held: Journal, within: str) -> None:
    """Bring along what belongs to no single episode, and note what is there then."""
    root = run.target / within
    journal.append(run.target, [{"gathering": True, "in": within}])
    run.adapter.finish(run.source, root)
    brought = _sealed_anew(root, held, within) if run.adapter.gathers else ()
    lines = (journal.shared(root, within, name) for name in shared(root, held, within))
    journal.append(run.target, chain(brought, lines, [{"gathered": True, "in": within}]))


def _sealed_anew(root: Path, held: Journal, within: str) -> Iterator[dict[str, Any]]:
    """Lines about episodes whose files were brought into shared ones."""
    for key, one in held.made.of(within):
        if one.loose and not same_files(one.seal, sealed(root / key, read=False)):
            yield {"sealed": key, "in": within, "seal": asdict(sealed(root / key))}


def shared(root: Path, held: Journal, within: str, at: str = "") -> Iterator[str]:
    """Files of a folder that belong to no single episode, by their names in it; `at` names one in it, with a slash."""
    if not root.is_dir():
        return
    files, folders = [], []
    with os.scandir(root / at) as entries:
        for one in entries:
            name = f"{at}{one.name}"
            if not one.is_dir():
                files += [name] if at or within or name not in OWN else []
            elif (within, name) not in held.made and (at or within or name != REJECTED):
                folders += [] if one.is_symlink() else [name]
    yield from sorted(files)
    for name in sorted(folders):
        yield from shared(root, held, within, f"{name}/")


def stale(held: Journal, within: str) -> bool:
    """Whether a folder holds episodes that were not gathered, or is open."""
    if within in held.open:
        return held.made.count(within) > 0
    return held.made.any_loose(within)


def write_card(run: Run, held: Journal) -> None:
    """The dataset card; it counts the episodes that are there."""
    given = card.text(
        run.source,
        run.adapter.name,
        (
            (key, line["source"], line["copy"] != ORIGINAL and not line["facts"].get("unedited"))
            for key, line in journal.facts(run.target, held.made.of(""))
        ),
        recipe=run.recipe.source,
        rejected=held.made.count(REJECTED),
        licence=run.licence,
        ratio=run.ratio and f"{run.ratio[0]}:{run.ratio[1]}",
    )
    write_changed(run.target / card.NAME, given.encode())
