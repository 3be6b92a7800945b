"""The command line: all commands in one list, one file for each group of them."""

from collections.abc import Callable

import typer

from rpaug.cli import (
    ask,
    assets,
    augment,
    bench,
    cache,
    convert,
    diagnose,
    doctor,
    fit,
    inspect,
    loop,
    recipes,
    scenes,
    twin,
    verify,
)
from rpaug.cli.console import guarded

app = typer.Typer(
    name="rpaug",
    help="Multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
COMMANDS: dict[str, Callable[..., int]] = {
    "augment": augment.augment,
    "ask": ask.ask,
    "diagnose": diagnose.diagnose,
    "loop": loop.loop,
    "validate-recipe": recipes.validate_recipe,
    "inspect": inspect.inspect,
    "fit": fit.fit,
    "verify": verify.verify,
    "convert": convert.convert,
    "bench": bench.bench,
    "doctor": doctor.doctor,
}
GROUPS: dict[str, tuple[str, dict[str, Callable[..., int]]]] = {
    "assets": (
        "The library of things to insert.",
        {"ls": assets.ls, "add": assets.add, "generate": assets.generate, "show": assets.show},
    ),
    "twin": ("A simulated tabletop that knows the truth.", {"record": twin.record}),
    "scenes": (
        "Fitted scenes in a store.",
        {"ls": scenes.ls, "rm": scenes.rm, "export": scenes.export},
    ),
    "cache": ("What was worked out once and is kept.", {"ls": cache.ls, "rm": cache.rm}),
}
for _name, _command in COMMANDS.items():
    app.command(_name)(guarded(_command))
for _name, (_help, _commands) in GROUPS.items():
    _group = typer.Typer(help=_help, no_args_is_help=True)
    for _inner, _command in _commands.items():
        _group.command(_inner)(guarded(_command))
    app.add_typer(_group, name=_name)


def main() -> None:
    """Entry point of the `rpaug` command."""
    app()
