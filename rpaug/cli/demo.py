"""`rpaug demo`: the main job on the sample that ships."""

from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.augment import augment
from rpaug.cli.console import AsJson, say
from rpaug.cli.preview import preview

OUT = "rpaug-demo"
RECIPE = "demo"


def demo(
    out: Annotated[
        Path | None,
        typer.Option(help=f"New folder to write; {OUT} if not given.", show_default=False),
    ] = None,
    open_: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the preview in the browser.")
    ] = True,
    as_json: AsJson = False,
) -> int:
    """Augment the sample that ships, as a look at what rpaug does: one to three minutes.

    Ends by opening a preview of the same edits where somebody sits at a screen.

    Example: [bold]rpaug demo[/]
    """
    from rpaug.core import registry

    target = out or _free()
    if as_json:
        return augment(registry.SAMPLE, RECIPE, str(target), as_json=True)
    say(f"$ rpaug augment sample --recipe {RECIPE} --out {target}")
    code = augment(registry.SAMPLE, RECIPE, str(target))
    page = target.with_name(f"{target.name}-preview.html")
    say(f"$ rpaug preview sample --recipe {RECIPE} --out {page}")
    return max(code, preview(registry.SAMPLE, RECIPE, page, open_=open_))


def _free() -> Path:
    """The first of rpaug-demo, rpaug-demo-2, ... that is not there."""
    names = (OUT if number == 1 else f"{OUT}-{number}" for number in count(1))
    return next(path for path in map(Path, names) if not path.exists())
