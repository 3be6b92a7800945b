"""Episodes to measure on: one of a dataset, or one that the twin records on the spot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rpaug import twin
from rpaug.cli.console import read_episode
from rpaug.core.errors import RpaugError
from rpaug.core.types import Episode

MaybeDataset = Annotated[
    Path | None, typer.Argument(help="Folder of a dataset.", show_default=False)
]
TwinTask = Annotated[
    str | None,
    typer.Option("--twin", help="Record this task of the twin instead: open_drawer, ..."),
]
TwinSeed = Annotated[int, typer.Option("--seed", min=0, help="The twin's.")]


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Either `dataset` with `episode`, the key of one in it (None: the first), or the twin's `task` with `seed`."""

    dataset: Path | None = None
    episode: str | None = None
    task: str | None = None
    seed: int = 0
    frames: int = 17  # that the twin records
    size: int = 128  # pixels a side, of the twin's cameras

    def __post_init__(self) -> None:
        if (self.dataset is None) == (self.task is None):
            raise RpaugError("name a dataset, or --twin with a task, and not both")

    def read(self) -> Episode:
        """The episode. Raises RpaugError for names that are not there."""
        if self.dataset is None:
            assert self.task is not None
            return twin.perform(self.task, self.seed, frames=self.frames, size=self.size).episode
        return read_episode(self.dataset, self.episode)

    def read_with(self, frame: int) -> Episode:
        """The episode, which has this frame. Raises RpaugError if it is shorter."""
        found = self.read()
        if frame >= found.length:
            raise RpaugError(f"--frame {frame}: the episode has frames 0 to {found.length - 1}")
        return found

    def describe(self) -> dict[str, object]:
        """Plain values; a dataset by its folder's name alone."""
        facts = {name: value for name, value in vars(self).items() if value is not None}
        return facts | ({"dataset": self.dataset.name} if self.dataset else {})
