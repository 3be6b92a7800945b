"""One coherent copy per (epoch, episode): what `rpaug augment` makes as copy epoch + 1, rendered when asked for."""

import warnings
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rpaug.core.types import Episode
from rpaug.pipeline.copies import ORIGINAL, Known, Made, draw_copy
from rpaug.training.scenes import Ready, Scenes
from rpaug.training.schedule import Schedule
from rpaug.training.verdicts import CopyVerdict, Verdicts

KEPT_DRAWS = 2  # edited scenes: each keeps its recorded one, and decoded images of it
KEPT_PLAIN = 512  # of those whose images are drawn on a device, which keep none


@dataclass(frozen=True)
class Drawn:
    """An episode with what was drawn for it; `skipped` says why it comes as recorded although a copy was due. `made`
    is the copy that was made, `plain` its cameras whose frames are drawn on a device and kept nowhere else."""

    episode: Episode
    edits: list[dict[str, Any]] = field(default_factory=list)
    skipped: str = ""
    made: Made | None = None
    plain: frozenset[str] = frozenset()

    @property
    def light(self) -> bool:
        """Whether it keeps no images."""
        return self.made is not None and self.plain >= self.made.scene.episode.views.keys()


class Draws:
    """Copies of the selected episodes; in epochs they are left out of, the episodes as recorded.

    So comes a copy that `rpaug augment` rejects, and, with a warning that names it, an episode that `rpaug augment`
    skips: one that has nothing for any edit, say. An edit that is left out of a copy is named by a warning too. Where
    the recipe says `on_missing: fail`, what an edit lacks is raised (`Missing`).
    """

    def __init__(
        self,
        scenes: Scenes,
        schedule: Schedule,
        plain: Callable[[Made], frozenset[str]] | None = None,
    ) -> None:
        """`plain` tells a copy's cameras whose frames a device draws: copies of such alone keep no images, and more of
        them are held."""
        self.scenes, self.schedule, self.keys = scenes, schedule, scenes.keys
        self._plain = plain
        self.verdicts = Verdicts(scenes.folder)
        self._held: OrderedDict[tuple[int, int], Drawn] = OrderedDict()

    def __call__(self, index: int, epoch: int) -> Drawn:
        """Episode number `index` in that epoch. Raises RpaugError."""
        asked = index, epoch
        if asked not in self._held:
            self._held[asked] = self._drawn(index, epoch)
            self._make_room()
        self._held.move_to_end(asked)
        return self._held[asked]

    def _make_room(self) -> None:
        heavy = [one for one, drawn in self._held.items() if not drawn.light]
        for one in heavy[:-KEPT_DRAWS]:
            del self._held[one]
        while len(self._held) > KEPT_PLAIN:
            self._held.popitem(last=False)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_held": OrderedDict()}

    def _drawn(self, index: int, epoch: int) -> Drawn:
        key, recipe = self.keys[index], self.scenes.recipe
        ready = self.scenes(key)
        if not self.schedule.augmented(recipe, self.keys, epoch, index):
            return _as_recorded(ready)
        if why := ready.lacking():
            warnings.warn(f"{key} comes as recorded: {why}", stacklevel=2)
            return _as_recorded(ready, why)
        made, faults = self._judged(ready, epoch + 1)
        if made is None:
            return _as_recorded(ready, "; ".join(faults))
        for draw in made.draws:
            if draw.option and draw.left_out:
                words = f"{key}: {draw.option.name} is left out: {draw.left_out}"
                warnings.warn(words, stacklevel=2)
        plain = self._plain(made) if self._plain else frozenset[str]()
        edits = [draw.describe() for draw in made.draws]
        return Drawn(made.recorded, edits, made=made, plain=plain)

    def _judged(self, ready: Ready, copy: int) -> tuple[Made | None, tuple[str, ...]]:
        """The copy, or None and why it is rejected. A copy that gates judged once is not judged again."""
        prepared = ready.prepared
        if prepared.recipe.gates is None:
            made = draw_copy(prepared, copy)
            return (None if made.faults else made), made.faults
        name = ready.name()
        verdict = self.verdicts.get(name, copy)
        if verdict is None:
            made = draw_copy(prepared, copy)
            self.verdicts.keep(name, copy, CopyVerdict(made.attempt, made.faults))
            return (None if made.faults else made), made.faults
        if verdict.faults:
            return None, verdict.faults
        return draw_copy(prepared, copy, known=Known(verdict.attempt)), ()


def _as_recorded(ready: Ready, skipped: str = "") -> Drawn:
    return Drawn(draw_copy(ready.prepared, ORIGINAL).recorded, skipped=skipped)
