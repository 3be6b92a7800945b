"""`rpaug init`: a first recipe for a dataset."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, Dataset, EpisodeKey, print_json, say, write_new
from rpaug.cli.progress import progress_bar


def init(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="New file to write the recipe to.")] = Path(
        "recipe.yaml"
    ),
    episode: EpisodeKey = None,
    as_json: AsJson = False,
) -> int:
    """Write a first recipe for a dataset, with comments: what one of its episodes has something for.

    Example: [bold]rpaug init sample --out recipe.yaml[/]
    """
    from rpaug.core import registry
    from rpaug.pipeline import inspect as inspection
    from rpaug.pipeline import starter
    from rpaug.scene.targets import settled

    found, keys = registry.read_among(dataset, episode)
    with progress_bar("trying edits", as_json) as progress:
        edits = len(starter.CANDIDATES)
        progress(0, edits + 1)
        described = inspection.inspect(found, roles=settled.read(dataset))[0]
        made = starter.text(
            found, described, len(keys), lambda tried: progress(1 + tried, edits + 1)
        )
    write_new(out, made.encode())
    if as_json:
        print_json({"recipe": str(out), "episode": found.key})
    else:
        say(f"{out}: a recipe for {found.key}; its comments say what can be edited")
        name = "sample" if dataset == registry.SAMPLE else dataset
        say(f"see it: rpaug preview {name} --recipe {out}")
        say(f"make it: rpaug augment {name} --recipe {out} --out augmented")
    return 0
