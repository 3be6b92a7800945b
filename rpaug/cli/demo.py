"""`rpaug demo`: the main job on the sample that ships."""

from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.augment import augment
from rpaug.cli.console import AsJson, say

OUT = "rpaug-demo"


def demo(
    out: Annotated[
        Path | None,
        typer.Option(help=f"New folder to write; {OUT} if not given.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Augment the sample that ships, as a look at what rpaug does: half a minute.

    Example: [bold]rpaug demo[/]
    """
    from rpaug.core import registry

    target = out or _free()
    if not as_json:
        say(f"$ rpaug augment sample --recipe demo --out {target}")
    code = augment(registry.SAMPLE, "demo", str(target), as_json=as_json)
    if not as_json:
        say("open that page in a browser; to try edits yourself: rpaug preview sample --serve")
    return code


def _free() -> Path:
    """The first of rpaug-demo, rpaug-demo-2, ... that is not there."""
    names = (OUT if number == 1 else f"{OUT}-{number}" for number in count(1))
    return next(path for path in map(Path, names) if not path.exists())
