"""`rpaug bench render`, `fit`, `tiers`: speed against error."""

from collections.abc import Iterable
from itertools import count
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from rpaug.cli.console import AsJson, EpisodeKey, plain, print_json, progress_bar, warn
from rpaug.core.errors import RpaugError

WIDTH = 180  # columns of a printed table

OutFolder = Annotated[Path, typer.Option(help="New folder for table, JSON and plot.")]
MaybeDataset = Annotated[
    Path | None, typer.Argument(help="Folder of a dataset.", show_default=False)
]
TwinTask = Annotated[
    str | None,
    typer.Option("--twin", help="Record this task of the twin instead: open_drawer, ..."),
]
TwinSeed = Annotated[int, typer.Option("--seed", min=0, help="The twin's.")]
Plot = Annotated[bool, typer.Option(help="Also plot, which needs matplotlib.")]


def render(
    out: OutFolder,
    dataset: MaybeDataset = None,
    twin: TwinTask = None,
    seed: TwinSeed = 0,
    episode: EpisodeKey = None,
    frame: Annotated[int, typer.Option(min=0, help="Of the episode.")] = 0,
    stride: Annotated[
        list[int] | None, typer.Option(min=1, help="Of an episode: every so-many-th pixel.")
    ] = None,
    size: Annotated[
        list[str] | None, typer.Option(help="Of strewn Gaussians' images: 640x480.")
    ] = None,
    gaussians: Annotated[list[int] | None, typer.Option(min=1, help="Strewn ones.")] = None,
    features: Annotated[int, typer.Option(min=0, max=64, help="Beside the colours.")] = 0,
    engine: Annotated[
        list[str] | None, typer.Option(help="Backend and precision: numba/float32, ...")
    ] = None,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    repeats: Annotated[int, typer.Option(min=1)] = 7,
    plot: Plot = True,
    as_json: AsJson = False,
) -> int:
    """Milliseconds of rendering Gaussians, forward and backward, against the error to the float64 reference.

    Without a dataset or --twin, Gaussians are strewn. Repeat --size, --gaussians, --stride, --engine to sweep them.

    Example: [bold]rpaug bench render --size 640x480 --gaussians 50000 --out speed[/]
    """
    from rpaug.bench import renders

    named: dict[str, Any] = {
        "sizes": tuple(map(_size, size or ())),
        "counts": tuple(gaussians or ()),
        "engines": tuple(engine or ()),
    }
    named = {name: value for name, value in named.items() if value}
    setting = renders.RenderSetting(**named, features=features, threads=threads, repeats=repeats)
    asked: dict[str, Any] = vars(setting)
    if dataset is None and twin is None:
        shown = renders.strewn_scenes(setting)
    else:
        found, origin = _recorded(dataset, twin, seed, episode, frame)
        shown = renders.recorded_scenes(found, frame, stride or [2])
        asked = asked | origin | {"frame": frame}
    with progress_bar("rendering", as_json) as progress:
        rows, skipped = renders.run(setting, shown, progress)
    plain_rows = [vars(row) for row in rows]
    drawn = {"group": "engine", "label": "scene", "within": "scene"}
    _write(out, "render", asked, plain_rows, renders.PANELS if plot else (), drawn)
    columns = {
        "scene": "scene", "engine": "engine", "forward_ms": "forward ms", "both_ms": "with backward",
        "both_cpu_ms": "processor ms", "colour_worst": "colour error", "colour_over": "over 1e-5",
        "gradient_error": "gradients",
    }  # fmt: skip
    _print(out, plain_rows, columns, skipped, as_json)
    return 0 if rows else 2


def fit(
    out: OutFolder,
    dataset: MaybeDataset = None,
    twin: TwinTask = None,
    seed: TwinSeed = 0,
    episode: EpisodeKey = None,
    frame: Annotated[int, typer.Option(min=0, help="Of the episode.")] = 0,
    stride: Annotated[
        list[int] | None, typer.Option(min=1, help="Every so-many-th pixel a Gaussian.")
    ] = None,
    iterations: Annotated[list[int] | None, typer.Option(min=1)] = None,
    optimiser: Annotated[list[str] | None, typer.Option(help="adam, or 'adam, splitting'.")] = None,
    engine: Annotated[
        list[str] | None, typer.Option(help="Backend and precision: numba/float32, ...")
    ] = None,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    plot: Plot = True,
    as_json: AsJson = False,
) -> int:
    """Seconds of fitting Gaussians to one frame against PSNR of recorded and of held-out pixels.

    Any dataset with depth will do, or the twin. Repeat --stride, --iterations, --optimiser, --engine to sweep them.

    Example: [bold]rpaug bench fit data/train/open_drawer --stride 2 --stride 4 --out speed[/]
    """
    from rpaug.bench import fits

    named: dict[str, Any] = {
        "strides": tuple(stride or ()),
        "iterations": tuple(iterations or ()),
        "optimisers": tuple(optimiser or ()),
        "engines": tuple(engine or ()),
    }
    setting = fits.FitSetting(**{k: v for k, v in named.items() if v}, threads=threads)
    found, origin = _recorded(dataset, twin, seed, episode, frame)
    with progress_bar("fitting", as_json) as progress:
        rows, traces, skipped = fits.run(setting, found, frame, progress)
    plain_rows = [vars(row) for row in rows]
    asked = vars(setting) | origin | {"frame": frame}
    drawn = {"group": "name", "label": "iterations"}
    panels = fits.PANELS if plot else ()
    _write(out, "fit", asked, plain_rows, panels, drawn, traces=traces)
    columns = {
        "name": "fit", "iterations": "iterations", "gaussians": "Gaussians", "seconds": "seconds",
        "processor_seconds": "processor s", "recorded_db": "recorded dB",
        "held_out_db": "held-out dB", "held_out_best_db": "at best", "held_out_best_seconds": "after s",
    }  # fmt: skip
    _print(out, plain_rows, columns, skipped, as_json)
    return 0 if rows else 2


def tiers(
    out: OutFolder,
    dataset: MaybeDataset = None,
    twin: TwinTask = None,
    seed: TwinSeed = 0,
    episode: EpisodeKey = None,
    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            help="Of a dataset: cameras to show without their own recording; default all fixed."
        ),
    ] = None,
    seeds: Annotated[
        int, typer.Option(min=1, help="Recordings of the twin, from --seed on, taken together.")
    ] = 1,
    frames: Annotated[int, typer.Option(min=2, help="That the twin records.")] = 17,
    every: Annotated[int, typer.Option(min=1, help="Frames between the views compared.")] = 8,
    method: Annotated[list[str] | None, typer.Option(help="Only these methods.")] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Of each fit of Gaussians, at most.")
    ] = None,
    threads: Annotated[int, typer.Option(min=1)] = 2,
    plot: Plot = True,
    as_json: AsJson = False,
) -> int:
    """Every tier on the same views: on the twin's truly moved cameras, or on a dataset leaving one camera out.

    Each recording, and each camera that is left out, takes a fit of its own: minutes.

    Example: [bold]rpaug bench tiers --twin open_drawer --out tiers[/]
    """
    from rpaug.bench import moved, sources
    from rpaug.bench import tiers as measured

    methods = tuple(method or measured.METHODS)
    measured.check(methods)
    origin = sources.Origin(dataset=dataset, episode=episode, task=twin, seed=seed, frames=frames)
    rows = []
    with progress_bar("measuring", as_json) as progress:
        done = count(1)

        def given(views_of: str, found: Iterable[Any], total: int) -> list[Any]:
            def step() -> None:
                progress(next(done), total)

            return measured.run(views_of, found, methods, steps, threads, step)

        if twin is not None:
            span = range(seed, seed + seeds)
            found = (moved.on_the_twin(twin, one, frames, every) for one in span)
            name = f"{twin} {seed}" if seeds == 1 else f"{twin} {seed} to {span[-1]}"
            rows += given(f"{name}, moved", found, seeds * len(methods))
        else:
            recorded = origin.read()
            fixed = [name for name, view in recorded.views.items() if view.camera.fixed]
            names = leave_out or fixed
            for name in names:
                if name not in recorded.views:
                    known = ", ".join(recorded.views)
                    raise RpaugError(f"--leave-out {name}: the cameras are {known}")
                pairs = [moved.left_out(recorded, name, every)]
                rows += given(f"{name} left out", pairs, len(names) * len(methods))
    plain_rows = [vars(row) for row in rows]
    asked = origin.describe() | {"seeds": seeds, "every": every, "steps": steps, "threads": threads}
    drawn = {"group": "method", "label": "tier", "within": "views_of"}
    _write(out, "tiers", asked, plain_rows, measured.PANELS if plot else (), drawn)
    columns = {
        "views_of": "views", "method": "method", "all_db": "dB", "covisible_db": "co-visible",
        "ssim": "SSIM", "depth_median_mm": "depth mm", "depth_far_percent": "> 20 mm %",
        "holes_percent": "holes %", "milliseconds_a_view": "ms a view", "prepare_seconds": "prepare s",
    }  # fmt: skip
    _print(out, plain_rows, columns, {}, as_json)
    return 0 if rows else 2


def _recorded(
    dataset: Path | None, twin: str | None, seed: int, episode: str | None, frame: int
) -> tuple[Any, dict[str, Any]]:
    """An episode that has the frame, and where it is from."""
    from rpaug.bench import sources

    origin = sources.Origin(dataset=dataset, episode=episode, task=twin, seed=seed)
    found = origin.read()
    if frame >= found.length:
        raise RpaugError(f"--frame {frame}: the episode has frames 0 to {found.length - 1}")
    return found, origin.describe()


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise RpaugError(f"--size {text}: expected WIDTHxHEIGHT, such as 640x480")
    return int(width), int(height)


def _write(
    out: Path,
    name: str,
    setting: dict[str, Any],
    rows: list[dict[str, Any]],
    panels: Any,
    drawn: dict[str, Any],
    **more: Any,
) -> None:
    """The rows as CSV and JSON, and the plot if there are panels, in a new folder."""
    from rpaug.bench import pareto, tables
    from rpaug.core.files import atomic_folder

    with atomic_folder(out) as folder:
        (folder / f"{name}.csv").write_bytes(tables.as_csv(rows))
        (folder / f"{name}.json").write_bytes(tables.as_json(setting, rows, **more))
        if panels and rows:
            pareto.plot(folder / f"{name}.png", rows, panels, **drawn)


def _print(
    out: Path,
    rows: list[dict[str, Any]],
    columns: dict[str, str],
    skipped: dict[str, str],
    as_json: bool,
) -> None:
    if as_json:
        print_json({"out": str(out), "skipped": skipped, "rows": rows})
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
    printer.print(f"written: {out}", highlight=False, soft_wrap=True)


def _figure(value: Any) -> str:
    if value is None:
        return "-"
    if not isinstance(value, float):
        return plain(str(value))
    if value == 0 or 0.01 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1 else f"{value:.1f}"
    return f"{value:.1e}"
