"""The dataset card of an output: `README.md` with a header for machines (`synthetic: true`) and words for people."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

import rpaug
from rpaug import splits

NAME = "README.md"
LICENCES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "LICENCE", "LICENCE.txt", "COPYING")
UNSTATED = "unknown: the source states none"
LONGEST = 200  # characters of a licence's first line


def text(
    source: Path,
    layout: str,
    recipe: Mapping[str, Any],
    reports: Mapping[str, Mapping[str, Any]],
    *,
    rejected: int = 0,
    licence: str | None = None,
    ratio: str | None = None,
) -> str:
    """The card of a dataset made from `source`, by the reports of its episodes. The same run gives the same card."""
    made = Counter(
        (splits.of(key) or "all", bool(one["synthetic"])) for key, one in reports.items()
    )
    synthetic = sum(count for (_, is_made), count in made.items() if is_made)
    licence = licence or licence_of(source, (one["source"] for one in reports.values()))
    header = {
        "synthetic": synthetic > 0,
        "license": licence,
        "source_datasets": [source.resolve().name],
        "generator": f"rpaug {rpaug.__version__}",
        "episodes": {"recorded": len(reports) - synthetic, "synthetic": synthetic},
        **({"ratio": ratio} if ratio else {}),
    }
    rows = [
        f"| {split} | {made[split, False]} | {made[split, True]} |"
        for split in sorted({split for split, _ in made})
    ]
    told = yaml.safe_dump(dict(recipe), sort_keys=False, allow_unicode=True).rstrip()
    lines = [
        f"---\n{yaml.safe_dump(header, sort_keys=False, allow_unicode=True)}---",
        f"# {source.resolve().name}, augmented",
        f"Edited copies of recorded episodes in the layout `{layout}`, made by rpaug {rpaug.__version__}. "
        "Images are synthetic where an edit changed them; actions and robot states are the recorded ones, bit for bit. "
        "Each episode's `rpaug.json` says what was drawn and whether the episode is synthetic.",
        "| split | recorded | synthetic |\n|---|---|---|\n" + "\n".join(rows),
        f"Copies that failed their gates, kept aside in `rejected/`: {rejected}.",
        f"Source: `{source.resolve().name}`. Licence of the source, which its copies are under too: {licence}.",
        "Copies are in the split of the episode that they were made from. Evaluate on recorded episodes.",
        f"## Recipe\n\n```yaml\n{told}\n```",
    ]
    return "\n\n".join(lines) + "\n"


def licence_of(source: Path, keys: Iterable[str]) -> str:
    """What the source says of its licence: in its own card's header, or a licence file's first line."""
    above = {parent for key in keys for parent in Path(key).parents}
    for folder in (source, *(source / one for one in sorted(above))):
        card = folder / NAME
        if card.is_file():
            found = re.match(
                r"---\n.*?^licen[sc]e:[ \t]*(.+?)$.*?^---", _start(card), re.DOTALL | re.M
            )
            if found:
                return found[1].strip().strip("\"'")[:LONGEST]
        for name in LICENCES:
            lines = _start(folder / name).splitlines() if (folder / name).is_file() else []
            first = next((line.strip() for line in lines if line.strip()), None)
            if first:
                return f"{first[:LONGEST]} ({name} of the source)"
    return UNSTATED


def _start(path: Path) -> str:
    with path.open("rb") as stream:
        return stream.read(2**16).decode(errors="replace")
