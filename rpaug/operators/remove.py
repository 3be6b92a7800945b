"""Take a thing out of the scene and show what lies behind it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator

from rpaug.core.errors import RpaugError
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Effect, Scene
from rpaug.providers import inpaint
from rpaug.scene.lighting import shadows
from rpaug.scene.placement import untouched
from rpaug.scene.targets import targets


def _known(method: str) -> str:
    try:
        inpaint.check(method)
    except RpaugError as error:
        raise ValueError(str(error)) from None
    return method


Inpainting = Annotated[str, AfterValidator(_known)]


@dataclass(frozen=True, kw_only=True)
class Remove(Operator):
    """Remove `target`: what other cameras and times saw behind it is shown, and only what nobody saw is painted.

    What is painted is the same in all cameras and frames, and marked as invented. Things that the robot acts on are
    refused, since the recorded actions would be untrue. Without a target one that the robot leaves alone is drawn.
    """

    target: targets.Target | None = None
    inpaint: Inpainting = "fsr"

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    needs: ClassVar[Needs] = Needs(targets=("target",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "remove": "remove, delete, erase, get rid of, take away, take out, take off, eliminate, "
        "hide, discard, clear away, clear out, clear off, strip, throw out, throw away, "
        "toss out, cut out, ditch, dispose of, leave out, omit, gone, away, rm, removed, "
        "disappear, vanish, wipe out, lose, out, away with, drop out, out of the scene, "
        "off the table, out of the way, from the table, from the scene, "
        "remove from the scene",
        "clear": "clear, clean, tidy, empty, clean up, tidy up, clear up",
    }
    phrases: ClassVar[tuple[str, ...]] = ("remove {target}",)
    examples: ClassVar[Examples] = (
        ("get rid of the white pad", {"target": "white pad"}),
        ("clear instances 4 and 7 away", {"target": {"handle": [4, 7]}}),
    )
    settles: ClassVar[str] = "removal"

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        target = untouched.pick(scene, self.target, rng, "removing")
        instance_ids = untouched.find_untouched(scene, target, "removing")
        return {"handles": sorted(instance_ids), "lamps": shadows.lamps(scene)}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        after = replace(untouched.without(scene, edit["handles"]), inpaint=self.inpaint)
        return shadows.follow(scene, after, edit["lamps"])
