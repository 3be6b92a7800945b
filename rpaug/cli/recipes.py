"""`rpaug validate-recipe`, and how a recipe is named on the command line."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rpaug.cli.console import AsJson, print_json, say
from rpaug.core.errors import BadInput, RpaugError


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
    from rpaug.pipeline import recipe as recipes

    if schema:
        print_json(recipes.schema())
        return 0
    if recipe is None:
        raise RpaugError("name a recipe, or --schema")
    loaded = load_recipe(recipe, set_ or [])
    if as_json:
        print_json({"valid": True, "recipe": loaded.source})
    else:
        names = [" or ".join(option.name for option in step.options) for step in loaded.steps]
        say(f"valid: {', '.join(names) or 'no edits'}; {loaded.copies} copies, seed {loaded.seed}")
    return 0


def load_recipe(name: str, overrides: list[str]) -> Any:
    from rpaug.pipeline import recipe

    path = Path(name)
    if not path.is_file():
        import rpaug_recipes

        from rpaug.physics.materials import FILE

        folder = Path(rpaug_recipes.__file__).parent
        shipped = folder / f"{name}.yaml"
        if not shipped.resolve().is_relative_to(folder.resolve()) or not shipped.is_file():
            known = sorted(
                p.relative_to(folder).with_suffix("").as_posix()
                for p in folder.rglob("*.yaml")
                if "tasks" not in p.parts and p.name != FILE
            )
            raise BadInput(
                name,
                "--recipe",
                found="no such file",
                expected=f"a recipe file or one of: {', '.join(known)}",
            )
        path = shipped
    return recipe.load(path, overrides)
