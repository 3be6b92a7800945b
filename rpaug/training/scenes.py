"""The scenes a training loop draws from: found once, kept in memory up to a limit, and in a folder if one is given."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from rpaug.core import memo, registry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Episode, Scene
from rpaug.core.version import __version__
from rpaug.gaussians import store
from rpaug.pipeline import prepare
from rpaug.pipeline.copies import PreparedEpisode
from rpaug.pipeline.plan import Plan, make
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.build import build
from rpaug.scene.recorded import surfels
from rpaug.scene.recorded.surfels import Surfels
from rpaug.training import prepared

KEPT_SCENES = 256
KEPT_BYTES = 512 * 2**20  # of surfels, in each process


@dataclass(frozen=True)
class Ready:
    """A recorded episode and what all its copies share.

    `lacking` says why the recipe's edits cannot be made of it, and is empty where they can. `name` tells its content
    and all that verdicts on its copies depend on from any other.
    """

    episode: Episode
    prepared: PreparedEpisode
    lacking: Callable[[], str]
    name: Callable[[], str]


class Scenes:
    """Scenes of a dataset's episodes, ready for the edits of a recipe.

    With a `folder`, what was found of an episode is read back from there by any process that asks again, and fitted
    Gaussians are. A copy of it, as a worker process gets one, begins with nothing in memory.
    """

    def __init__(
        self,
        root: Path,
        recipe: Recipe,
        tier: int,
        folder: Path | None,
        keep_invalid: bool = False,
    ) -> None:
        self.root, self.tier, self.folder = root, tier, folder
        self.recipe = recipe.settled(root)
        self.keep_invalid = keep_invalid
        memo.keep(KEPT_SCENES)  # samples come from episodes by turns
        self.adapter = registry.adapter_for(root).name
        self._held: OrderedDict[str, Ready] = OrderedDict()
        self._bytes: dict[str, int] = {}

    def __call__(self, key: str) -> Ready:
        """The scene of one episode. Raises RpaugError."""
        if key not in self._held:
            self._held[key] = self._ready(key)
        self._held.move_to_end(key)
        while len(self._held) > 1 and self._full:
            dropped, _ = self._held.popitem(last=False)
            self._bytes.pop(dropped, None)
        return self._held[key]

    @property
    def keys(self) -> list[str]:
        """The selected episodes, in order."""
        return self.recipe.select(registry.adapter(self.adapter).episodes(self.root))

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_held": OrderedDict(), "_bytes": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        memo.keep(KEPT_SCENES)

    @property
    def _full(self) -> bool:
        return len(self._held) > KEPT_SCENES or sum(self._bytes.values()) > KEPT_BYTES

    def _ready(self, key: str) -> Ready:
        episode = registry.adapter(self.adapter).read(self.root, key)
        try:
            scene, plan, kept = self._found(episode)
        except (TargetError, Unsupported) as error:  # `rpaug augment` skips it
            why, scene = str(error), build(episode, with_bodies=False)
            bare = PreparedEpisode(scene, make((), episode), self.recipe)
            return Ready(episode, bare, lambda: why, lambda: key)
        find = self._counted(key, lambda: kept or surfels.recorded(scene))
        prepared = PreparedEpisode(scene, plan, self.recipe, find, self.keep_invalid)
        lacking = cache(partial(_lacking, scene, self.recipe))
        return Ready(episode, prepared, lacking, cache(partial(self._name, scene, key)))

    def _name(self, scene: Scene, key: str) -> str:
        """The episode's key in one process; where a folder is shared, a hash of its content and of what is asked."""
        if self.folder is None:
            return key
        asked = {
            "rpaug": __version__,
            "key": key,
            "recipe": self.recipe.source,
            "tier": self.tier,
            "keep_invalid": self.keep_invalid,
        }
        return store.key(scene, asked, 0)

    def _found(self, episode: Episode) -> tuple[Scene, Plan, Surfels | None]:
        plan = make(prepare.operators(self.recipe), episode, self.tier)
        bare = build(episode, with_bodies=False)
        masked = all(view.ids and view.depth for view in episode.views.values())
        plain = masked and plan.bodies and not plan.parts and not plan.gaussians
        # What a prepared scene does not hold.
        given = self.recipe.accuracy or self.recipe.arms or self.recipe.models.finds
        if self.folder is None or not plain or given:
            return *prepare.prepare_scene(episode, self.recipe, self.tier, self.folder), None
        roles = self.recipe.source.get("roles")
        name = store.key(bare, {"prepared": prepared.VERSION, "roles": roles}, 0)
        path = self.folder / f"{name}{prepared.ENDING}"
        moved = 1 in plan.representations.values()
        found = prepared.load(path, bare)
        if found is None or (moved and found[1] is None):
            scene, plan = prepare.prepare_scene(episode, self.recipe, self.tier)
            found = scene, surfels.recorded(scene) if moved else None
            prepared.save(path, *found)
        return found[0], plan, found[1]

    def _counted(self, key: str, find: Callable[[], Surfels]) -> Callable[[], Surfels]:
        """`find`, asked once, its answer counted against the memory limit."""

        @cache
        def found() -> Surfels:
            answer = find()
            self._bytes[key] = prepared.size(answer)
            return answer

        return found


def _lacking(scene: Scene, recipe: Recipe) -> str:
    try:
        prepare.ground(scene, recipe)
    except (TargetError, Unsupported) as error:
        return str(error)
    return ""
