"""One coherent draw per (epoch, episode): what `rpaug augment` writes as copy epoch + 1, rendered when asked for."""

import warnings
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

from rpaug.core.types import Episode
from rpaug.pipeline import copies as pipeline
from rpaug.training.scenes import Ready, Scenes
from rpaug.training.schedule import Schedule

TRIES = 4  # draws of one copy until its instruction and actions are true; else it stays as recorded
KEPT_DRAWS = 2  # edited scenes: each keeps its recorded one, and decoded images of it


@dataclass(frozen=True)
class Drawn:
    """An episode with what was drawn for it; `skipped` says why the recipe could not be applied to it, if so."""

    episode: Episode
    edits: list[dict[str, Any]] = field(default_factory=list)
    skipped: str = ""


class Draws:
    """Edited episodes of the selected ones; in epochs they are left out of, as recorded.

    So is, with a warning that names it, an episode that `rpaug augment` would skip: one without a target, say.
    """

    def __init__(self, scenes: Scenes, schedule: Schedule, keep_invalid: bool = False) -> None:
        self.scenes, self.schedule, self.keys = scenes, schedule, scenes.keys
        self.keep_invalid = keep_invalid
        self._held: OrderedDict[tuple[int, int], Drawn] = OrderedDict()

    def __call__(self, index: int, epoch: int) -> Drawn:
        """Episode number `index` in that epoch. Raises RpaugError."""
        asked = index, epoch
        if asked not in self._held:
            self._held[asked] = self._drawn(index, epoch)
        self._held.move_to_end(asked)
        if len(self._held) > KEPT_DRAWS:
            self._held.popitem(last=False)
        return self._held[asked]

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_held": OrderedDict()}

    def _drawn(self, index: int, epoch: int) -> Drawn:
        key, recipe = self.keys[index], self.scenes.recipe
        ready = self.scenes(key)
        if not self.schedule.augmented(recipe, self.keys, epoch, index):
            return Drawn(_recorded(ready))
        if why := ready.lacking():
            warnings.warn(f"{key} comes as recorded: {why}", stacklevel=2)
            return Drawn(_recorded(ready), skipped=why)
        for attempt in range(TRIES):
            edited, draws = pipeline.draw(ready.scene, recipe, epoch + 1, attempt)
            made = pipeline.render(edited, draws, ready.plan, kept=ready.surfels)
            if not made.untrue and (edited.actions_valid or self.keep_invalid):
                return Drawn(made.episode, [draw.describe() for draw in draws])
        return Drawn(_recorded(ready), skipped=made.untrue or "its actions would be untrue")


def _recorded(ready: Ready) -> Episode:
    return pipeline.render(ready.scene, (), ready.plan, kept=ready.surfels).episode
