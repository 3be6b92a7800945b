"""`rpaug augment`: write edited copies of a dataset."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from rpaug.cli.console import (
    RESUME,
    Arms,
    AsJson,
    Dataset,
    DeviceChoice,
    Licence,
    OnDevice,
    UsedModels,
    console,
    counted,
    plain,
    print_json,
    say,
    warn,
    written,
)
from rpaug.cli.dry_run import print_plans
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError

# For numpy, whose matrices are small here, before it is loaded: a process of one thread may fork its workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class Engine(StrEnum):
    """What does the jobs of a run."""

    LOCAL = "local"
    RAY = "ray"


class Untouched(StrEnum):
    """How files that no edit reaches come into the output."""

    COPY = "copy"
    LINK = "link"


# Long: the options of a command are its signature.
def augment(
    dataset: Dataset,
    recipe: Annotated[
        str,
        typer.Option(help="Recipe file, or the name of one that ships (demo, light_color, ...)."),
    ],
    out: Annotated[
        str | None,
        typer.Option(
            help="Folder or URL to write; must not exist unless --resume. Not needed with --dry-run.",
            show_default=False,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Episodes at once; unset: 1, or the cluster's CPUs. Any number gives the same output.",
        ),
    ] = None,
    engine: Annotated[
        Engine, typer.Option(help="Where: on this machine, or on a Ray cluster (extra `cluster`).")
    ] = Engine.LOCAL,
    address: Annotated[
        str, typer.Option(help="Of the Ray cluster: `auto`, HOST:PORT, or `local` to start one.")
    ] = "auto",
    tier: Annotated[
        int,
        typer.Option(
            min=0, max=4, help="Least tier: 0 pixels, 1 surfels, 3 Gaussians, 4 also in time."
        ),
    ] = 0,
    scenes: Annotated[
        str | None,
        typer.Option(
            help="Store of fitted scenes, for tiers 3 and 4: `rpaug fit --out`, or a URL."
        ),
    ] = None,
    share: Annotated[
        bool, typer.Option(help="Episodes of one place share static Gaussians, through --scenes.")
    ] = False,
    device: OnDevice = DeviceChoice.AUTO,
    untouched: Annotated[
        Untouched,
        typer.Option(
            help="Files that no edit reaches: copies (clones where the file system has them), or hard links to the "
            "recorded ones, which take no room; who writes into one then writes into both."
        ),
    ] = Untouched.COPY,
    arm: Arms = None,
    models: UsedModels = None,
    ratio: Annotated[
        str | None,
        typer.Option(
            help="Recorded to synthetic episodes, as 1:3; keeps originals, instead of `copies`."
        ),
    ] = None,
    licence: Licence = None,
    shard: Annotated[
        str | None,
        typer.Option(
            help="Make one part of several, as 2/8; `rpaug merge` puts the parts together."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the recipe's.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: edits.0.color=red.")
    ] = None,
    resume: Annotated[bool, typer.Option(help="Go on with a run that was stopped.")] = False,
    keep_invalid: Annotated[
        bool,
        typer.Option(help="Keep copies in which physics made the recorded actions untrue."),
    ] = False,
    most_memory: Annotated[
        float | None,
        typer.Option(min=0.1, help="GB that a worker may take; unset: its share of the machine's."),
    ] = None,
    most_minutes: Annotated[
        float | None,
        typer.Option(min=0.01, help="Minutes for each copy of an episode; unset: 60."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option(help="Print the plan with time and disk, write nothing.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Write edited copies of a dataset's episodes, in the format they came in.

    Example: [bold]rpaug augment sample --recipe recipe.yaml --out augmented --workers 2[/]
    """
    from rpaug.core import devices, remote
    from rpaug.pipeline import cluster, inputs
    from rpaug.pipeline import workers as local
    from rpaug.pipeline.augment import Run, execute
    from rpaug.pipeline.run import MINUTES, Budget

    inputs.tier(tier)
    if out is None and (resume or not dry_run):
        raise RpaugError("--out: missing; expected a new folder or URL to write")
    if engine is Engine.RAY and (remote.is_url(out) or remote.is_copy(dataset)):
        raise RpaugError("--engine ray: nodes must see dataset and output as folders, not by URL")
    if share and scenes is None:
        raise RpaugError("--share: scenes are shared through a store; name its folder by --scenes")
    given = list(set_ or [])
    given += [f"seed={seed}"] if seed is not None else []
    given += [f"arms={json.dumps(list(map(str, arm)))}"] if arm else []
    loaded = inputs.recipe(recipe, given, models or ())
    budget = Budget(most_memory and most_memory * 1e9, most_minutes or MINUTES)
    how: dict[str, Any] = {
        "workers": workers or (1 if engine is Engine.LOCAL else 0),
        "budget": budget,
        "engine": local.run if engine is Engine.LOCAL else partial(cluster.run, address=address),
    }
    fitted = written(scenes, True) if scenes else nullcontext()
    with written(out, resume) if out else _nowhere() as target, fitted as store:
        run = Run(dataset, loaded, target, tier, store, share, keep_invalid, _ratio(ratio), licence)
        run = replace(run, shard=_shard(shard), device=devices.chosen(device.value).name)
        run = replace(run, linked=untouched is Untouched.LINK)
        if dry_run:
            return print_plans(run, resume, as_json)
        with progress_bar("augmenting", as_json) as progress:
            summary = execute(run, resume=resume, progress=progress, **how)
        code = summary.exit_code
        described = {**vars(summary), "out": out}
        if summary.copies and shard is None and not summary.stopped:
            code = max(code, contact_sheet(run, described))
        elif summary.failures or summary.aborted:
            described["error"] = summary.aborted or next(iter(summary.failures.values()))
    tell(run, summary, described, as_json)
    return code


@contextmanager
def _nowhere() -> Iterator[Path]:
    """A folder that is not there, for a run that writes nothing."""
    with TemporaryDirectory() as empty:
        yield Path(empty) / "out"


def tell(run: Any, summary: Any, described: dict[str, Any], as_json: bool) -> None:
    """Say what a run came to."""
    if as_json:
        print_json(described)
        return
    for words in summary.shortfalls:
        warn("not as asked", words)
    _print_summary(described, summary.lacked, run.adapter.after)


def _ratio(given: str | None) -> tuple[int, int] | None:
    """`1:3` in numbers. Raises RpaugError."""
    if given is None:
        return None
    parts = given.split(":")
    if len(parts) != 2 or not all(part.isdecimal() and 0 < int(part) <= 10_000 for part in parts):
        raise RpaugError(f"--ratio {given}: expected recorded:synthetic in whole numbers, as 1:3")
    return int(parts[0]), int(parts[1])


def _shard(given: str | None) -> tuple[int, int] | None:
    """`2/8` in numbers. Raises RpaugError."""
    if given is None:
        return None
    parts = given.split("/")
    if len(parts) != 2 or not all(part.isdecimal() and len(part) < 6 for part in parts):
        raise RpaugError(f"--shard {given}: expected which part of how many, as 2/8")
    which, of = map(int, parts)
    if not 1 <= which <= of:
        raise RpaugError(f"--shard {given}: expected a part from 1 to {of}")
    return which, of


def contact_sheet(run: Any, described: dict[str, Any]) -> int:
    """Write the sheet and say where it is; the episodes are done whether it can be or not."""
    from rpaug.pages import contact

    try:
        described["contact_sheet"] = str(contact.write(run.adapter, run.source, run.target))
    except (RpaugError, OSError) as error:
        described["contact_sheet"], described["contact_sheet_error"] = None, str(error)
        return 1
    return 0


def _print_summary(described: dict[str, Any], lacked: list[str], hint: str) -> None:
    """What a run came to, for people."""
    from rpaug.pipeline.run import alike

    for keys, reason in alike(described["failures"]):
        more = f" (and {counted(len(keys) - 1, 'other episode')} alike)" if keys[1:] else ""
        warn("skipped", f"{keys[0]}{more}: {reason}")
    for key, warnings in described["warnings"].items():
        for warning in warnings:
            warn("warning", f"{key}: {warning}")
    for words in described["roles"]:
        warn("roles differ", words)
    for words, copies in described["painted_over"].items():
        warn("painted over", f"{words} (in {copies} of {described['copies']} copies)")
    for words in lacked:
        warn("left out", words)
    if count := described["as_recorded"]:
        words = f"{count} of {counted(described['copies'], 'copy')}: all that was drawn for them was left out"
        warn("as recorded", words)
    for keys, reason in alike(described["rejected"]):
        more = f" (and {counted(len(keys) - 1, 'other copy')} alike)" if keys[1:] else ""
        warn("rejected", f"{keys[0]}{more}: {reason}")
    if described["aborted"]:
        again = "" if described["missing"] else f"; {RESUME}"
        console.print(
            f"[bold red]stopped[/] {plain(described['aborted'] + again)}",
            highlight=False,
            soft_wrap=True,
        )
    if not described["copies"]:
        return
    seconds = ", ".join(f"{stage} {value:.1f}" for stage, value in described["seconds"].items())
    say(f"{counted(described['copies'], 'episode')} in {described['out']} (seconds: {seconds})")
    if hint:
        say(hint)
    if described.get("contact_sheet"):
        say(f"contact sheet: {described['contact_sheet']}")
    elif "contact_sheet" in described:
        warn("no contact sheet", described["contact_sheet_error"])
