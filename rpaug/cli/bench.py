"""`rpaug bench`: speed against error of every tier, and where a copy's time goes, on your own dataset."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from rpaug.cli.console import (
    AsJson,
    Dataset,
    EpisodeKey,
    plain,
    print_json,
    read_episode,
    say,
    warn,
)
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError

WIDTH = 180  # columns of a printed table
BAR = 30  # characters of the longest
COLUMNS = {
    "views_of": "views", "method": "method", "all_db": "dB", "covisible_db": "co-visible",
    "ssim": "SSIM", "depth_median_mm": "depth mm", "depth_far_percent": "> 20 mm %",
    "holes_percent": "holes %", "milliseconds_a_view": "ms a view", "prepare_seconds": "prepare s",
}  # fmt: skip

OutFolder = Annotated[Path, typer.Option(help="New folder for table, JSON and plot.")]
Every = Annotated[int, typer.Option(min=1, help="Frames between the views compared.")]
Methods = Annotated[list[str] | None, typer.Option("--method", help="Only these methods.")]
Steps = Annotated[int | None, typer.Option(min=1, help="Of each fit of Gaussians, at most.")]
Threads = Annotated[int, typer.Option(min=1)]


def tiers(
    dataset: Dataset,
    out: OutFolder,
    episode: EpisodeKey = None,
    leave_out: Annotated[
        list[str] | None,
        typer.Option(help="Cameras to show without their own recording; default all fixed."),
    ] = None,
    every: Every = 8,
    methods: Methods = None,
    steps: Steps = None,
    threads: Threads = 2,
    as_json: AsJson = False,
) -> int:
    """Speed against error of every tier on one episode: each camera in turn is left out, and shown from the others.

    Needs two cameras with depth and masks. Each camera that is left out takes a fit of its own: minutes.

    Example: [bold]rpaug bench tiers sample --out tiers[/]
    """
    from rpaug.pipeline import left_out, pareto, speed_error

    shown = speed_error.chosen(methods)
    recorded = read_episode(dataset, episode)
    fixed = [name for name, view in recorded.views.items() if view.camera.fixed]
    names = leave_out or fixed
    if not names:
        raise RpaugError("no camera is fixed: name one with --leave-out")
    for name in names:
        if name not in recorded.views:
            raise RpaugError(f"--leave-out {name}: the cameras are {', '.join(recorded.views)}")
    rows: list[dict[str, Any]] = []
    with progress_bar("measuring", as_json) as progress:
        done, total = count(1), len(names) * len(shown)
        for name in names:
            pair = left_out.left_out(recorded, name, every)
            found = speed_error.run(
                f"{name} left out", [pair], shown, steps, threads,
                lambda: progress(next(done), total),
            )  # fmt: skip
            rows += map(vars, found)
    asked = {"dataset": dataset.name, "episode": episode, "every": every, "steps": steps}
    best = {
        views_of: [
            row["method"]
            for row in pareto.unbeaten(
                [row for row in rows if row["views_of"] == views_of], speed_error.PANELS[0]
            )
        ]
        for views_of in dict.fromkeys(row["views_of"] for row in rows)
    }
    drawn = {"group": "method", "label": "tier", "within": "views_of"}
    write(
        out, "bench", asked | {"threads": threads}, rows, speed_error.PANELS, drawn, unbeaten=best
    )
    show(out, rows, COLUMNS, {}, as_json, unbeaten=best)
    if not as_json:
        for views_of, unbeaten in best.items():
            say(f"{views_of}: nothing is both faster and nearer than {', '.join(unbeaten)}")
    return 0


def speed(
    dataset: Dataset,
    recipe: Annotated[str, typer.Option(help="Recipe file, or the name of one that ships.")],
    episode: EpisodeKey = None,
    copies: Annotated[int, typer.Option(min=1, help="Of the whole recipe, that are timed.")] = 3,
    tier: Annotated[int, typer.Option(min=0, max=4, help="Least tier, as of augment.")] = 0,
    as_json: AsJson = False,
) -> int:
    """Where a copy's time goes on one episode: what is done once, what its files cost, and what each edit adds.

    Copies are written to a temporary folder. Seconds are those of processors, all threads together.

    Example: [bold]rpaug bench speed sample --recipe robust[/]
    """
    from rpaug.pipeline import inputs, spent
    from rpaug.pipeline.run import Run

    run = Run(dataset, inputs.recipe(recipe), Path(), tier)
    key = read_episode(dataset, episode).key
    parts = []
    with progress_bar("measuring", as_json) as progress:
        options = sum(len(step.options) for step in run.recipe.steps)
        for part in spent.measure(run, key, copies):
            parts.append(part)
            progress(len(parts), options + spent.FIXED)
    if as_json:
        print_json({"episode": key, "parts": [vars(part) for part in parts]})
        return 0
    longest = max(part.seconds for part in parts)
    table = Table("", "processor s", "", box=box.SIMPLE_HEAD)
    for part in parts:
        shown = "*" * round(BAR * max(part.seconds, 0) / longest)
        when = " (once)" if part.once else ""
        table.add_row(
            plain(part.part) + when, "-" if part.left_out else f"{part.seconds:.2f}", shown
        )
    Console().print(table)
    for part in parts:
        if part.left_out:
            warn("not timed", f"{part.part}: {part.left_out}")
    once, copy = spent.sums(parts)
    say(f"an episode of {key}'s kind: {once:.1f} s once and {copy:.2f} s a copy")
    return 0


def write(
    out: Path,
    name: str,
    setting: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    panels: Any,
    drawn: Mapping[str, Any],
    **more: Any,
) -> None:
    """The rows as CSV and JSON in a new folder, and a plot where matplotlib is installed."""
    from rpaug.core.files import atomic_folder
    from rpaug.pipeline import pareto

    with atomic_folder(out) as folder:
        (folder / f"{name}.csv").write_bytes(pareto.as_csv(rows))
        (folder / f"{name}.json").write_bytes(pareto.as_json(setting, rows, **more))
        if rows and find_spec("matplotlib"):
            pareto.plot(folder / f"{name}.png", rows, panels, **drawn)


def show(
    out: Path,
    rows: Sequence[Mapping[str, Any]],
    columns: Mapping[str, str],
    skipped: Mapping[str, str],
    as_json: bool,
    **more: Any,
) -> None:
    """Print some columns under their titles; or, as JSON, all of the rows and anything `more`."""
    if as_json:
        print_json({"out": str(out), "skipped": skipped, **more, "rows": rows})
        return
    for name, reason in skipped.items():
        warn("skipped", f"{name}: {reason}")
    terminal = Console()
    printer = Console(width=max(terminal.width, WIDTH), height=terminal.height)
    table = Table(box=box.SIMPLE_HEAD)
    for number, title in enumerate(columns.values()):
        table.add_column(title, justify="left" if number < 2 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(_figure(row[name]) for name in columns))
    printer.print(table)
    say(f"written: {out}")


def _figure(value: Any) -> str:
    if value is None:
        return "-"
    if not isinstance(value, float):
        return plain(str(value))
    if value == 0 or 0.01 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1 else f"{value:.1f}"
    return f"{value:.1e}"
