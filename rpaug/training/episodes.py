"""A torch map-style dataset of augmented demonstrations."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch.utils.data import Dataset

from rpaug import pipeline, plan, preparing, recipe, registry
from rpaug.errors import Unsupported
from rpaug.scene import keyframes, simulate
from rpaug.types import Episode, Scene

KEPT_SCENES = 16  # built scenes a process keeps: bodies and roles, no images


class AugmentedEpisodes(Dataset[dict[str, Any]]):
    """Edited episodes of `dataset`, one coherent draw per (epoch, episode), shared by all cameras and frames.

    Item i is a dict: `key`, `instruction`, `frames` (n,) int64, `edits` (what was drawn, plain JSON values),
    `joint_positions` (n, j), `gripper_to_world` (n, 4, 4), `gripper_open` (n,) float64 as recorded, where known, and
    `cameras`, per name a dict of `rgb` (n, h, w, 3) uint8, `depth` (n, h, w) float32 metres, `ids` (n, h, w) int32,
    `K` (3, 3) and `cam_to_world` (n, 4, 4) float64 (OpenCV axes, integer pixel centres).

    `frames` says which frames: the key frames (PerAct's rule, the first frame among them), all, or given numbers.
    The same recipe, epoch and episode give the same item in any worker and in any order; `set_epoch` before each
    epoch, before the loader makes its workers (so without persistent workers). Where physics makes the recorded actions
    untrue, an item is drawn again, as often as the recipe's gates allow, and else refused, unless `keep_invalid`. Raises
    BadInput, BadRecipe, Unsupported.
    """

    def __init__(
        self,
        dataset: Path | str,
        recipe_file: Path | str,
        *,
        frames: Literal["key", "all"] | Sequence[int] = "key",
        cameras: Sequence[str] | None = None,
        tier: int = 0,
        keep_invalid: bool = False,
    ) -> None:
        if isinstance(frames, str) and frames not in ("key", "all"):
            raise Unsupported(
                f"frames={frames!r}: expected 'key', 'all' or a list of frame numbers"
            )
        if isinstance(cameras, str):
            raise Unsupported(f"cameras={cameras!r}: expected a list of names")
        self.root = Path(dataset)
        self.recipe = recipe.load(Path(recipe_file))
        self.adapter = registry.adapter_for(self.root).name
        self.keys = self.recipe.select(registry.adapter(self.adapter).episodes(self.root))
        self.frames, self.cameras, self.tier, self.epoch = frames, cameras, tier, 0
        self.keep_invalid = keep_invalid
        if not self.keys:
            raise Unsupported(f"{self.root}: the recipe's select matches none of its episodes")
        if tier >= 3:
            raise Unsupported(
                "training draws at tiers 0 to 2; write episodes with `rpaug augment --tier 3`"
            )

    def set_epoch(self, epoch: int) -> None:
        """Draw anew: epoch e of an episode is what `rpaug augment` writes as copy e + 1."""
        self.epoch = epoch

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: int) -> dict[str, Any]:
        scene, made_plan = _scene(
            self.adapter, self.root, self.keys[index], self.recipe_key, self.tier
        )
        edited, draws = self._drawn(scene)
        made = pipeline.render(edited, draws, made_plan)
        return self._item(made.episode, [draw.describe() for draw in draws])

    def _drawn(self, scene: Scene) -> tuple[Scene, tuple[pipeline.Draw, ...]]:
        """The first draw in which the recorded actions still hold. Raises Unsupported if there is none."""
        gates = self.recipe.gates
        for attempt in range(gates.tries if gates else 1):
            edited, draws = pipeline.draw(scene, self.recipe, self.epoch + 1, attempt)
            if edited.actions_valid or self.keep_invalid:
                return edited, draws
        why = "; ".join(simulate.invalid(edited.simulated))
        raise Unsupported(
            f"{scene.episode.key}: {why}: not for training; keep_invalid=True gives it all the same"
        )

    @property
    def recipe_key(self) -> "_Hashed":
        """The recipe as a cache key."""
        return _Hashed(self.recipe)

    def _item(self, episode: Episode, edits: list[dict[str, Any]]) -> dict[str, Any]:
        chosen = self._chosen(episode)
        names = list(episode.views) if self.cameras is None else list(self.cameras)
        robot = episode.robot
        return {
            "key": episode.key,
            "instruction": episode.instruction,
            "frames": torch.tensor(chosen),
            "edits": edits,
            "joint_positions": torch.from_numpy(robot.joint_positions[chosen]),
            **{
                name: torch.from_numpy(track[chosen])
                for name in ("gripper_to_world", "gripper_open")
                if (track := getattr(robot, name)) is not None
            },
            "cameras": {name: _images(episode, name, chosen) for name in names},
        }

    def _chosen(self, episode: Episode) -> list[int]:
        if isinstance(self.frames, str):
            every = list(range(episode.length))
            if self.frames == "all":
                return every
            if episode.robot.gripper_open is None:
                reason = (
                    f"{episode.key}: key frames need the gripper's opening; ask for frames='all'"
                )
                raise Unsupported(reason)
            return sorted({0, *keyframes.find(episode.robot)})
        return list(self.frames)


class _Hashed:
    """A recipe that compares by its source data."""

    def __init__(self, value: recipe.Recipe) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Hashed) and self.value.source == other.value.source

    def __hash__(self) -> int:
        return hash(repr(self.value.source))


@lru_cache(KEPT_SCENES)
def _scene(adapter: str, root: Path, key: str, made: _Hashed, tier: int) -> tuple[Scene, plan.Plan]:
    episode = registry.adapter(adapter).read(root, key)
    return preparing.made_ready(episode, made.value, tier)


def _images(episode: Episode, name: str, frames: list[int]) -> dict[str, torch.Tensor]:
    view = episode.views[name]
    images = {"rgb": view.rgb, "depth": view.depth, "ids": view.ids}
    out = {
        kind: torch.from_numpy(np.stack([image(t) for t in frames]))
        for kind, image in images.items()
        if image is not None
    }
    out["K"] = torch.from_numpy(
        view.camera.K.copy()
    )  # the scene is kept: a caller may write to an item
    out["cam_to_world"] = torch.from_numpy(view.camera.cam_to_world[frames])
    return out
