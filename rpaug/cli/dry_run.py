"""`rpaug augment --dry-run`: what a run would do, said of each episode as it is planned; sums alone are kept."""

import json
import shutil
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TextIO

from rpaug.cli.console import counted, say, warn
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError

SHOWN = 3  # episodes that are listed, of those of which the same is said
CONTACT, SHEET = 0.04, 8  # megabytes of an episode on the contact sheet, and how many are on it


def print_plans(run: Any, resume: bool, as_json: bool) -> int:
    """Images are looked at only to measure errors, where the recipe states an accuracy. Returns the exit code. JSON
    goes to a file first, since nothing may be printed beside an error."""
    from rpaug.pipeline import prepare
    from rpaug.pipeline.augment import check

    check(run, resume)
    planned, failed, known, alike = 0, dict[str, str](), list[str](), _Alike()
    warned = Counter[str]()
    total, start, stored = {"seconds": 0.0, "megabytes": 0.0}, 0.0, _Stored(run)
    with TemporaryFile("w+") as plans, progress_bar("planning", as_json) as progress:
        for at, key in enumerate(run.keys):
            progress(at, len(run.keys))
            if not run.makes(at):
                continue
            try:
                episode = run.adapter.read(run.source, key)
                made = prepare.planned(episode, run.recipe, run.tier)
            except RpaugError as error:
                failed[key] = str(error)
                continue
            planned += 1
            cost = made.cost(episode, len(run.copies), stored.megabytes(key))
            start = max(start, made.start)
            total = {name: seconds + cost[name] for name, seconds in total.items()}
            own = {name: round(value, 3) for name, value in cost.items()}
            one = {"episode": key, "frames": episode.length, **made.describe(), "estimate": own}
            if as_json:
                plans.write(f"{',' if planned > 1 else ''}\n{json.dumps(one)}")
            else:
                warned.update(map(_apart, made.warnings))
                regions = [str(region) for region in made.regions if region.met is not None]
                if alike.shown(one, regions):
                    known = _tell(one, regions, known)
        total["seconds"] += start
        total["megabytes"] += CONTACT * min(planned, SHEET)
        rounded = {name: round(value, 1) for name, value in total.items()}
        if as_json:
            _print(plans, len(run.copies), failed, rounded)
    if not as_json:
        for first, more in alike.folded():
            say(f"{first}: and {counted(more, 'other episode')} alike (--json lists all)")
        for line, times in warned.items():
            if times > 1:
                warn("warning", f"in {times} of {counted(planned, 'episode')}: {line}")
        _sum_up(planned * len(run.copies), failed, rounded, run.linked)
    return 2 if not planned else 1 if failed else 0


@dataclass(frozen=True)
class _Stored:
    """How large the recorded episodes of a run are."""

    run: Any

    def megabytes(self, key: str) -> float:
        """Of an episode's own folder, else the mean of its dataset's episodes."""
        folder = self.run.source / key
        return _size(folder) if folder.is_dir() else self._mean

    @cached_property
    def _mean(self) -> float:
        source, adapter = self.run.source, self.run.adapter
        return _size(source) / max(1, len(adapter.episodes(source)))


def _size(path: Path) -> float:
    """Megabytes of a file, or of all files in a folder."""
    paths = path.rglob("*") if path.is_dir() else [path]
    return sum(one.stat().st_size for one in paths if one.is_file()) / 1e6


@dataclass
class _Alike:
    """Of how many episodes the same is said, frames and cost apart: the first few are listed, the others counted."""

    counts: dict[int, tuple[str, int]] = field(default_factory=dict)

    def shown(self, one: Mapping[str, Any], regions: list[str]) -> bool:
        """Whether this episode, one more, is to be listed."""
        stated = {k: v for k, v in one.items() if k not in ("episode", "frames", "estimate")}
        key = hash((json.dumps(stated), *regions))  # the text itself would take memory
        first, count = self.counts.get(key, (one["episode"], 0))
        self.counts[key] = first, count + 1
        return count < SHOWN

    def folded(self) -> Iterator[tuple[str, int]]:
        """The first episode of each kind of which some are not listed, and how many those are."""
        return ((key, count - SHOWN) for key, count in self.counts.values() if count > SHOWN)


def _tell(one: Mapping[str, Any], regions: list[str], known: list[str]) -> list[str]:
    """What becomes of one episode, without the lines that the one before had too. Returns all its lines."""
    representations = ", ".join(sorted(set(one["carriers"].values())))
    bodies = "bodies tracked" if one["bodies"] else "bodies not needed"
    about = "about {seconds:.1f} s, {megabytes:.1f} MB".format(**one["estimate"])
    say(f"{one['episode']}: {one['frames']} frames; at most {representations}; {bodies}; {about}")
    said = {
        kind: _of_several(one.get(kind, ()), list(one["carriers"]))
        for kind in ("assumed", "warnings")
    }
    for line in regions:
        say(f"  {line}")
    for line in said["assumed"]:
        if line not in known:
            say(f"  {line}")
    for line in said["warnings"]:
        if _apart(line) not in known:
            warn("  warning", line)
    return [*said["assumed"], *map(_apart, said["warnings"])]


def _of_several(lines: Iterable[str], cameras: Collection[str]) -> list[str]:
    """What is said of several cameras in the same words, once for all of them."""
    found: dict[str, list[str]] = {}
    for line in lines:
        camera, _, words = line.partition(": ")
        known = camera in cameras
        found.setdefault(words if known else line, []).extend([camera] * known)
    return [f"{', '.join(of)}: {words}" if of else words for words, of in found.items()]


def _apart(warning: str) -> str:
    """A warning without what there is instead, which differs between episodes of which the same is said."""
    return warning.partition("; there is: ")[0]


def _sum_up(
    copies: int, failed: Mapping[str, str], total: Mapping[str, float], linked: bool
) -> None:
    from rpaug.pipeline.run import alike

    for keys, reason in alike(failed, files=False):
        more = f" and {len(keys) - SHOWN} more" if len(keys) > SHOWN else ""
        warn("would skip", f"{', '.join(keys[:SHOWN])}{more}: {reason}")
    room = f"{'at most ' if linked else ''}{total['megabytes']} MB"
    about = f"about {total['seconds']} s on one core and {room}"
    say(f"{copies} copies, {about}. Nothing was written.")


def _print(
    plans: TextIO, copies: int, failed: Mapping[str, str], total: Mapping[str, float]
) -> None:
    """One JSON value."""
    plans.seek(0)
    sys.stdout.write(f'{{"copies": {copies},\n"plans": [')
    shutil.copyfileobj(plans, sys.stdout)
    rest = json.dumps({"unreadable": failed, "estimate": total}, indent=1)
    sys.stdout.write(f"],{rest.removeprefix('{')}\n")
