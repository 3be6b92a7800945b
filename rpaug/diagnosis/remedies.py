"""From causes to edits: each remedy in words goes through `ask`, draws from what was measured, and is as likely as the
failures it is against."""

from collections.abc import Sequence
from typing import Any

from rpaug.core.errors import RpaugError
from rpaug.diagnosis import ranges
from rpaug.diagnosis.messages import Cause, Factor
from rpaug.diagnosis.reference import Reference
from rpaug.language import asking
from rpaug.language.messages import WishContext
from rpaug.pipeline import recipe as recipes

# What the rule-based analyst asks for. A thing that the robot acts on cannot be moved: recorded actions would miss it.
WORDS: dict[Factor, str] = {
    "object color": "vary the color of the manipulated object",
    "object texture": "change the texture of the manipulated object",
    "object size": "vary the size of the manipulated object",
    "lighting": "vary the color of the lights and move the lamp",
    "table": "either vary the color of the table or change the texture of the table",
    "background": "change the texture of the background",
    "distractor": "add two distractors",
    "camera": "jitter all fixed cameras by up to 10 cm and up to 3 degrees",
}
NO_EDIT: dict[Factor, str] = {
    "object position": "no edit of a recording can move what the robot acts on, since its actions stay as they were: "
    "record demonstrations with it there",
    "other": "no edit is known to help",
}
LEAST = 0.05  # probability of an edit


def mended(cause: Cause, reference: Reference | None, seed: int = 0) -> Cause:
    """The cause with the edits that its remedy comes to in the recordings, or with a note why there are none."""
    if not cause.remedy:
        return cause.model_copy(update={"note": NO_EDIT.get(cause.factor, "no remedy was named")})
    setting = WishContext() if reference is None else reference.setting
    scene = None if reference is None else reference.scene
    try:
        asked = asking.ask(cause.remedy, setting, scene)
    except RpaugError as error:  # whatever is amiss with it, the other causes keep theirs
        return cause.model_copy(update={"note": f"the remedy is no edit: {asking.reason(error)}"})
    chance = round(min(1.0, max(LEAST, cause.rate)), 3)
    focal = None if reference is None else reference.focal
    wide = [
        ranges.widened(cause.factor, edit, cause.spans, focal) for edit in asked.recipe["edits"]
    ]
    edits = tuple({**edit, "probability": chance} for edit in wide)
    return cause.model_copy(update={"edits": edits, "note": "; ".join(asked.notes)})


def recipe(causes: Sequence[Cause], *, seed: int = 0, copies: int = 1) -> dict[str, Any] | None:
    """The recipe of all edits, None if there is none. Raises BadRecipe, which would be a fault of ours."""
    edits: list[dict[str, Any]] = []
    for cause in causes:
        edits += [edit for edit in cause.edits if _bare(edit) not in map(_bare, edits)]
    if not edits:
        return None
    made = {"version": 1, "seed": seed, "copies": copies, "edits": edits}
    recipes.build(made, name="the diagnosed recipe")
    return made


def _bare(edit: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in edit.items() if name != "probability"}
