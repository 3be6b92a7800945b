"""The command line. Every command prints for people, or with --json for programs; exit codes are 0, 1 and 2.

0: done. 1: done, but some episodes were skipped. 2: nothing was done; one line says why.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from rpaug.errors import BadInput, RpaugError

app = typer.Typer(
    name="rpaug",
    help="Multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
twin_app = typer.Typer(help="A simulated tabletop that knows the truth.", no_args_is_help=True)
app.add_typer(twin_app, name="twin")
bench_app = typer.Typer(help="Error and seconds, measured on the twin.", no_args_is_help=True)
app.add_typer(bench_app, name="bench")
console = Console(stderr=True)

Dataset = Annotated[Path, typer.Argument(help="Folder of a dataset.", show_default=False)]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON value on stdout, nothing else.")
]


def main() -> None:
    """Entry point of the `rpaug` command."""
    app()


def _guarded(command: Callable[..., int]) -> Callable[..., None]:
    """Expected failures become one line and exit code 2; a bug of ours says so, and how to see it."""

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            code = command(*args, **kwargs)
        except RpaugError as error:
            code = _fail(str(error), kwargs.get("as_json", False))
        except OSError as error:
            place = f"{error.filename}: " if error.filename else ""
            code = _fail(f"{place}{error.strerror or error}", kwargs.get("as_json", False))
        except KeyboardInterrupt:
            code = _fail(
                "stopped; what is in an output folder is whole", kwargs.get("as_json", False)
            )
        except (typer.Exit, typer.Abort):
            raise
        except Exception as error:
            if os.environ.get("RPAUG_DEBUG"):
                raise
            name = type(error).__name__
            code = _fail(
                f"a fault in rpaug ({name}: {error}); RPAUG_DEBUG=1 shows where",
                kwargs.get("as_json", False),
            )
        raise typer.Exit(code)

    return run


def _fail(message: str, as_json: bool) -> int:
    if as_json:
        _print_json({"error": message})
    else:
        console.print(f"[bold red]error[/] {_plain(message)}", highlight=False, soft_wrap=True)
    return 2


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


def _print_json(value: Any) -> None:
    sys.stdout.write(json.dumps(value, indent=1, ensure_ascii=False) + "\n")


@contextmanager
def _progress(title: str, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=quiet, transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@app.command()
@_guarded
def augment(
    dataset: Dataset,
    recipe: Annotated[
        str,
        typer.Option(help="Recipe file, or the name of one that ships (demo, light_color, ...)."),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write; must not exist unless --resume.")],
    workers: Annotated[
        int, typer.Option(min=1, help="Processes. Any number gives the same output.")
    ] = 1,
    tier: Annotated[
        int, typer.Option(min=0, max=3, help="Least tier: 0 pixels, 1 surfels, 3 Gaussians.")
    ] = 0,
    scenes: Annotated[
        Path | None, typer.Option(help="Store of fitted scenes, for tier 3: `rpaug fit --out`.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the recipe's.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: edits.0.color=red.")
    ] = None,
    resume: Annotated[bool, typer.Option(help="Go on with a run that was stopped.")] = False,
    dry_run: Annotated[
        bool, typer.Option(help="Print the plan with time and disk, write nothing.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Write edited copies of a dataset's episodes, in the format they came in.

    Example: [bold]rpaug augment data/train/open_drawer --recipe recipe.yaml --out augmented --workers 2[/]
    """
    from rpaug.augment import Run, execute

    if tier == 2:
        raise RpaugError("--tier 2: assets enter at any tier; the least tier is 0, 1 or 3")
    loaded = _recipe(recipe, [*(set_ or []), *([f"seed={seed}"] if seed is not None else [])])
    run = Run(dataset, loaded, out, tier, scenes)
    if dry_run:
        return _dry_run(run, resume, as_json)
    with _progress("augmenting", as_json) as progress:
        summary = execute(run, workers=workers, resume=resume, progress=progress)
    code = summary.exit_code
    described = {**vars(summary), "out": str(out)}
    if summary.copies:
        code = max(code, _contact_sheet(run, described))
    elif summary.failures or summary.aborted:
        described["error"] = summary.aborted or next(iter(summary.failures.values()))
    if as_json:
        _print_json(described)
    else:
        _print_summary(described)
    return code


def _contact_sheet(run: Any, described: dict[str, Any]) -> int:
    """Write the sheet; the episodes are done whether it can be or not."""
    from rpaug import contact

    try:
        described["contact_sheet"] = str(contact.write(run.adapter, run.source, run.target))
    except (RpaugError, OSError) as error:
        described["contact_sheet"], described["contact_sheet_error"] = None, str(error)
        return 1
    return 0


def _recipe(name: str, overrides: list[str]) -> Any:
    from rpaug import recipe

    path = Path(name)
    if not path.is_file():
        import rpaug_recipes

        folder = Path(rpaug_recipes.__file__).parent
        shipped = folder / f"{name}.yaml"
        if not shipped.resolve().is_relative_to(folder.resolve()) or not shipped.is_file():
            known = sorted(
                p.relative_to(folder).with_suffix("").as_posix()
                for p in folder.rglob("*.yaml")
                if "tasks" not in p.parts
            )
            raise BadInput(
                name,
                "--recipe",
                found="no such file",
                expected=f"a recipe file or one of: {', '.join(known)}",
            )
        path = shipped
    return recipe.load(path, overrides)


def _dry_run(run: Any, resume: bool, as_json: bool) -> int:
    """What a run would do. Everything is checked that can be without looking at images."""
    from rpaug import pipeline, plan
    from rpaug.augment import check

    check(run, resume)
    plans, total, failed = [], {"seconds": 0.0, "megabytes": 0.0}, {}
    for key in run.keys:
        try:
            episode = run.adapter.read(run.source, key)
        except RpaugError as error:
            failed[key] = str(error)
            continue
        made = plan.make(pipeline.operators(run.recipe), episode, run.tier)
        cost = made.cost(episode, len(run.copies))
        total = {name: round(total[name] + cost[name], 1) for name in total}
        plans.append(
            {"episode": key, "frames": episode.length, **made.describe(), "estimate": cost}
        )
    described = {"copies": len(run.copies), "plans": plans, "unreadable": failed, "estimate": total}
    if as_json:
        _print_json(described)
        return 2 if not plans else 1 if failed else 0
    for one in plans:
        carriers = ", ".join(sorted(set(one["carriers"].values())))
        bodies = "bodies tracked" if one["bodies"] else "bodies not needed"
        about = f"about {one['estimate']['seconds']} s, {one['estimate']['megabytes']} MB"
        _say(f"{one['episode']}: {one['frames']} frames; at most {carriers}; {bodies}; {about}")
    for key, reason in failed.items():
        console.print(
            f"[yellow]would skip[/] {_plain(key)}: {_plain(reason)}",
            highlight=False,
            soft_wrap=True,
        )
    _say(
        f"{len(plans) * len(run.copies)} copies, about {total['seconds']} s on one core and "
        f"{total['megabytes']} MB. Nothing was written."
    )
    return 2 if not plans else 1 if failed else 0


def _say(line: str) -> None:
    """One line on stdout, never wrapped."""
    Console().print(_plain(line), highlight=False, soft_wrap=True)


def _print_summary(described: dict[str, Any]) -> None:
    for key, reason in described["failures"].items():
        console.print(
            f"[yellow]skipped[/] {_plain(key)}: {_plain(reason)}", highlight=False, soft_wrap=True
        )
    if described["aborted"]:
        console.print(
            f"[bold red]stopped[/] {_plain(described['aborted'])}", highlight=False, soft_wrap=True
        )
    if not described["copies"]:
        return
    seconds = ", ".join(f"{stage} {value:.1f}" for stage, value in described["seconds"].items())
    _say(f"{described['copies']} episodes in {described['out']} (seconds: {seconds})")
    _say("If RVT trained on this path before, delete its replay folder: it would be reused.")
    if described["contact_sheet"]:
        _say(f"contact sheet: {described['contact_sheet']}")
    else:
        console.print(
            f"[yellow]no contact sheet[/] {_plain(described['contact_sheet_error'])}",
            soft_wrap=True,
        )


@app.command("validate-recipe")
@_guarded
def validate_recipe(
    recipe: Annotated[
        str | None, typer.Argument(help="Recipe file or shipped name.", show_default=False)
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: edits.0.color=red.")
    ] = None,
    schema: Annotated[bool, typer.Option(help="Print the JSON Schema of recipes instead.")] = False,
    as_json: AsJson = False,
) -> int:
    """Check a recipe without touching any data.

    Example: [bold]rpaug validate-recipe recipe.yaml[/]
    """
    from rpaug import recipe as recipes

    if schema:
        _print_json(recipes.schema())
        return 0
    if recipe is None:
        raise RpaugError("name a recipe, or --schema")
    loaded = _recipe(recipe, set_ or [])
    if as_json:
        _print_json({"valid": True, "recipe": loaded.source})
    else:
        names = [" or ".join(option.name for option in step.options) for step in loaded.steps]
        Console().print(
            f"valid: {', '.join(names) or 'no edits'}; {loaded.copies} copies, seed {loaded.seed}"
        )
    return 0


@app.command()
@_guarded
def inspect(
    dataset: Dataset,
    episode: Annotated[
        str | None, typer.Option(help="Key of one episode; the first if not given.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="Also write a page with thumbnails to this new file.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Show cameras, frames, instruction and every instance: handle, role, colour, size, motion.

    Example: [bold]rpaug inspect data/train/open_drawer --html instances.html[/]
    """
    from rpaug import inspect as inspection

    found = _episode(dataset, episode)
    described, rows = inspection.inspect(found)
    if html is not None:
        _write_new(html, inspection.page(found, described, rows))
        described["html"] = str(html)
    if as_json:
        _print_json(described)
        return 0
    _say(f"{described['episode']}: “{described['instruction']}”, {found.length} frames")
    _say(f"key frames: {', '.join(map(str, described['key_frames'])) or 'none'}")
    for name, camera in described["cameras"].items():
        kind = "fixed" if camera["fixed"] else "moving"
        _say(
            f"  {name}: {camera['width']}x{camera['height']}, {kind}, {', '.join(camera['images'])}"
        )
    if not rows:
        _say("no instances: that takes masks and depth")
        return 0
    _say(
        f"{'handle':>8}  {'role':12}{'colour':9}{'size, cm':22}{'motion':20}{'off, mm':>8}{'frames':>8}  body"
    )
    for row in rows:
        motion = f"{row.motion} (ambiguous)" if row.ambiguous else row.motion
        size = " x ".join(f"{side:.1f}" for side in row.size_cm)
        body = ", ".join(map(str, sorted(row.body))) if len(row.body) > 1 else ""
        line = f"{row.handle:>8}  {row.role:12}{row.colour_name:9}{size:22}{motion:20}{row.residual_mm:8.2f}"
        _say(f"{line}{row.frames:8d}  {body}")
    return 0


@app.command("fit")
@_guarded
def fit_command(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Folder of the scene store; scenes are added to it.")],
    episode: Annotated[
        str | None, typer.Option(help="Key of one episode; the first if not given.")
    ] = None,
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

    found = _episode(dataset, episode)
    with _progress("fitting", as_json) as progress:
        described = fit_episode(found, out, export=ply, seed=seed, steps=steps, progress=progress)
    if as_json:
        _print_json(described)
    else:
        out_console = Console()
        for name, value in described.items():
            out_console.print(f"{name}: {value}", highlight=False, soft_wrap=True)
    return 0


@twin_app.command("record")
@_guarded
def twin_record(
    out: Annotated[Path, typer.Option(help="Dataset folder to add the task's episodes to.")],
    task: Annotated[
        str,
        typer.Option(
            help="open_drawer, pick_block, push_button, slide_block, stack_cups, put_in_box."
        ),
    ] = "open_drawer",
    seed: Annotated[int, typer.Option(min=0)] = 0,
    factor: Annotated[
        str | None,
        typer.Option(
            help="Truly change object_color, object_texture, light_color, light_direction, table_color, "
            "table_texture, background_texture or camera_pose."
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(help="A part, manipulated or receiver, instead of the factor's usual parts."),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1)] = 1,
    frames: Annotated[int, typer.Option(min=2)] = 60,
    size: Annotated[int, typer.Option(min=8, help="Pixels a side.")] = 128,
    antialias: Annotated[bool, typer.Option(help="Anti-alias the colour images.")] = False,
    specular: Annotated[bool, typer.Option(help="Give surfaces highlights.")] = False,
    shadows: Annotated[bool, typer.Option(help="Let the lamps cast shadows.")] = False,
    as_json: AsJson = False,
) -> int:
    """Record episodes of a simulated tabletop in RLBench's format, with the truth beside them.

    The same seed records the same motion, so a second call with --factor shows what a true change looks like.

    Example: [bold]rpaug twin record --task open_drawer --seed 3 --factor object_color --out truth[/]
    """
    from rpaug import twin

    look = twin.Look(antialias=antialias, specular=specular, shadows=shadows)
    takes = twin.record(
        task,
        seed,
        out,
        factor=factor,
        target=target,
        look=look,
        size=size,
        frames=frames,
        episodes=episodes,
    )
    written = [str(out / take.episode.key) for take in takes]
    if as_json:
        _print_json({"episodes": written, "truth": [take.truth.describe() for take in takes]})
    else:
        for path in written:
            Console().print(path, highlight=False, soft_wrap=True)
    return 0


@bench_app.command("edits")
@_guarded
def bench_edits(
    out: Annotated[Path, typer.Option(help="New folder for table, sheets and plot.")],
    factor: Annotated[list[str] | None, typer.Option(help="Only these factors.")] = None,
    task: Annotated[list[str] | None, typer.Option(help="Only these tasks, in turn.")] = None,
    seeds: Annotated[int, typer.Option(min=1)] = 10,
    frames: Annotated[int, typer.Option(min=2)] = 17,
    size: Annotated[int, typer.Option(min=8, help="Pixels a side.")] = 128,
    antialias: Annotated[bool, typer.Option(help="Anti-alias the colour images.")] = False,
    specular: Annotated[bool, typer.Option(help="Give surfaces highlights.")] = False,
    shadows: Annotated[bool, typer.Option(help="Let the lamps cast shadows.")] = False,
    gaussians: Annotated[
        bool, typer.Option(help="Also render fitted Gaussians alone: minutes a seed.")
    ] = False,
    plot: Annotated[bool, typer.Option(help="Also plot error against seconds.")] = False,
    as_json: AsJson = False,
) -> int:
    """Measure every factor's edit, and baselines, against the factor truly changed.

    Example: [bold]rpaug bench edits --factor object_color --seeds 10 --out edits[/]
    """
    from rpaug.bench import edits, sheets
    from rpaug.files import atomic_folder

    switches = {"antialias": antialias, "specular": specular, "shadows": shadows}
    shape = {"seeds": seeds, "frames": frames, "size": size, "gaussians": gaussians}
    chosen = {"factors": factor, "tasks": task}
    named = {name: tuple(value) for name, value in chosen.items() if value}
    setting = edits.Setting(**named, **shape, **switches)  # type: ignore[arg-type]
    skipped = edits.missing(setting)
    with atomic_folder(out) as folder:
        kept = sheets.Sheets(folder, setting)
        with _progress("measuring", as_json) as progress:
            rows = edits.run(setting, kept.keep, progress)
        found = edits.summary(rows)
        images = list(kept.write().values())
        if plot:
            images.append(sheets.plot(folder / "edits.png", found))
        (folder / "edits.json").write_bytes(edits.encoded(setting, rows))
        (folder / "edits.csv").write_bytes(edits.table(rows))
        sheets.page(folder, found, images)
    if as_json:
        _print_json({"out": str(out), "skipped": skipped, "summary": found})
    else:
        _print_bench(found, skipped, out)
    return 0 if rows else 2


BENCH_WIDTH = 140  # columns of the printed table
BENCH_DIGITS = {
    "psnr": 1, "psnr_worst": 1, "psnr_scaled": 1, "ssim": 3, "ciede2000": 2, "outside_worst": 0, "flicker": 2,
    "holes": 3, "depth": 2, "iou": 3, "reprojection": 3, "seconds": 2,
}  # fmt: skip


def _print_bench(found: list[dict[str, Any]], skipped: dict[str, str], out: Path) -> None:
    from rpaug.bench.sheets import PAGE

    for name, reason in skipped.items():
        console.print(f"[yellow]skipped[/] {name}: {_plain(reason)}", highlight=False)
    terminal = Console()
    # Both sides given: else a dumb terminal is taken for 80 columns, and figures are cut off.
    printer = Console(width=max(terminal.width, BENCH_WIDTH), height=terminal.height)
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
        for name in ("holes", "depth mm", "IoU", "across mm", "CPU s"):
            table.add_column(name, justify="right", no_wrap=True)
        for entry in found:
            if entry["factor"] == factor:
                figures = [f"{entry[name]:.{digits}f}" for name, digits in BENCH_DIGITS.items()]
                lead = "" if entry["lead"] is None else f"{entry['lead']:+.1f}"
                table.add_row(entry["method"], *figures[:2], lead, *figures[2:])
        printer.print(table)
    printer.print(f"sheets: {out / PAGE}", highlight=False, soft_wrap=True)


@app.command()
@_guarded
def doctor(as_json: AsJson = False) -> int:
    """Check what this machine can do: packages, operators, OpenGL, GPU, kernel cache.

    Example: [bold]rpaug doctor[/]
    """
    from dataclasses import asdict

    from rpaug.doctor import examine

    findings = examine()
    if as_json:
        _print_json([asdict(finding) for finding in findings])
    else:
        colour = {"ok": "green", "note": "yellow", "bad": "bold red"}
        for finding in findings:
            mark = f"[{colour[finding.level]}]{finding.level:4}[/]"
            Console().print(
                f"{mark} {finding.topic}: {_plain(finding.message)}",
                highlight=False,
                soft_wrap=True,
            )
    return 2 if any(finding.level == "bad" for finding in findings) else 0


def _episode(dataset: Path, key: str | None) -> Any:
    from rpaug import registry

    adapter = registry.adapter_for(dataset)
    keys = adapter.episodes(dataset)
    if key is not None and key not in keys:
        raise BadInput(dataset, "--episode", found=key, expected=f"one of: {', '.join(keys[:20])}")
    return adapter.read(dataset, key if key is not None else keys[0])


def _write_new(path: Path, data: bytes) -> None:
    from rpaug.files import write_atomic

    if path.exists():
        raise BadInput(
            path, "output", found="something there already", expected="a path that does not exist"
        )
    write_atomic(path, data)


if __name__ == "__main__":
    main()
