"""Every factor's edit, and baselines, against the factor truly changed on the twin: error and seconds.

python -m tools.bench.edits --factor object_color --seeds 10 --out edits
"""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from rpaug import twin
from rpaug.cli.console import AsJson, guarded, print_json, warn
from rpaug.cli.progress import progress_bar
from rpaug.core.files import atomic_folder
from rpaug.pipeline import pareto
from tools.bench.harness import edits as measured
from tools.bench.harness import lights, pages, perceptual, sheets


def edits(
    out: Annotated[Path, typer.Option(help="New folder for table, sheets and plot.")],
    factor: Annotated[list[str] | None, typer.Option(help="Only these factors.")] = None,
    task: Annotated[list[str] | None, typer.Option(help="Only these tasks, in turn.")] = None,
    seeds: Annotated[int, typer.Option(min=1)] = 10,
    first_seed: Annotated[int, typer.Option(min=0, help="The first of the seeds.")] = 0,
    frames: Annotated[int, typer.Option(min=2)] = 17,
    size: Annotated[int, typer.Option(min=8, help="Pixels a side.")] = 128,
    antialias: Annotated[bool, typer.Option(help="Anti-alias the color images.")] = False,
    light: Annotated[
        measured.Light, typer.Option(help="Let the lamps cast shadows, be mirrored, or both.")
    ] = "plain",
    lamps: Annotated[int, typer.Option(min=1, max=3, help="How many there are.")] = 3,
    finish: Annotated[
        twin.Finish | None, typer.Option(help="Of what the task moves, under highlights.")
    ] = None,
    gaussians: Annotated[
        bool, typer.Option(help="Also render fitted Gaussians alone: minutes a seed.")
    ] = False,
    plot: Annotated[bool, typer.Option(help="Also plot error against seconds.")] = False,
    vgg: Annotated[
        Path | None,
        typer.Option(help="An ImageNet state dict of VGG16."),
    ] = None,
    lpips: Annotated[Path | None, typer.Option(help="LPIPS' state dict for VGG16.")] = None,
    clip: Annotated[Path | None, typer.Option(help="Folder of a CLIP model.")] = None,
    record: Annotated[bool, typer.Option(help="Also put a table on that light's page.")] = False,
    as_json: AsJson = False,
) -> int:
    """Measure every factor's edit, and baselines, against the factor truly changed.

    Example: [bold]python -m tools.bench.edits --factor object_color --seeds 10 --out edits[/]
    """
    switches = {"antialias": antialias, "light": light, "lamps": lamps, "finish": finish}
    shape = {
        "seeds": seeds,
        "first_seed": first_seed,
        "frames": frames,
        "size": size,
        "gaussians": gaussians,
    }
    files = {"vgg": vgg, "lpips": lpips, "clip": clip}
    eyes = perceptual.Eyes(**{name: str(path) for name, path in files.items() if path})
    judged = perceptual.opened(eyes).names
    chosen = {"factors": factor, "tasks": task}
    named = {name: tuple(value) for name, value in chosen.items() if value}
    setting = measured.EditSetting(**named, **shape, **switches, eyes=eyes)  # type: ignore[arg-type]
    skipped = measured.missing(setting)
    with atomic_folder(out) as folder:
        kept = sheets.Sheets(folder, setting)
        with progress_bar("measuring", as_json) as progress:
            rows = measured.run(setting, kept.keep, progress)
        found = measured.summary(rows)
        images = list(kept.write().values())
        if plot:
            images.append(sheets.plot(folder / "edits.png", found))
        flat = [row.flat() for row in rows]
        document = pareto.as_json(asdict(setting), flat, skipped=skipped, summary=found)
        (folder / "edits.json").write_bytes(document)
        (folder / "edits.csv").write_bytes(pareto.as_csv(flat))
        sheets.page(folder, found, images)
    if record:
        given = [one for one in sys.argv[1:] if one != "--record"]
        command = " ".join(["python -m tools.bench.edits", *given])
        pages.record(lights.TOPICS[light], lights.table(setting, rows, command))
    if as_json:
        print_json({"out": str(out), "skipped": skipped, "summary": found})
    else:
        _print_bench(found, skipped, out, judged)
    return 0 if rows else 2


BENCH_WIDTH = 140  # columns of the printed table
BENCH_DIGITS = {
    "psnr": 1, "psnr_worst": 1, "psnr_scaled": 1, "ssim": 3, "ciede2000": 2, "outside_worst": 0, "flicker": 2,
    "holes": 3, "depth": 2, "iou": 3, "reprojection": 3, "seconds": 2,
}  # fmt: skip


def _print_bench(
    found: list[dict[str, Any]], skipped: dict[str, str], out: Path, judged: tuple[str, ...]
) -> None:
    for name, reason in skipped.items():
        warn("skipped", f"{name}: {reason}")
    terminal = Console()
    # Both sides given: else a dumb terminal is taken for 80 columns, and figures are cut off.
    width = max(terminal.width, BENCH_WIDTH + 8 * len(judged))
    printer = Console(width=width, height=terminal.height)
    for factor in dict.fromkeys(entry["factor"] for entry in found):
        table = Table(title=factor, title_justify="left", box=box.SIMPLE_HEAD)
        for name in (
            "method",
            "dB",
            "worst",
            "lead",
            "scaled",
            "SSIM",
            "ΔE00",
            "outside",
            "flicker",
        ):
            table.add_column(name, justify="left" if name == "method" else "right", no_wrap=True)
        for name in ("holes", "depth mm", "IoU", "across mm", "CPU s", *judged):
            table.add_column(name, justify="right", no_wrap=True)
        for entry in found:
            if entry["factor"] == factor:
                digits = BENCH_DIGITS | dict.fromkeys(judged, 3)
                figures = [f"{entry[name]:.{places}f}" for name, places in digits.items()]
                lead = "" if entry["lead"] is None else f"{entry['lead']:+.1f}"
                table.add_row(entry["method"], *figures[:2], lead, *figures[2:])
        printer.print(table)
    printer.print(f"sheets: {out / sheets.PAGE}", highlight=False, soft_wrap=True)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
app.command()(guarded(edits))

if __name__ == "__main__":
    app()
