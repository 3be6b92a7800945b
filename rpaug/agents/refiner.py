"""What is left to make consistent once all edits are known: which are carried by Gaussians, and who tunes those.

RoboPearls ends with a joint fine-tune, because each of its edits writes pixels or Gaussians of its own. Here an edit
changes one scene, stated once in its body's frame, from which all cameras are rendered: there is nothing to reconcile
between views. Only `stylize` optimises Gaussians, and it does so jointly over all views it is shown in, holding what
surrounds its target to the recording. So this stage optimises nothing; it says which edits do, and in which order.
"""

from typing import Any

from rpaug import registry
from rpaug.agents.messages import Entry


def refined(edits: tuple[Entry, ...], tier: int) -> dict[str, Any]:
    """Which edits need fitted Gaussians, which are shown by Gaussians at this tier, and what is tuned."""
    options = [one for edit in edits for one in edit.get("one_of", [edit])]
    fitted = [one["op"] for one in options if registry.operator(one["op"]).gaussians]
    return {
        "tuned_by_their_operator": fitted,
        "shown_by_gaussians": [one["op"] for one in options] if tier >= 3 else fitted,
        "tuned_jointly": [],
    }
