"""Torch datasets of augmented demonstrations, map-style and iterable."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from rpaug.core import registry
from rpaug.core.errors import Unsupported
from rpaug.core.types import Episode
from rpaug.pipeline import inputs
from rpaug.pipeline.inputs import RecipeLike
from rpaug.training import frames as choosing
from rpaug.training.drawing import Draws
from rpaug.training.frames import Frames, Windows
from rpaug.training.scenes import Scenes
from rpaug.training.schedule import Schedule, epoch_number

GAUSSIANS = 3  # the first tier that is fitted


class AugmentedEpisodes(Dataset[dict[str, Any]]):
    """Edited episodes of `dataset`, one coherent draw per (epoch, episode), shared by all cameras and frames.

    Item i is a dict: `key`, `instruction`, `frames` (n,) int64, `edits` (what was drawn, plain JSON values),
    `joint_positions` (n, j), `gripper_to_world` (n, 4, 4), `gripper_open` (n,) float64 as recorded, where known, and
    `cameras`, per name a dict of `rgb` (n, h, w, 3) uint8, `depth` (n, h, w) float32 metres, `ids` (n, h, w) int32,
    `K` (3, 3) and `cam_to_world` (n, 4, 4) float64 (OpenCV axes, integer pixel centres). `skipped` is empty, or says
    why the recipe could not be applied: the episode then comes as recorded, without `edits`.

    `dataset` is a folder or `sample`; `recipe` a file, the name of a shipped one, a dict or a `Recipe`.
    `frames` says which frames: the key frames (PerAct's rule, the first frame among them), all, given numbers, or
    `Windows`, of which each is an item of its own. `schedule` says which episodes of an epoch are augmented. With a
    folder `scenes`, scenes are found once and read back from there; Gaussians (tier 3) ask for one.
    In epoch e an episode is copy e + 1 of `rpaug augment`, gates and redraws included. A copy that is rejected there
    comes as recorded; so does, with a warning, an episode that lacks what an edit asks for.
    The same recipe, epoch and episode give the same item in any worker and in any order. `set_epoch` reaches workers
    that are already running. Raises BadInput, BadRecipe, Unsupported.
    """

    def __init__(
        self,
        dataset: Path | str,
        recipe: RecipeLike,
        *,
        frames: Frames = "key",
        cameras: Sequence[str] | None = None,
        tier: int = 0,
        schedule: Schedule | None = None,
        scenes: Path | str | None = None,
        keep_invalid: bool = False,
    ) -> None:
        choosing.check(frames)
        if isinstance(cameras, str):
            raise Unsupported(f"cameras={cameras!r}: expected a list of names")
        if inputs.tier(tier) >= GAUSSIANS and scenes is None:
            raise Unsupported(
                "Gaussians are fitted before training: tier 3 needs `scenes`, a folder filled by `rpaug fit`"
            )
        root, folder = registry.dataset(dataset), Path(scenes) if scenes else None
        held = Scenes(root, inputs.recipe(recipe), tier, folder, keep_invalid)
        self.draws = Draws(held, schedule or Schedule())
        self.keys, self.frames, self.cameras = self.draws.keys, frames, cameras
        if not self.keys:
            raise Unsupported(f"{root}: the recipe's select matches none of its episodes")
        inputs.see_handles_hold(held.recipe, registry.adapter(held.adapter), root, self.keys)
        if cameras is not None:
            _check(cameras, registry.adapter(held.adapter).read(root, self.keys[0]))
        self.items = list(self._items(root))
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()

    @property
    def epoch(self) -> int:
        """The epoch whose draws items show."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Draw anew: epoch e of an episode is what `rpaug augment` writes as copy e + 1. Raises Unsupported below 0."""
        self._epoch.fill_(epoch_number(epoch))

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: int) -> dict[str, Any]:
        number, start = self.items[index]
        drawn = self.draws(number, self.epoch)
        episode = drawn.episode
        chosen = choosing.of(episode, self.frames, start)
        names = list(episode.views) if self.cameras is None else list(self.cameras)
        _check(names, episode)
        robot = episode.robot
        return {
            "key": episode.key,
            "instruction": episode.instruction,
            "frames": torch.tensor(chosen),
            "edits": drawn.edits,
            "skipped": drawn.skipped,
            "joint_positions": torch.from_numpy(robot.joint_positions[chosen]),
            **{
                name: torch.from_numpy(track[chosen])
                for name in ("gripper_to_world", "gripper_open")
                if (track := getattr(robot, name)) is not None
            },
            "cameras": {name: _images(episode, name, chosen) for name in names},
        }

    def _items(self, root: Path) -> Iterator[tuple[int, int]]:
        """Number of the episode and first frame of each item."""
        if not isinstance(self.frames, Windows):
            yield from ((number, 0) for number in range(len(self.keys)))
            return
        adapter = registry.adapter(self.draws.scenes.adapter)
        for number, key in enumerate(self.keys):
            length = adapter.read(root, key).length
            yield from ((number, start) for start in self.frames.starts(length))


class AugmentedStream(IterableDataset[dict[str, Any]]):
    """The items of `episodes`, in an order drawn anew each epoch, every worker its own share of them.

    Whole episodes are shuffled, and then the items of `mixed` episodes at a time: windows of one episode share its
    draw, and come from one worker. Each item comes once an epoch, whatever the number of workers. Rank `rank` of
    `ranks` processes takes its share too.
    """

    def __init__(
        self, episodes: AugmentedEpisodes, *, mixed: int = 4, rank: int = 0, ranks: int = 1
    ) -> None:
        if mixed < 1 or not 0 <= rank < ranks:
            raise Unsupported(
                f"mixed={mixed}, rank={rank} of {ranks}: expected 1 or more, 0 <= rank < ranks"
            )
        self.episodes, self.mixed, self.rank, self.ranks = episodes, mixed, rank, ranks

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        workers, number = (worker.num_workers, worker.id) if worker else (1, 0)
        share, shares = self.rank * workers + number, self.ranks * workers
        epoch, every = self.episodes.epoch, self.episodes.items
        rng = self.episodes.draws.scenes.recipe.generator("order", epoch + 1, 0)
        mine = rng.permutation(len(self.episodes.keys))[share::shares].tolist()
        belong: dict[int, list[int]] = {}
        for item, (episode, _) in enumerate(every):
            belong.setdefault(episode, []).append(item)
        for at in range(0, len(mine), self.mixed):
            group = [item for episode in mine[at : at + self.mixed] for item in belong[episode]]
            for item in rng.permutation(group).tolist():
                yield self.episodes[item]


def _check(cameras: Sequence[str], episode: Episode) -> None:
    """See that the episode has those cameras. Raises Unsupported."""
    for name in cameras:
        if name not in episode.views:
            known = ", ".join(episode.views)
            raise Unsupported(f"{episode.key}: no camera is called {name!r}; there are: {known}")


def _images(episode: Episode, name: str, frames: list[int]) -> dict[str, torch.Tensor]:
    view = episode.views[name]
    images = {"rgb": view.rgb, "depth": view.depth, "ids": view.ids}
    out: dict[str, torch.Tensor] = {}
    stacks: dict[str, list[np.ndarray]] = {kind: [] for kind, image in images.items() if image}
    for t in frames:  # all images of a frame in turn: they are rendered together
        for kind, stack in stacks.items():
            stack.append(images[kind](t))  # type: ignore[misc]
    out = {kind: torch.from_numpy(np.stack(stack)) for kind, stack in stacks.items()}
    # The scene is kept: a caller may write to an item.
    out["K"] = torch.from_numpy(view.camera.K.copy())
    out["cam_to_world"] = torch.from_numpy(view.camera.cam_to_world[frames])
    return out
