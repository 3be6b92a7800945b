"""`rpaug convert`: a dataset in another layout. `rpaug reobserve`: with what its simulator sees."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    Licence,
    console,
    counted,
    print_json,
    say,
    warn,
)
from rpaug.cli.progress import progress_bar


def convert(
    dataset: Dataset,
    to: Annotated[
        str,
        typer.Option(
            help="Layout to write: rlbench, rlds, rdt, hdf5_sim or lerobot; lerobot@v2.1 or lerobot@v3.0 for a version."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write; must not exist.")],
    fps: Annotated[
        float | None,
        typer.Option(min=0.001, help="Frames a second, where the source does not state them."),
    ] = None,
    licence: Licence = None,
    as_json: AsJson = False,
) -> int:
    """Write a dataset in another layout: images, depth, instance ids, words, cameras, robot, and a dataset card.

    What the new layout needs and the source does not say is named, and episodes without it are skipped. What it has no
    place for, and what was rounded, encoded with loss or worked out, is said here, in the card and in the reports.

    Example: [bold]rpaug convert sample --to rdt --out data/rdt[/]
    """
    from rpaug.pipeline.convert import convert as write

    with progress_bar("converting", as_json) as progress:
        done = write(dataset, out, to, progress, licence=licence, fps=fps)
    if as_json:
        print_json({**vars(done), "out": str(out)})
        return done.exit_code
    reasons: dict[str, list[str]] = {}
    for key, reason in done.failures.items():
        reasons.setdefault(reason, []).append(key)
    for reason, keys in reasons.items():
        where = keys[0] if len(keys) == 1 else f"{keys[0]} and {len(keys) - 1} more"
        warn("skipped", f"{where}: {reason}")
    for words, count in done.traps.items():
        warn("note", f"{words} ({counted(count, 'episode')})")
    for words, count in done.lost.items():
        warn("not kept exactly", f"{words} ({counted(count, 'episode')})")
    if done.episodes:
        say(f"{counted(done.episodes, 'episode')} in {out}")
    else:
        console.print("Nothing was written.")
    return done.exit_code


def reobserve(
    dataset: Dataset,
    simulator: Annotated[
        Path,
        typer.Option(
            help="Python in whose environment the simulator is installed: robosuite or LIBERO."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write; must not exist.")],
    color: Annotated[
        bool, typer.Option("--color", help="Take the simulator's color too, whatever is stored.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Write a simulator's dataset with depth, instance ids, cameras and roles, as the simulator sees its states.

    Each stored state is shown again in the simulator's own environment; no action is played. What it sees counts only
    where its color is the stored one; other episodes are left out and named. `next_obs` are left out, for their last
    image shows a state that no file holds.

    Example: [bold]rpaug reobserve lift --simulator robosuite/bin/python --out lift_rgbd[/]
    """
    from rpaug.core import registry
    from rpaug.core.errors import BadInput
    from rpaug.core.files import apart

    if out.exists():
        raise BadInput(out, "--out", found="something there already", expected="a new path")
    apart(out, dataset)
    with progress_bar("looking", as_json) as progress:
        adapter = registry.adapter_for(dataset)
        done, failures = adapter.reobserve(dataset, out, simulator, progress, color)
    if as_json:
        print_json({"episodes": done, "failures": failures, "out": str(out)})
    else:
        for key, reason in failures.items():
            warn("skipped", f"{key}: {reason}")
        say(f"{counted(done, 'episode')} in {out}")
    return 0 if not failures else 1 if done else 2
