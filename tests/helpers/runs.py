"""Runs of `rpaug augment` in this process, and what they wrote."""

import json
from pathlib import Path
from typing import Any

from rpaug.pipeline import journal, recipe, report
from rpaug.pipeline.augment import execute
from rpaug.pipeline.run import Run, Summary

GROUP = "roll_ball/all_variations/episodes"


def augment(source: Path, wanted: recipe.Recipe, target: Path, **how: Any) -> Summary:
    return execute(Run(source, wanted, target), **how)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of the episodes; of reports all but the seconds, which no two runs share."""
    out = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in (report.SUMMARY, journal.NAME):
            data = path.read_bytes()
            if path.name == report.NAME:
                described = json.loads(data)
                del described["seconds"]
                data = json.dumps(described).encode()
            out[path.relative_to(folder).as_posix()] = data
    return out
