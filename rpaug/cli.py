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
                "stopped; what was finished is whole (--resume goes on)",
                kwargs.get("as_json", False),
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
    from rpaug import augment as whole
    from rpaug import contact, registry

    loaded = _recipe(recipe, [*(set_ or []), *([f"seed={seed}"] if seed is not None else [])])
    if dry_run:
        return _dry_run(dataset, loaded, tier, as_json)
    with _progress("augmenting", as_json) as progress:
        summary = whole.run(
            dataset,
            loaded,
            out,
            workers=workers,
            tier=tier,
            scenes=scenes,
            resume=resume,
            progress=progress,
        )
    described = {**vars(summary), "out": str(out)}
    if summary.copies + summary.resumed:
        described["contact_sheet"] = str(contact.write(registry.adapter_for(out), dataset, out))
    if as_json:
        _print_json(described)
    else:
        _print_summary(described)
    return summary.exit_code


def _recipe(name: str, overrides: list[str]) -> Any:
    from rpaug import recipe

    path = Path(name)
    if not path.is_file():
        import rpaug_recipes

        shipped = Path(rpaug_recipes.__file__).parent / f"{name}.yaml"
        if not shipped.is_file() or not shipped.resolve().is_relative_to(
            Path(rpaug_recipes.__file__).parent
        ):
            folder = Path(rpaug_recipes.__file__).parent
            known = sorted(
                path.relative_to(folder).with_suffix("").as_posix()
                for path in folder.rglob("*.yaml")
                if "tasks" not in path.parts
            )
            raise BadInput(
                name,
                "--recipe",
                found="no such file",
                expected=f"a recipe file or one of: {', '.join(known)}",
            )
        path = shipped
    return recipe.load(path, overrides)


def _dry_run(dataset: Path, loaded: Any, tier: int, as_json: bool) -> int:
    from rpaug import pipeline, plan, registry

    adapter = registry.adapter_for(dataset)
    keys = loaded.select(adapter.episodes(dataset))
    plans, total, failed = [], {"seconds": 0.0, "megabytes": 0.0}, {}
    for key in keys:
        try:
            episode = adapter.read(dataset, key)
        except RpaugError as error:
            failed[key] = str(error)
            continue
        made = plan.make(pipeline.operators(loaded), episode, tier)
        cost = made.cost(episode, loaded.copies)
        total = {name: round(total[name] + cost[name], 1) for name in total}
        plans.append(
            {"episode": key, "frames": episode.length, **made.describe(), "estimate": cost}
        )
    described = {"copies": loaded.copies, "plans": plans, "unreadable": failed, "estimate": total}
    if as_json:
        _print_json(described)
    else:
        table = Table("episode", "frames", "carriers", "bodies", "about")
        for one in plans:
            carriers = ", ".join(sorted(set(one["carriers"].values())))
            about = f"{one['estimate']['seconds']} s, {one['estimate']['megabytes']} MB"
            table.add_row(
                one["episode"],
                str(one["frames"]),
                carriers,
                "tracked" if one["bodies"] else "-",
                about,
            )
        Console().print(table)
        for key, reason in failed.items():
            console.print(f"[yellow]would skip[/] {_plain(key)}: {_plain(reason)}", highlight=False)
        Console().print(
            f"{len(plans) * loaded.copies} copies, about {total['seconds']} s on one core and "
            f"{total['megabytes']} MB. Nothing was written."
        )
    return 2 if not plans else 1 if failed else 0


def _print_summary(described: dict[str, Any]) -> None:
    for key, reason in described["failures"].items():
        console.print(
            f"[yellow]skipped[/] {_plain(key)}: {_plain(reason)}", highlight=False, soft_wrap=True
        )
    if described["aborted"]:
        console.print(
            f"[bold red]stopped[/] {_plain(described['aborted'])}", highlight=False, soft_wrap=True
        )
    out = Console()
    done = described["copies"] + described["resumed"]
    if not done:
        return
    seconds = ", ".join(f"{stage} {value:.1f}" for stage, value in described["seconds"].items())
    out.print(
        f"{done} episodes in {described['out']} (seconds: {seconds})",
        highlight=False,
        soft_wrap=True,
    )
    out.print("If RVT trained on this path before, delete its replay folder: it would be reused.")
    out.print(f"contact sheet: {described['contact_sheet']}", highlight=False, soft_wrap=True)


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
    out = Console()
    out.print(
        f"[bold]{_plain(described['episode'])}[/]: “{_plain(described['instruction'])}”, {found.length} frames"
    )
    out.print(f"key frames: {', '.join(map(str, described['key_frames'])) or 'none'}")
    for name, camera in described["cameras"].items():
        kind = "fixed" if camera["fixed"] else "moving"
        out.print(
            f"  {name}: {camera['width']}x{camera['height']}, {kind}, {', '.join(camera['images'])}",
            highlight=False,
        )
    table = Table(
        "handle", "role", "colour", "size, cm", "motion", "residual, mm", "frames", "body"
    )
    for row in rows:
        motion = f"{row.motion} (ambiguous)" if row.ambiguous else row.motion
        size = " x ".join(f"{side:.1f}" for side in row.size_cm)
        body = ", ".join(map(str, sorted(row.body))) if len(row.body) > 1 else ""
        table.add_row(
            str(row.handle),
            row.role,
            row.colour_name,
            size,
            motion,
            f"{row.residual_mm:.2f}",
            str(row.frames),
            body,
        )
    out.print(table)
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
        str, typer.Option(help="open_drawer or one of the other tasks; a wrong name lists them.")
    ] = "open_drawer",
    seed: Annotated[int, typer.Option(min=0)] = 0,
    factor: Annotated[
        str | None, typer.Option(help="Truly change object_color, light_color or camera_pose.")
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
        task, seed, out, factor=factor, look=look, size=size, frames=frames, episodes=episodes
    )
    written = [str(out / take.episode.key) for take in takes]
    if as_json:
        _print_json({"episodes": written, "truth": [take.truth.describe() for take in takes]})
    else:
        for path in written:
            Console().print(path, highlight=False, soft_wrap=True)
    return 0


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
