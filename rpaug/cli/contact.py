"""`rpaug contact`: pages of all episodes of an output, of which the contact sheet shows a few."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, print_json, say, write_new
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import BadInput


def contact(
    out: Annotated[Path, typer.Argument(help="The --out of a run.")],
    html: Annotated[Path, typer.Option(help="The page to write; must not exist.")],
    page: Annotated[int, typer.Option(min=1, help="Which page, of twenty-four episodes each.")] = 1,
    against: Annotated[
        Path | None,
        typer.Option(help="The recorded dataset, where it no longer lies where it was."),
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Write a page of an output's episodes: recorded, edited, difference, and what was drawn.

    The contact sheet in the output shows eight of all; pages show every one.

    Example: [bold]rpaug contact augmented --page 2 --html page2.html[/]
    """
    from rpaug.core import registry
    from rpaug.pages import contact as pages
    from rpaug.pipeline import journal

    begun = journal.begun(out)
    if not begun:
        expected = "the --out of a run of rpaug"
        raise BadInput(out / journal.NAME, "--out", found="no run of rpaug here", expected=expected)
    adapter = registry.adapter(begun["begun"]["layout"])
    with progress_bar("drawing", as_json) as progress:
        made, most = pages.page(adapter, against or Path(begun["dataset"]), out, page, progress)
    write_new(html, made)
    if as_json:
        print_json({"page": page, "pages": most, "html": str(html)})
    else:
        say(f"page {page} of {most}: {html}")
    return 0
