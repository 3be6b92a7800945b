"""The command line: all commands in one list; the module of each is imported when it is invoked."""

import gc
from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from rpaug.cli.console import guarded
from rpaug.core.version import __version__

RARELY = (
    50_000  # new objects before cycles are sought: modules make as many, and images lie in none
)
COMMANDS = {
    "demo": (
        "demo",
        "Augment the sample that ships, as a look at what rpaug does: one to three minutes.",
    ),
    "augment": (
        "augment",
        "Write edited copies of a dataset's episodes, in the format they came in.",
    ),
    "merge": ("merge", "Put the parts of a run together that --shard made on several machines."),
    "ask": ("ask", "Turn a wish into a recipe, show it, and write or run it if asked to."),
    "diagnose": ("diagnose", "Say why rollouts failed, and write the recipe against it."),
    "loop": (
        "loop",
        "Train a policy, evaluate it, find out why it failed, augment against that, and train again.",
    ),
    "validate-recipe": ("recipes", "Check a recipe without touching any data."),
    "inspect": (
        "inspect",
        "Show cameras, frames, instruction and every instance: instance id, role, color, size, motion.",
    ),
    "preview": (
        "preview",
        "Show recorded and edited images side by side in the browser, before any copy is written.",
    ),
    "view": (
        "view",
        "Show an episode, a copy of it, or a store's fitted scene in space: what cameras see, where they stand.",
    ),
    "init": (
        "init",
        "Write a first recipe for a dataset, with comments: what one of its episodes has something for.",
    ),
    "new-recipe": (
        "init",
        "Ask, edit by edit, for what one of a dataset's episodes has something for, and write the recipe.",
    ),
    "fit": (
        "fit",
        "Fit Gaussians to an episode's static background and bodies, store them, and say how well they show it.",
    ),
    "calibrate": (
        "calibrate",
        "Say where fixed cameras stand, by the robot's own outline: no board. Exit code 1 if one cannot be told.",
    ),
    "verify": (
        "verify",
        "Compare an augmented dataset with its source: counts, kinds, actions bit for bit, untouched images, cameras\n"
        "that agree, splits, numbering, and what its readers trip over. Exit code 1 if something is wrong.",
    ),
    "audit": (
        "audit",
        "Compare every byte of an output with what was written, and show what was done to one episode. Exit code 1 if\n"
        "something differs.",
    ),
    "contact": (
        "contact",
        "Write a page of an output's episodes: recorded, edited, difference, and what was drawn.",
    ),
    "stats": (
        "stats",
        "Say how often each factor was drawn and between which values, and what images and robot states come to.",
    ),
    "convert": (
        "convert",
        "Write a dataset in another layout: images, depth, instance ids, words, cameras, robot, and a dataset card.",
    ),
    "reobserve": (
        "convert",
        "Write a simulator's dataset with depth, instance ids, cameras and roles, as the simulator sees its states.",
    ),
    "doctor": (
        "doctor",
        "Check what this machine can do: packages, operators, OpenGL, GPU, kernel cache.",
    ),
}
"""The module of each command, which is called as its function there, and the first paragraph of its help."""

GROUPS = {
    "assets": (
        "The library of things to insert.",
        {
            "ls": ("assets", "List the things that fit."),
            "add": ("assets", "Add a mesh, or Gaussians, to your library."),
            "generate": (
                "assets",
                "Have a model of yours make Gaussians of words or a picture, and add them to your library.",
            ),
            "show": ("assets", "Tell what is known of one thing, and draw it."),
        },
    ),
    "models": (
        "Detectors, segmenters and depth networks that recipes name.",
        {
            "pull": ("models", "Fetch a model of the Hugging Face Hub, its size and licence said."),
            "ls": ("models", "List the models on this machine that rpaug can use."),
            "check": ("models", "Load a model and see that all of its weights are its own."),
        },
    ),
    "twin": (
        "A simulated tabletop that knows the truth.",
        {
            "record": (
                "twin",
                "Record episodes of a simulated tabletop in RLBench's format, with the truth beside them.",
            )
        },
    ),
    "scenes": (
        "Fitted scenes in a store.",
        {
            "ls": (
                "scenes",
                "List the scenes of a store: key, Gaussians, bodies, decibels, megabytes.",
            ),
            "rm": (
                "scenes",
                "Take scenes out of a store, damaged ones too. Nothing is removed if one key is wrong.",
            ),
            "export": (
                "scenes",
                "Write a scene as a .ply in 3DGS layout or as an .spz, which SuperSplat and other viewers open.",
            ),
        },
    ),
    "bench": (
        "Speed and error on your own dataset.",
        {
            "tiers": (
                "bench",
                "Speed against error of every tier on one episode: each camera in turn is left out, and shown from the "
                "others.",
            ),
            "speed": (
                "bench",
                "Where a copy's time goes on one episode: what is done once, what its files cost, and what each edit "
                "adds.",
            ),
        },
    ),
    "cache": (
        "What was worked out once and is kept.",
        {
            "ls": (
                "cache",
                "List what the cache holds: kind, name, megabytes, days since it was used.",
            ),
            "rm": (
                "cache",
                "Take things out of the cache; they are worked out anew when they are needed.",
            ),
        },
    ),
}


class _Unloaded(TyperCommand):
    """A command in its group's list. Its callback gives the function, once the command is invoked."""

    def make_context(self, info_name: str | None, args: list[str], *rest: Any, **extra: Any) -> Any:
        assert self.callback is not None
        loaded = _typer(add_completion=False)
        loaded.command(self.name)(self.callback())
        return typer.main.get_command(loaded).make_context(info_name, args, *rest, **extra)


def _typer(**settings: Any) -> typer.Typer:
    return typer.Typer(
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        no_args_is_help=True,
        **settings,
    )


def _loading(module: str, function: str) -> Callable[[], Callable[..., None]]:
    def load() -> Callable[..., None]:
        return guarded(getattr(import_module(f"rpaug.cli.{module}"), function))

    return load


def _listed(group: typer.Typer, commands: dict[str, tuple[str, str]]) -> None:
    for name, (module, words) in commands.items():
        load = _loading(module, name.replace("-", "_"))
        group.command(name, cls=_Unloaded, help=words)(load)


app = _typer(name="rpaug")


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"rpaug {__version__}")
        raise typer.Exit


@app.callback()
def _everything(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out."""


_listed(app, COMMANDS)
for _name, (_help, _commands) in GROUPS.items():
    _group = _typer(help=_help, add_completion=False)
    _listed(_group, _commands)
    app.add_typer(_group, name=_name)


def main() -> None:
    """Entry point of the `rpaug` command."""
    gc.set_threshold(RARELY)
    app(prog_name="rpaug")
