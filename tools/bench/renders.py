"""Speed against error of the splat kernels.

python -m tools.bench.renders --size 640x480 --gaussians 50000 --out speed
"""

from typing import Annotated, Any

import typer

from rpaug.cli.bench import OutFolder, Threads, show, write
from rpaug.cli.console import AsJson, EpisodeKey, guarded
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError
from tools.bench.harness import renders
from tools.bench.harness.sources import MaybeDataset, Origin, TwinSeed, TwinTask


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
    features: Annotated[int, typer.Option(min=0, max=64, help="Beside the colors.")] = 0,
    engine: Annotated[
        list[str] | None, typer.Option(help="Backend and precision: numba/float32, ...")
    ] = None,
    threads: Threads = 2,
    repeats: Annotated[int, typer.Option(min=1)] = 7,
    as_json: AsJson = False,
) -> int:
    """Milliseconds of rendering Gaussians, forward and backward, against the error to the float64 reference.

    Without a dataset or --twin, Gaussians are strewn. Repeat --size, --gaussians, --stride, --engine to sweep them.

    Example: [bold]python -m tools.bench.renders --size 640x480 --gaussians 50000 --out speed[/]
    """
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
        origin = Origin(dataset=dataset, episode=episode, task=twin, seed=seed)
        shown = renders.recorded_scenes(origin.read_with(frame), frame, stride or [2])
        asked = asked | origin.describe() | {"frame": frame}
    with progress_bar("rendering", as_json) as progress:
        rows, skipped = renders.run(setting, shown, progress)
    plain_rows = [vars(row) for row in rows]
    drawn = {"group": "engine", "label": "scene", "within": "scene"}
    write(out, "render", asked, plain_rows, renders.PANELS, drawn)
    columns = {
        "scene": "scene", "engine": "engine", "forward_ms": "forward ms", "both_ms": "with backward",
        "both_cpu_ms": "processor ms", "color_worst": "color error", "color_over": "over 1e-5",
        "gradient_error": "gradients",
    }  # fmt: skip
    show(out, plain_rows, columns, skipped, as_json)
    return 0 if rows else 2


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise RpaugError(f"--size {text}: expected WIDTHxHEIGHT, such as 640x480")
    return int(width), int(height)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
app.command()(guarded(render))

if __name__ == "__main__":
    app()
