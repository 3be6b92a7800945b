"""The dataset card of an output: `README.md` with a header for machines (`synthetic: true`) and words for people."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from rpaug.core import splits
from rpaug.core.files import leads_out
from rpaug.core.version import __version__
from rpaug.core.visible import markdown

NAME = "README.md"
LICENCE = re.compile(r"(licen[sc]e|copying)([._-].*)?", re.IGNORECASE)  # names of their files
UNSTATED = "unknown: the source states none"
UNREAD = "not read: {} of the source is a link out of it"
LONGEST = 200  # characters of a licence's first line
Lines = tuple[str, ...]


def text(
    source: Path,
    layout: str,
    episodes: Iterable[tuple[str, str, bool]],
    *,
    recipe: Mapping[str, Any] | None = None,
    converted: str | None = None,
    lost: Mapping[str, int] | None = None,
    rejected: int = 0,
    licence: str | None = None,
    ratio: str | None = None,
) -> str:
    """The card of a dataset made from `source`. The same run gives the same card.

    `episodes` are its keys, each with the key that it was made from and whether it is synthetic. It was made by a
    `recipe`, or `converted` from another layout, which is then named; `lost` is what that did not keep, each with the
    number of its episodes.
    """
    made, homes = Counter[tuple[str, bool]](), set[str]()
    for key, origin, is_synthetic in episodes:
        made[splits.of(key) or "all", is_synthetic] += 1
        homes.add(origin.rpartition("/")[0])
    synthetic = sum(count for (_, is_made), count in made.items() if is_made)
    licence = licence or licence_of(source, homes)
    header = {
        "synthetic": synthetic > 0,
        "license": licence,
        "source_datasets": [called(source)],
        "generator": f"rpaug {__version__}",
        "episodes": {"recorded": made.total() - synthetic, "synthetic": synthetic},
        **({"ratio": ratio} if ratio else {}),
    }
    rows = [
        f"| {split} | {made[split, False]} | {made[split, True]} |"
        for split in sorted({split for split, _ in made})
    ]
    title, opening, closing = (
        _converted(layout, converted, lost or {})
        if converted
        else _augmented(layout, recipe or {}, rejected)
    )
    lines = [
        f"---\n{yaml.safe_dump(header, sort_keys=False, allow_unicode=True)}---",
        f"# {markdown(called(source))}, {title}",
        *opening,
        "| split | recorded | synthetic |\n|---|---|---|\n" + "\n".join(rows),
        f"Source: {markdown(called(source))}. Licence of the source, which this dataset is under too: "
        f"{markdown(licence)}.",
        *closing,
    ]
    return "\n\n".join(lines) + "\n"


def called(source: Path) -> str:
    """What a dataset is called: its folder, and the one above it where the folder is a split."""
    path = source.resolve()
    return f"{path.parent.name}/{path.name}" if path.name.lower() in splits.KINDS else path.name


def _augmented(layout: str, recipe: Mapping[str, Any], rejected: int) -> tuple[str, Lines, Lines]:
    """Title, and what is said before and after the counts."""
    given = yaml.safe_dump(dict(recipe), sort_keys=False, allow_unicode=True).rstrip()
    return (
        "augmented",
        (
            f"Edited copies of recorded episodes in the layout `{layout}`, made by rpaug {__version__}. "
            "Images are synthetic where an edit changed them; actions and robot states are the recorded ones, bit for "
            "bit. Each episode's `rpaug.json` says what was drawn and whether the episode is synthetic.",
        ),
        (
            f"Copies that failed their gates, kept aside in `rejected/`: {rejected}.",
            "Copies are in the split of the episode that they were made from. Evaluate on recorded episodes.",
            f"## Recipe\n\n```yaml\n{given}\n```",
        ),
    )


def _converted(layout: str, before: str, lost: Mapping[str, int]) -> tuple[str, Lines, Lines]:
    """Title, and what is said before and after the counts."""
    return (
        f"in the layout `{layout}`",
        (
            f"The episodes of a dataset in the layout `{before}`, written as `{layout}` by rpaug {__version__}; "
            "nothing was edited. Each episode's `rpaug.json` names the one that it was made from and says whether that "
            "was synthetic.",
        ),
        (
            "## Not kept exactly\n\n"
            + (
                "\n".join(
                    f"- {markdown(words)} (episodes: {count})" for words, count in lost.items()
                )
                or "Nothing."
            ),
        ),
    )


def licence_of(source: Path, homes: Iterable[str]) -> str:
    """What the source says of its licence, in the folders of its episodes or above: in its own card's header, or the
    first line of each licence file."""
    above = {parent for home in homes for parent in (Path(home), *Path(home).parents)}
    for folder in (source, *(source / one for one in sorted(above))):
        card, stated = folder / NAME, []
        if leads_out(source, card):
            stated.append(UNREAD.format(NAME))
        elif card.is_file():
            found = re.match(
                r"---\n.*?^licen[sc]e:[ \t]*(.+?)$.*?^---", _start(card), re.DOTALL | re.M
            )
            if found:
                return found[1].strip().strip("\"'")[:LONGEST]
        named = filter(LICENCE.fullmatch, os.listdir(folder) if folder.is_dir() else ())
        for path in sorted(folder / name for name in named):
            if leads_out(source, path):
                stated.append(UNREAD.format(path.name))
            elif path.is_file():
                lines = (line.strip() for line in _start(path).splitlines())
                first = next(filter(None, lines), None)
                stated += [f"{first[:LONGEST]} ({path.name} of the source)"] if first else []
        if stated:
            return "; ".join(stated)
    return UNSTATED


def _start(path: Path) -> str:
    with path.open("rb") as stream:
        return stream.read(2**16).decode(errors="replace")
