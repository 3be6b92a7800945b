"""`rpaug audit`: whether an output is what was written, and what was done to an episode."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from rpaug.cli.console import AsJson, counted, print_json, say, warn
from rpaug.cli.progress import progress_bar


def audit(
    out: Annotated[Path, typer.Argument(help="The --out of a run.")],
    episode: Annotated[
        str | None, typer.Argument(help="One episode: what was done to it, too.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Compare every byte of an output with what was written, and show what was done to one episode. Exit code 1 if
    something differs.

    Example: [bold]rpaug audit augmented all_variations/episodes/episode3[/]
    """
    from rpaug.pipeline.audit import audit as audited

    with progress_bar("reading", as_json) as progress:
        found = audited(out, episode, progress)
    if as_json:
        print_json(vars(found))
        return 1 if found.faults else 0
    if found.report is not None:
        _print_report(found.report, found.node)
    for name, fault in found.faults.items():
        warn("differs", f"{name}: {fault}")
    outcome = "something differs" if found.faults else "as they were written"
    say(f"{counted(found.episodes, 'episode')}, {counted(found.files, 'shared file')}: {outcome}")
    return 1 if found.faults else 0


def _print_report(given: dict[str, Any], node: str | None) -> None:
    from rpaug.pipeline import report

    say(f"copy {given['copy']} of {given['source']}, seed {given['seed']}, made on {node}")
    for draw in given["draws"]:
        if draw.get("skipped"):
            say(f"  step {draw['step']}: skipped")
        elif draw.get("left_out"):
            say(f"  {draw['op']}: left out: {draw['left_out']}")
        else:
            say(f"  {draw['op']}: {json.dumps(draw['edit'], ensure_ascii=False)}")
    for name in given["changed_share"]:
        say(f"  {name}: {report.change(given, name)}")
    for name, value in (given.get("gates") or {}).get("figures", {}).items():
        say(f"  gate {name}: {json.dumps(value)}")
