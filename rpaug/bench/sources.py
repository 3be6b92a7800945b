"""Episodes to measure on: one of a dataset, or one that the twin records on the spot."""

from dataclasses import dataclass
from pathlib import Path

from rpaug import twin
from rpaug.core import registry
from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.types import Episode


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
        adapter = registry.adapter_for(self.dataset)
        keys = adapter.episodes(self.dataset)
        if self.episode is not None and self.episode not in keys:
            known = ", ".join(keys[:20])
            raise BadInput(
                self.dataset, "--episode", found=self.episode, expected=f"one of: {known}"
            )
        return adapter.read(self.dataset, self.episode if self.episode is not None else keys[0])

    def describe(self) -> dict[str, object]:
        """Plain values; a dataset by its folder's name alone."""
        facts = {name: value for name, value in vars(self).items() if value is not None}
        return facts | ({"dataset": self.dataset.name} if self.dataset else {})
