"""`rpaug calibrate`: where cameras stand, by the robot's outline."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    EpisodeKey,
    UsedModels,
    print_json,
    read_episode,
    say,
    warn,
    write_new,
)
from rpaug.cli.progress import progress_bar


def calibrate(
    dataset: Dataset,
    arm: Annotated[Path, typer.Option(help="URDF or MJCF file of the robot, with its meshes.")],
    episode: EpisodeKey = None,
    models: UsedModels = None,
    words: Annotated[
        str, typer.Option(help="What the model of text is asked for to find the robot.")
    ] = "robot",
    support: Annotated[
        float,
        typer.Option(help="Metres that table or bench lie above z = 0 of the robot's world."),
    ] = 0.0,
    out: Annotated[
        Path | None, typer.Option(help="Write a cameras.yaml for the dataset to this new file.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Say where fixed cameras stand, by the robot's own outline: no board. Exit code 1 if one cannot be told.

    Example: [bold]rpaug calibrate data --arm panda.xml --models text=sam3 --out data/cameras.yaml[/]
    """
    from rpaug.pipeline import calibrate as calibrating
    from rpaug.providers import models_settings
    from rpaug.providers.models_settings import Models

    used = Models(**models_settings.given(models or (), {}))
    recorded = read_episode(dataset, episode)
    with progress_bar("calibrating", as_json):
        found = calibrating.of_episode(recorded, arm, used, words)
    described = found.describe()
    if out is not None and found.cameras:
        write_new(out, found.yaml(support))
        described["cameras_yaml"] = str(out)
    code = 2 if not found.cameras else 1 if found.refused else 0
    if as_json:
        print_json(described)
        return code
    for name, facts in described["cameras"].items():
        say(calibrating.sentence(name, facts))
    for name, reason in found.refused.items():
        warn("not calibrated", f"{name}: {reason}")
    if out is not None and found.cameras:
        say(f"written to {out}: copy it beside the dataset's files as cameras.yaml")
    return code
