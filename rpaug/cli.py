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
            dataset, loaded, out, workers=workers, tier=tier, resume=resume, progress=progress
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
            known = sorted(p.stem for p in shipped.parent.glob("*.yaml"))
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


if __name__ == "__main__":
    main()
