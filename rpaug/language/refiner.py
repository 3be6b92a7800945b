"""What is left to make consistent once all edits are known: which Gaussians are tuned together, and against what.

As in RoboPearls (arXiv 2506.22756) a joint fine-tune of all edited Gaussians comes last: `rpaug.compose.joint`.
There is something to tune only where Gaussians show what was edited, at tier 3; recorded pixels and surfels show an
edit as it is. So this stage asks for the fine-tune in the recipe, by its key `refine`, and says of which edits.
"""

from collections.abc import Mapping
from typing import Any

from rpaug.core import registry
from rpaug.core.types import Effect
from rpaug.language import declared
from rpaug.language.messages import Entry

STEPS = 200
TIER = 3


def refined(
    edits: tuple[Entry, ...], settings: Mapping[str, Any], tier: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The recipe's settings, with the fine-tune where the least tier calls for it, and what was decided."""
    options = [one for edit in edits for one in edit.get("one_of", [edit])]
    own = [one["op"] for one in options if registry.operator(one["op"]).needs.gaussians]
    together = [one["op"] for one in options if tier >= TIER and _of_things(one)]
    settings = dict(settings)
    if together:
        settings.setdefault("refine", STEPS)
    return settings, {
        "tuned_by_their_operator": own,
        "tuned_jointly": together,
        "steps": settings.get("refine", 0),
    }


def _of_things(edit: Entry) -> bool:
    """Does it change how recorded things look, or where they are?"""
    named = declared.targets(edit) or declared.own_role(edit["op"])
    effect = registry.operator(edit["op"]).effect
    return bool(named and effect & (Effect.RGB | Effect.BODIES))
