"""`rpaug init` and `rpaug new-recipe`: a first recipe for a dataset, and one that a person is asked for."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpaug.cli.console import AsJson, Dataset, EpisodeKey, print_json, say, write_new
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError

if TYPE_CHECKING:
    from rpaug.pipeline.starter import Offer, Tried

MOST_COPIES = 1_000_000
Out = Annotated[Path, typer.Option(help="New file to write the recipe to.")]


def init(
    dataset: Dataset,
    out: Out = Path("recipe.yaml"),
    episode: EpisodeKey = None,
    as_json: AsJson = False,
) -> int:
    """Write a first recipe for a dataset, with comments: what one of its episodes has something for.

    Example: [bold]rpaug init sample --out recipe.yaml[/]
    """
    from rpaug.pipeline import starter

    tried = _tried(dataset, episode, as_json)
    write_new(out, starter.text(tried, tried.offers).encode())
    _say_written(dataset, out, tried, as_json)
    return 0


def new_recipe(
    dataset: Dataset,
    out: Out = Path("recipe.yaml"),
    episode: EpisodeKey = None,
    as_json: AsJson = False,
) -> int:
    """Ask, edit by edit, for what one of a dataset's episodes has something for, and write the recipe.

    Example: [bold]rpaug new-recipe sample --out recipe.yaml[/]
    """
    from rpaug.pipeline import starter

    tried = _tried(dataset, episode, as_json)
    for fact in starter.facts(tried):
        typer.echo(fact, err=True)
    chosen = [wanted for one in tried.offers for wanted in _wanted(tried, one)]
    if all(one.reason for one in chosen):
        raise RpaugError(f"{out}: no edit is wanted, so no recipe was written")
    copies = int(_number("copies of each episode", 4, 1, MOST_COPIES, whole=True))
    write_new(out, starter.text(tried, chosen, copies, asked=True).encode())
    _say_written(dataset, out, tried, as_json)
    return 0


def _wanted(tried: "Tried", one: "Offer") -> "Iterator[Offer]":
    """The offer as a person wants it, and another for what only they can point out."""
    from rpaug.pipeline import starter

    if one.reason is None:
        yield _asked(one)
        return
    typer.echo(f"not here: {one.words}: {one.reason}", err=True)
    yield one
    known = dict(starter.pointed_out(tried)) if one.others else {}
    if not known:
        return
    for number, named in enumerate(known, 1):
        typer.echo(f"  {number}: {named}", err=True)
    asked = "which of these shall take other colors (0: none; `rpaug inspect --html` shows them)"
    if which := int(_number(asked, 0, 0, len(known), whole=True)):
        named, target = list(known.items())[which - 1]
        yield _asked(
            starter.offer(tried.episode, f"{named}: another color", starter.recolored(target))
        )


def _asked(one: "Offer") -> "Offer":
    from rpaug.pipeline import starter

    if one.reason is not None:
        typer.echo(f"not here: {one.words}: {one.reason}", err=True)
        return one
    asked = f"{one.words}: in which share of the copies, 0 to 1"
    return starter.often(one, _number(asked, starter.OFTEN, 0, 1))


def _number(asked: str, default: float, least: float, most: float, whole: bool = False) -> float:
    """What a person answers, asked again until it is a number in this range."""

    def read(answer: str) -> float:
        try:
            value = float(answer)
        except ValueError:
            value = math.nan
        if not least <= value <= most or (whole and value != int(value)):
            kind = "a whole number" if whole else "a number"
            raise typer.BadParameter(f"{answer!r} is not {kind} from {least:g} to {most:g}")
        return value

    return float(typer.prompt(asked, f"{default:g}", value_proc=read, err=True))


def _tried(dataset: Path, key: str | None, as_json: bool) -> "Tried":
    from rpaug.core import registry
    from rpaug.pipeline import inspect as inspection
    from rpaug.pipeline import starter
    from rpaug.scene.targets import settled

    found, keys = registry.read_among(dataset, key)
    with progress_bar("trying edits", as_json) as progress:
        edits = len(starter.CANDIDATES)
        progress(0, edits + 1)
        described = inspection.inspect(found, roles=settled.read(dataset))[0]
        return starter.tried(
            found, described, len(keys), lambda done: progress(1 + done, edits + 1)
        )


def _say_written(dataset: Path, out: Path, tried: "Tried", as_json: bool) -> None:
    from rpaug.core import registry

    key = tried.episode.key
    if as_json:
        print_json({"recipe": str(out), "episode": key})
        return
    name = "sample" if dataset == registry.SAMPLE else dataset
    say(f"{out}: a recipe for {key}; its comments say what can be edited")
    film = "film" in tried.described  # its gates take minutes, and a draw half a minute
    quick = " --quick --draws 1" if film else ""
    say(f"see it: rpaug preview {name} --recipe {out}{quick}")
    say(f"make it: rpaug augment {name} --recipe {out} --out augmented")
