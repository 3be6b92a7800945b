"""`rpaug convert`: a dataset in another layout."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    Licence,
    console,
    plain,
    print_json,
    progress_bar,
    say,
)


def convert(
    dataset: Dataset,
    to: Annotated[str, typer.Option(help="Layout to write: rlbench, rlds, rdt, ...")],
    out: Annotated[Path, typer.Option(help="Folder to write; must not exist.")],
    licence: Licence = None,
    as_json: AsJson = False,
) -> int:
    """Write a dataset in another layout: images, words, cameras, robot.

    Example: [bold]rpaug convert data/train/open_drawer --to rdt --out data/rdt[/]
    """
    from rpaug.convert import convert as write

    with progress_bar("converting", as_json) as progress:
        done = write(dataset, out, to, progress, licence=licence)
    if as_json:
        print_json({**vars(done), "out": str(out)})
        return done.exit_code
    for key, reason in done.failures.items():
        line = f"[yellow]skipped[/] {plain(key)}: {plain(reason)}"
        console.print(line, highlight=False, soft_wrap=True)
    for words, count in done.traps.items():
        console.print(f"[yellow]note[/] {plain(words)} ({count} episodes)", soft_wrap=True)
    say(f"{done.episodes} episodes in {out}")
    return done.exit_code
