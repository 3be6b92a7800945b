"""What each kind of model is good for in a recipe's `models`, and whether one is whole."""

from dataclasses import dataclass

from rpaug.providers import depth, detect, hub, segment
from rpaug.providers.models import load

USES = {"text": detect.KINDS, "instances": segment.KINDS, "depth": depth.KINDS}


@dataclass(frozen=True)
class Checked:
    """A model that was loaded whole: its kind, its number of parameters, and its uses."""

    model_type: str
    parameters: int
    uses: tuple[str, ...]


def uses(model_type: str) -> tuple[str, ...]:
    """What of `models` a kind of model can be; empty for one that rpaug does not use."""
    return tuple(use for use, kinds in USES.items() if model_type in kinds)


def types() -> str:
    """All kinds by their use."""
    return "; ".join(f"{use}: {', '.join(sorted(kinds))}" for use, kinds in USES.items())


def check(name: str) -> Checked:
    """Load a model for each of its uses. Raises Unsupported where it is none, or not whole; MissingExtra."""
    kind = str(hub.config(hub.folder(name)).get("model_type", ""))
    found = uses(kind)
    every = {known: made for kinds in USES.values() for known, made in kinds.items()}
    count = 0
    for use in found:
        loaded = load(name, USES[use], f"models: {use}")
        count = max(count, sum(one.numel() for one in loaded.model.parameters()))
    if not found:
        load(name, every, "models")  # raises, and says what is taken
    return Checked(kind, count, found)
