"""`rpaug fit`: Gaussians of one episode."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    EpisodeKey,
    print_json,
    progress_bar,
    read_episode,
    say,
)


def fit(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Folder of the scene store; scenes are added to it.")],
    episode: EpisodeKey = None,
    ply: Annotated[
        Path | None, typer.Option(help="Also export to this new file, in 3DGS layout.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of the fit; more is slower and better.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Fit Gaussians to an episode's static background and bodies, store them, and say how well they show it.

    Example: [bold]rpaug fit data/train/open_drawer --out scenes --ply drawer.ply[/]
    """
    from rpaug.fitting import fit_episode

    found = read_episode(dataset, episode)
    with progress_bar("fitting", as_json) as progress:
        described = fit_episode(found, out, export=ply, seed=seed, steps=steps, progress=progress)
    if as_json:
        print_json(described)
    else:
        for name, value in described.items():
            say(f"{name}: {value}")
    return 0
