"""`rpaug preview`: look at recorded and edited images before any copy is written."""

import os
import sys
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, Dataset, EpisodeKey, UsedModels, print_json, say, warn
from rpaug.cli.progress import progress_bar


# Long: the options of a command are its signature.
def preview(
    dataset: Dataset,
    recipe: Annotated[
        str, typer.Option(help="Recipe file, or the name of one that ships.")
    ] = "demo",
    out: Annotated[Path, typer.Option(help="Page to write.")] = Path("rpaug-preview.html"),
    episode: EpisodeKey = None,
    episodes: Annotated[int, typer.Option(min=1, help="How many, from the first.")] = 1,
    draws: Annotated[int, typer.Option(min=1, help="Copies that the page holds.")] = 4,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1, help="Of each episode, at most; 24, or 12 of more than three episodes."
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="First draws, unjudged: gates take all frames, minutes of a video."
        ),
    ] = False,
    serve: Annotated[
        bool, typer.Option("--serve", help="Edit the recipe in the browser, on this machine alone.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of --serve; 0 takes a free one.")
    ] = 8765,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: edits.0.color=red.")
    ] = None,
    models: UsedModels = None,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open it in the browser.")] = True,
    as_json: AsJson = False,
) -> int:
    """Show recorded and edited images side by side in the browser, before any copy is written.

    Example: [bold]rpaug preview sample --recipe demo[/]
    """
    from rpaug.core.files import write_atomic
    from rpaug.pages import preview as pages
    from rpaug.pipeline import inputs

    loaded = inputs.recipe(recipe, set_ or [], models or ())
    notes = pages.unfinished(dataset)
    for note in notes:
        warn("not complete", note)
    if serve:
        from rpaug.pages.serve import server

        with server(dataset, loaded, episode, port) as running:
            say(f"{running.url} shows the preview; Ctrl-C ends it")
            _opened(running.url, open_)
            with suppress(KeyboardInterrupt):  # the one way to end it
                running.serve_forever()
        return 0
    pages.replaced(out)
    keys = pages.chosen(dataset, episode, episodes)
    with progress_bar("previewing", as_json) as count:
        made = pages.page(
            dataset, keys, loaded, draws=draws, frames=frames, judged=not quick, count=count
        )
    write_atomic(out, made)
    if as_json:
        size = round(len(made) / 1e6, 2)
        print_json({"page": str(out), "episodes": keys, "megabytes": size, "notes": notes})
        return 0
    say(f"{len(made) / 1e6:.1f} MB, needs no network; edit the recipe with --serve")
    say(f"preview: {out}")
    _opened(out.resolve().as_uri(), open_)
    return 0


def _opened(url: str, wanted: bool) -> None:
    """Open a page where somebody sits at a screen; a browser of text would take over the terminal."""
    screen = (
        sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    )
    if wanted and screen and sys.stdout.isatty():
        webbrowser.open(url)
