"""`rpaug view`: an episode or a fitted scene in space, with time."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, Dataset, EpisodeKey, print_json, say
from rpaug.cli.progress import progress_bar


def view(
    dataset: Dataset,
    recipe: Annotated[
        str | None, typer.Option(help="Show a copy of this recipe, a file or a shipped one.")
    ] = None,
    copy: Annotated[int, typer.Option(min=1, help="Which copy.")] = 1,
    episode: EpisodeKey = None,
    rerun: Annotated[
        Path | None, typer.Option(help="Write a new .rrd file for Rerun's viewer instead.")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Where the browser finds it.")] = 8766,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: edits.0.color=red.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Show an episode, a copy of it, or a store's fitted scene in space: what cameras see, where they stand.

    A folder of `rpaug fit` shows its Gaussians; `--episode` is the beginning of a scene's key there.

    Example: [bold]rpaug view sample --recipe demo[/]
    """
    from rpaug.pages import live, rerun_file, space
    from rpaug.pipeline import inputs

    drawn = inputs.recipe(recipe, set_ or []) if recipe else None
    with progress_bar("looking", as_json):
        if space.is_store(dataset):
            shown = space.of_store(dataset, episode)
        else:
            shown = space.of_episode(dataset, episode, drawn, copy)
        frames = rerun_file.write(shown, rerun) if rerun is not None else 0
    if rerun is not None:
        if as_json:
            print_json({"rerun": str(rerun), "frames": frames})
        else:
            say(f"{frames} frames in {rerun}; `rerun {rerun}` opens it")
        return 0
    with live.LiveView(shown, port) as running:
        say(f"{running.url} shows {shown.title}; Ctrl-C ends it")
        running.server.sleep_forever()
    return 0
