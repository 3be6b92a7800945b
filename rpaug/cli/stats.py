"""`rpaug stats`: what a run made of a dataset, in numbers."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, counted, print_json, say
from rpaug.cli.progress import progress_bar

SHOWN = 12  # columns of a robot's state


def stats(
    out: Annotated[Path, typer.Argument(help="The --out of a run.")],
    against: Annotated[
        Path | None, typer.Option(help="The recorded dataset: its numbers stand beside.")
    ] = None,
    episodes: Annotated[
        int, typer.Option(min=1, help="How many to read images and states of, evenly spread.")
    ] = 20,
    as_json: AsJson = False,
) -> int:
    """Say how often each factor was drawn and between which values, and what images and robot states come to.

    Factors are of all copies, images and states of some episodes.

    Example: [bold]rpaug stats augmented --against data[/]
    """
    from rpaug.pipeline.statistics import Data, statistics

    with progress_bar("reading", as_json) as progress:
        found = statistics(out, against, episodes, progress)
    if as_json:
        print_json(asdict(found))
        return 0
    say(f"edited copies: {found.copies}")
    for name, factor in found.factors.items():
        left = f", left out of {factor.left_out} more" if factor.left_out else ""
        say(f"{name}: in {factor.drawn} of them{left}")
        for key, (low, mean, high) in factor.numbers.items():
            say(f"  {key}: {low:.3g} to {high:.3g}, mean {mean:.3g}")
        for key, words in factor.words.items():
            say(f"  {key}: {', '.join(f'{word} {count}' for word, count in words.items())}")

    def shown(title: str, data: Data) -> None:
        say(f"{title}, {counted(data.episodes, 'episode')}: mean (standard deviation)")
        for kind in ("images", "depth", "robot"):
            for name, (means, spreads) in getattr(data, kind).items():
                each = [f"{m:.3g} ({s:.3g})" for m, s in zip(means, spreads, strict=True)]
                more = f" and {len(each) - SHOWN} more" if len(each) > SHOWN else ""
                say(f"  {kind} {name}: {', '.join(each[:SHOWN])}{more}")

    if found.recorded is not None:
        shown("recorded", found.recorded)
    shown("written", found.written)
    return 0
