"""`rpaug verify`: what must not have changed, and what trips an output's readers."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    console,
    counted,
    dataset_path,
    plain,
    print_json,
    say,
)
from rpaug.cli.progress import progress_bar

KEPT = (
    "actions, states, numbering and what no edit reaches are as recorded, and cameras agree. Whether edits look "
    "right is not judged here: the contact sheet shows them (rpaug contact)"
)


def verify(
    dataset: Dataset,
    against: Annotated[
        Path, typer.Option(help="The dataset that it was made from.", parser=dataset_path)
    ],
    every_frame: Annotated[
        bool, typer.Option(help="Compare the images of all frames, not of six.")
    ] = False,
    replay: Annotated[
        Path | None,
        typer.Option(help="RVT's replay folder: one from an earlier training is reused."),
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Compare an augmented dataset with its source: counts, kinds, actions bit for bit, untouched images, cameras
    that agree, splits, numbering, and what its readers trip over. Exit code 1 if something is wrong.

    Example: [bold]rpaug verify augmented --against sample[/]
    """
    from dataclasses import replace

    from rpaug.pipeline.verify import LOOKED_AT, Finding
    from rpaug.pipeline.verify import verify as compared

    with progress_bar("verifying", as_json) as progress:
        verdict = compared(
            dataset, against, frames=None if every_frame else LOOKED_AT, progress=progress
        )
    if replay is not None and replay.is_dir() and any(replay.iterdir()):
        stale = "not empty: RVT would train on what an earlier run left there; delete it"
        finding = Finding("bad", str(replay), "replay folder", stale)
        verdict = replace(verdict, findings=(*verdict.findings, finding))
    if as_json:
        print_json(verdict.describe())
    else:
        for finding in verdict.findings:
            color = {"bad": "bold red", "note": "yellow"}[finding.level]
            line = f"[{color}]{finding.level:4}[/] {plain(f'{finding.episode}: {finding.topic}: {finding.message}')}"
            console.print(line, highlight=False, soft_wrap=True)
        for name, figures in verdict.statistics.items():
            if figures:
                told = ", ".join(f"{key} {value:.0f}" for key, value in figures.items())
                say(f"images of the {name.removeprefix('rgb, ')}, mean of 0 to 255: {told}")
        looked = "all frames" if verdict.frames is None else f"{verdict.frames} frames"
        outcome = KEPT if verdict.passed else "something is wrong"
        say(
            f"{counted(verdict.episodes, 'episode')} compared, images in {looked} of each: {outcome}"
        )
    return 0 if verdict.passed else 1
