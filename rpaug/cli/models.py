"""`rpaug models`: the detectors, segmenters and depth networks that recipes name."""

from dataclasses import dataclass
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, counted, print_json, say
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError

Name = Annotated[
    str, typer.Argument(help="An id of the Hugging Face Hub (owner/name), or a local folder.")
]


def pull(
    name: Name,
    yes: Annotated[bool, typer.Option("--yes", help="Fetch without asking first.")] = False,
    as_json: AsJson = False,
) -> int:
    """Fetch a model of the Hugging Face Hub, its size and licence said.

    Only safetensors and text are fetched, into the hub's own cache (HF_HOME); nothing of it is run.

    Example: [bold]rpaug models pull IDEA-Research/grounding-dino-tiny[/]
    """
    from rpaug.providers import hub

    known = hub.told(name)
    uses = _uses(known.model_type)
    if known.model_type and not uses:
        raise RpaugError(
            f"{name}: model_type {known.model_type!r}, which rpaug does not use; it uses {_types()}"
        )
    if not as_json:
        licence = known.licence or "the hub states none"
        use = ", ".join(uses) or "unknown"
        say(f"{name}: {known.bytes / 1e6:.0f} MB, licence: {licence}, for models: {use}")
        if not yes and not typer.confirm("fetch it?", default=True):
            say("nothing fetched")
            return 1
    with progress_bar("fetching", as_json):
        found = hub.pull(name)
    if as_json:
        print_json(_described(found))
    else:
        say(f"fetched to {found.folder}")
    return 0


def ls(as_json: AsJson = False) -> int:
    """List the models on this machine that rpaug can use.

    Those of the hub's cache, by what their own config.json says. Example: [bold]rpaug models ls[/]
    """
    from rpaug.providers import hub

    found = [one for one in hub.pulled() if _uses(one.model_type)]
    if as_json:
        print_json({"models": [*map(_described, found)]})
        return 0
    for one in found:
        uses = ", ".join(_uses(one.model_type))
        say(f"{one.name:48} {one.model_type:22} {one.bytes / 1e6:9.1f} MB  {uses}")
    say(f"{counted(len(found), 'model')}; rpaug models pull NAME fetches one")
    return 0


def check(name: Name, as_json: AsJson = False) -> int:
    """Load a model and see that all of its weights are its own.

    A network that lacks weights, or was given those of another, answers at random and is sure of it: exit code 2 then.

    Example: [bold]rpaug models check IDEA-Research/grounding-dino-tiny[/]
    """
    with progress_bar("loading", as_json):
        checked = _checked(name)
    if as_json:
        print_json({"name": name, **vars(checked)})
    else:
        say(
            f"{name}: {checked.model_type}, {checked.parameters / 1e6:.1f} million parameters, every weight its own; "
            f"for models: {', '.join(checked.uses)}"
        )
    return 0


def _described(known: "object") -> dict[str, object]:
    facts = dict(vars(known))
    folder = facts.pop("folder")
    kind = str(facts["model_type"])
    return facts | {"folder": folder and str(folder), "uses": list(_uses(kind))}


def _kinds() -> dict[str, dict[str, str]]:
    """By what a recipe's `models` uses them for: each model_type, and the class that loads it."""
    from rpaug.providers import depth, detect, segment

    return {"text": detect.KINDS, "instances": segment.KINDS, "depth": depth.KINDS}


def _uses(model_type: str) -> list[str]:
    """What a kind of model can be used for; none for one that rpaug does not use."""
    return [use for use, kinds in _kinds().items() if model_type in kinds]


def _types() -> str:
    """All kinds by their use."""
    return "; ".join(f"{use}: {', '.join(sorted(kinds))}" for use, kinds in _kinds().items())


@dataclass(frozen=True)
class CheckedModel:
    """A model that was loaded whole: its kind, its number of parameters, and its uses."""

    model_type: str
    parameters: int
    uses: list[str]


def _checked(name: str) -> CheckedModel:
    """Load a model for each of its uses. Raises Unsupported where it is none, or not whole; MissingExtra."""
    from rpaug.providers import hub, models

    kind = str(hub.config(hub.folder(name)).get("model_type", ""))
    found, count = _uses(kind), 0
    for use in found:
        loaded = models.load(name, _kinds()[use], f"models: {use}")
        count = max(count, sum(one.numel() for one in loaded.model.parameters()))
    if not found:
        every = {known: made for kinds in _kinds().values() for known, made in kinds.items()}
        models.load(name, every, "models")  # raises, and says what is taken
    return CheckedModel(kind, count, found)
