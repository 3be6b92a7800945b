"""What users name in several ways, taken alike on the command line, in training and in Python: recipes and tiers."""

import copy
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput, BadRecipe, RpaugError, Unsupported
from rpaug.core.interfaces import Adapter
from rpaug.core.types import Episode
from rpaug.physics.materials import FILE
from rpaug.pipeline import recipe as recipes
from rpaug.pipeline.recipe import Recipe
from rpaug.pipeline.recipe_yaml import override

RecipeLike = Recipe | Mapping[str, Any] | Path | str
"""A recipe, its plain data, its file, or the name of a shipped one."""

TIERS = (0, 1, 3, 4)


def recipe(given: RecipeLike, overrides: Sequence[str] = (), models: Sequence[str] = ()) -> Recipe:
    """The recipe that was meant, with `a.b=c` overrides applied, and with `models` as `--models` has them and the
    user's file names them. Raises BadInput, BadRecipe, RpaugError."""
    return _recipe(given, overrides).with_models(models)


def _recipe(given: RecipeLike, overrides: Sequence[str]) -> Recipe:
    if isinstance(given, Path | str):
        return recipes.load(_file(given), overrides)
    if isinstance(given, Recipe) and not overrides:
        return given
    tree = given.source if isinstance(given, Recipe) else given
    if not isinstance(tree, Mapping):
        raise BadRecipe(f"recipe: found {tree!r:.80}; expected a Recipe, a dict, a file or a name")
    tree = copy.deepcopy(dict(tree))
    try:
        json.dumps(tree)
    except (TypeError, ValueError) as error:
        raise BadRecipe(f"recipe: {error}; expected values as YAML has them") from None
    for one in overrides:
        override(tree, one)
    return recipes.build(tree)


def _file(given: Path | str) -> Path:
    """The file of a recipe, or of the shipped one of that name. Raises BadInput."""
    import rpaug_recipes

    path, folder = Path(given), Path(rpaug_recipes.__file__).parent.resolve()
    if path.is_file():
        return path
    shipped = (folder / f"{given}.yaml").resolve()
    if shipped.is_relative_to(folder) and shipped.is_file():
        return shipped
    expected = f"a recipe file or one of: {', '.join(_names(folder))}"
    raise BadInput(given, "recipe", found="no such file", expected=expected)


def _names(folder: Path) -> list[str]:
    return sorted(
        path.relative_to(folder).with_suffix("").as_posix()
        for path in folder.rglob("*.yaml")
        if "tasks" not in path.parts and path.name != FILE
    )


def tier(given: int) -> int:
    """The least tier that was asked for. Raises Unsupported."""
    if given not in TIERS:
        raise Unsupported(
            f"tier {given!r}: expected 0, 1, 3 or 4; assets, which are tier 2, enter at any tier"
        )
    return given


def see_handles_hold(recipe: Recipe, adapter: Adapter, source: Path, keys: Sequence[str]) -> None:
    """That neither edits nor settled roles name a thing by its handle in several episodes without recorded masks: what
    is found there is numbered anew in each, so the same handle is another thing. Raises Unsupported."""
    named = [part for part in ("edits", "roles") if _by_handle(recipe.source.get(part))]
    if len(keys) < 2 or not named:
        return
    try:
        first = adapter.read(source, keys[0])
    except RpaugError:  # said when it is its turn
        return
    if not handles_hold(first, len(keys)):
        raise Unsupported(
            f"{' and '.join(named)}: found a handle, and {len(keys)} episodes without recorded masks; "
            "expected a role or words: handles are given anew in each of them, so one names a thing in one episode "
            f"(select: {{episodes: [{keys[0]}]}})"
        )


def handles_hold(first: Episode, episodes: int) -> bool:
    """Whether a handle names the same thing in all of so many episodes, `first` among them."""
    return episodes < 2 or any(view.ids is not None for view in first.views.values())


def _by_handle(value: Any) -> bool:
    if isinstance(value, Mapping):
        return "handle" in value or any(map(_by_handle, value.values()))
    return isinstance(value, list) and any(map(_by_handle, value))
