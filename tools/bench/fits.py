"""Seconds against error of fits of Gaussians to one frame.

python -m tools.bench.fits data/train/open_drawer --stride 2 --stride 4 --out speed
"""

from typing import Annotated, Any

import typer

from rpaug.cli.bench import OutFolder, Threads, show, write
from rpaug.cli.console import AsJson, EpisodeKey, guarded
from rpaug.cli.progress import progress_bar
from tools.bench.harness import fits
from tools.bench.harness.sources import MaybeDataset, Origin, TwinSeed, TwinTask


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
    threads: Threads = 2,
    as_json: AsJson = False,
) -> int:
    """Seconds of fitting Gaussians to one frame against PSNR of recorded and of held-out pixels.

    Any dataset with depth will do, or the twin. Repeat --stride, --iterations, --optimiser, --engine to sweep them.

    Example: [bold]python -m tools.bench.fits data/train/open_drawer --stride 2 --stride 4 --out speed[/]
    """
    named: dict[str, Any] = {
        "strides": tuple(stride or ()),
        "iterations": tuple(iterations or ()),
        "optimisers": tuple(optimiser or ()),
        "engines": tuple(engine or ()),
    }
    setting = fits.FitSetting(**{k: v for k, v in named.items() if v}, threads=threads)
    origin = Origin(dataset=dataset, episode=episode, task=twin, seed=seed)
    found = origin.read_with(frame)
    with progress_bar("fitting", as_json) as progress:
        rows, traces, skipped = fits.run(setting, found, frame, progress)
    plain_rows = [vars(row) for row in rows]
    asked = vars(setting) | origin.describe() | {"frame": frame}
    drawn = {"group": "name", "label": "iterations"}
    write(out, "fit", asked, plain_rows, fits.PANELS, drawn, traces=traces)
    columns = {
        "name": "fit", "iterations": "iterations", "gaussians": "Gaussians", "seconds": "seconds",
        "processor_seconds": "processor s", "recorded_db": "recorded dB",
        "held_out_db": "held-out dB", "held_out_best_db": "at best", "held_out_best_seconds": "after s",
    }  # fmt: skip
    show(out, plain_rows, columns, skipped, as_json)
    return 0 if rows else 2


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
app.command()(guarded(fit))

if __name__ == "__main__":
    app()
