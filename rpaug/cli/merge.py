"""`rpaug merge`: the parts of a run become one output."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.augment import contact_sheet, tell
from rpaug.cli.console import AsJson, Licence


def merge(
    out: Annotated[Path, typer.Argument(help="Folder to write: the output of the whole run.")],
    parts: Annotated[list[Path], typer.Argument(help="The --out of every part.")],
    licence: Licence = None,
    as_json: AsJson = False,
) -> int:
    """Put the parts of a run together that --shard made on several machines.

    Episodes are moved, the bytes are those of one run, and a merge that was stopped goes on when it is asked for again.

    Example: [bold]rpaug merge augmented part1 part2[/]
    """
    from rpaug.pipeline.merge import merge as merged

    run, summary = merged(out, parts, licence)
    described = {**vars(summary), "out": str(out)}
    code = summary.exit_code
    if summary.copies:
        code = max(code, contact_sheet(run, described))
    tell(run, summary, described, as_json)
    return code
