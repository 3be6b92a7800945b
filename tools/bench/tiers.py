"""Every tier on the twin's truly moved cameras; `rpaug bench tiers DATASET` leaves cameras of a dataset out instead.

python -m tools.bench.tiers --twin open_drawer --out tiers
"""

from itertools import count
from typing import Annotated

import typer

from rpaug.cli.bench import COLUMNS, Every, Methods, OutFolder, Steps, Threads, show, write
from rpaug.cli.console import AsJson, guarded
from rpaug.cli.progress import progress_bar
from rpaug.pipeline import speed_error
from tools.bench.harness import tiers as measured


def tiers(
    task: Annotated[str, typer.Option("--twin", help="Task of the twin: open_drawer, ...")],
    out: OutFolder,
    seed: Annotated[int, typer.Option(min=0, help="The first recording's.")] = 0,
    seeds: Annotated[int, typer.Option(min=1, help="Recordings taken together.")] = 1,
    frames: Annotated[int, typer.Option(min=2, help="Of a recording.")] = 17,
    every: Every = 8,
    methods: Methods = None,
    steps: Steps = None,
    threads: Threads = 2,
    as_json: AsJson = False,
) -> int:
    """Every tier on the same views: on the twin's truly moved cameras.

    Each recording takes a fit of its own: minutes.

    Example: [bold]python -m tools.bench.tiers --twin open_drawer --out tiers[/]
    """
    chosen = speed_error.chosen(methods, measured.METHODS)
    span = range(seed, seed + seeds)
    name = f"{task} {seed}" if seeds == 1 else f"{task} {seed} to {span[-1]}"
    with progress_bar("measuring", as_json) as progress:
        done, total = count(1), seeds * len(chosen)
        found = (measured.on_the_twin(task, one, frames, every) for one in span)
        rows = speed_error.run(
            f"{name}, moved", found, chosen, steps, threads, lambda: progress(next(done), total)
        )
    plain_rows = [vars(row) for row in rows]
    asked = {"task": task, "seed": seed, "seeds": seeds, "frames": frames}
    asked |= {"every": every, "steps": steps, "threads": threads}
    drawn = {"group": "method", "label": "tier"}
    write(out, "tiers", asked, plain_rows, speed_error.PANELS, drawn)
    show(out, plain_rows, COLUMNS, {}, as_json)
    return 0


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
app.command()(guarded(tiers))

if __name__ == "__main__":
    app()
