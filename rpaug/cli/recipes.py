"""`rpaug validate-recipe`: check a recipe without any data."""

from typing import Annotated

import typer

from rpaug.cli.console import AsJson, print_json, say
from rpaug.core.errors import RpaugError


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
    from rpaug.pipeline import inputs
    from rpaug.pipeline import recipe as recipes

    if schema:
        print_json(recipes.schema())
        return 0
    if recipe is None:
        raise RpaugError("name a recipe, or --schema")
    loaded = inputs.recipe(recipe, set_ or [])
    if as_json:
        print_json({"valid": True, "recipe": loaded.source})
    else:
        names = [" or ".join(option.name for option in step.options) for step in loaded.steps]
        say(f"valid: {', '.join(names) or 'no edits'}; {loaded.copies} copies, seed {loaded.seed}")
    return 0
