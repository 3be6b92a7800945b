"""`rpaug ask`: a wish in words becomes a recipe."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    KeyVariable,
    Llm,
    ModelName,
    Patience,
    Price,
    console,
    plain,
    print_json,
    say,
    write_new,
)
from rpaug.core.errors import BadInput, RpaugError

SHORT = "Without a model short commands are understood; one understands free wording: --llm URL --model NAME.\n"


# Long: the options of a command are its signature.
def ask(
    dataset: Dataset,
    wish: Annotated[str, typer.Argument(help="What to change, in English.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="Write the recipe here; must not exist.")] = None,
    run: Annotated[
        bool, typer.Option("--run", help="Show the recipe, then augment with it.")
    ] = False,
    into: Annotated[
        Path | None, typer.Option(help="Folder that --run writes; must not exist.")
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(
            help="File of the talk so far: wishes may go on from it. Written by each round."
        ),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Write every stage's input, prompt and output here.")
    ] = None,
    episode: Annotated[
        str | None,
        typer.Option(help="Episode in which targets are looked for; the first if not given."),
    ] = None,
    ground: Annotated[
        bool, typer.Option(help="Look for every target in a recorded scene before answering.")
    ] = True,
    llm: Llm = None,
    model: ModelName = None,
    key_env: KeyVariable = "RPAUG_LLM_KEY",
    timeout: Patience = 60.0,
    price: Price = None,
    one_call: Annotated[
        bool,
        typer.Option(help="Ask the model once, or have it split the wish and ask for each step."),
    ] = True,
    picture: Annotated[
        bool, typer.Option("--picture", help="Show the model a view with numbered instances.")
    ] = False,
    tier: Annotated[
        int,
        typer.Option(min=0, max=4, help="Least tier of --run; from 3 edited Gaussians are tuned."),
    ] = 0,
    generator: Annotated[
        str | None,
        typer.Option(
            help="Who makes what the library lacks: a command, {text} and {out} put in, or an HTTP address."
        ),
    ] = None,
    generator_scale: Annotated[
        float, typer.Option(min=1e-6, help="Metres to one unit of what is made.")
    ] = 1.0,
    generator_up: Annotated[str, typer.Option(help="Its upward axis: y or z.")] = "z",
    as_json: AsJson = False,
) -> int:
    """Turn a wish into a recipe, show it, and write or run it if asked to.

    What is not understood is said, and then nothing is written (exit code 1).

    Example: [bold]rpaug ask data/open_drawer "make the drawer blue, put two mugs near it" --out blue.yaml[/]
    """
    from rpaug.core import registry
    from rpaug.core.errors import TargetError, Unsupported
    from rpaug.core.types import Scene
    from rpaug.language import asking, rounds
    from rpaug.language.messages import NotUnderstood
    from rpaug.providers import llm_settings
    from rpaug.scene.build import build
    from rpaug.scene.targets import settled

    llm_settings.refuse_keys(wish, (key_env, llm_settings.KEY))
    if picture and not ground:
        raise RpaugError("--picture shows recorded instances: leave out --no-ground")
    if run and into is None:
        raise RpaugError("--run needs --into: the folder to write")
    for path, flag in ((out, "--out"), (log, "--log"), (into, "--into")):
        if path is not None and path.exists():
            raise BadInput(path, flag, found="something there already", expected="a new path")
    recorded = registry.read(dataset, episode)
    talk = rounds.load(history) if history else rounds.History()

    def scene() -> Scene:
        return settled.settle(build(recorded, with_bodies=True), settled.read(dataset))[0]

    endpoint = _endpoint(llm, model, key_env, timeout, price, not one_call, picture)
    understanding = endpoint or rounds.next_round
    try:
        asked = asking.ask(
            wish,
            asking.setting_of(recorded),
            scene if ground else None,
            history=talk,
            understanding=understanding,
            tier=tier,
            maker=_maker(generator, generator_scale, generator_up),
        )
    except (NotUnderstood, TargetError, Unsupported) as error:
        return _refused(asking.reason(error), endpoint, as_json)
    _write(asked, out, history, log)
    _show(asked, endpoint, as_json and not run)
    if not run:
        return 0
    from rpaug.cli.augment import augment

    return augment(dataset, _kept(asked, out, into), str(into), tier=tier, as_json=as_json)


def _maker(who: str | None, scale: float, up: str) -> Any:
    from rpaug.language.making import Maker

    if up not in ("y", "z"):
        raise RpaugError(f"--generator-up {up}: give y or z")
    return None if who is None else Maker(who, scale, up)


def _endpoint(
    url: str | None,
    model: str | None,
    key_env: str,
    timeout: float,
    price: Price,
    staged: bool,
    pictures: bool,
) -> Any:
    from rpaug.language.talk import WishModel
    from rpaug.providers import llm_settings

    found = llm_settings.endpoint(url, model, key_env=key_env, timeout=timeout, price=price)
    return None if found is None else WishModel(found, staged=staged, pictures=pictures)


def _refused(reason: str, endpoint: Any, as_json: bool) -> int:
    if as_json:
        used = {"usage": endpoint.usage} if endpoint else {}
        print_json({"understood": False, "reason": reason, **used})
    else:
        console.print(
            f"[yellow]not understood[/] {plain(reason)}\n{'' if endpoint else SHORT}Nothing was written.",
            highlight=False,
            soft_wrap=True,
        )
    return 1


def _write(asked: Any, out: Path | None, history: Path | None, log: Path | None) -> None:
    from rpaug.core.files import write_atomic

    if out is not None:
        write_new(out, asked.yaml.encode())
    if log is not None:
        write_new(log, asked.log.encode())
    if history is not None:
        write_atomic(history, asked.history.model_dump_json(indent=1).encode() + b"\n")


def _show(asked: Any, endpoint: Any, as_json: bool) -> None:
    used = {"usage": endpoint.usage} if endpoint else {}
    if as_json:
        described = {"understood": True, "recipe": asked.recipe, "notes": list(asked.notes)}
        print_json(described | {"stages": [one.model_dump() for one in asked.trace]} | used)
        return
    say(asked.yaml.rstrip())
    for name, value in used.get("usage", {}).items():
        console.print(f"{name}: {value}", highlight=False)


def _kept(asked: Any, out: Path | None, into: Path | None) -> str:
    """The file to augment from: the one that was written, or one beside the output."""
    if out is not None:
        return str(out)
    assert into is not None
    path = into.parent / f"{into.name}.recipe.yaml"
    write_new(path, asked.yaml.encode())
    return str(path)
