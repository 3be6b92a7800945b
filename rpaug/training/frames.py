"""Which frames an item shows: an episode's key frames, all of them, some of them, or windows of a few in a row."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rpaug.core import keyframes
from rpaug.core.errors import Unsupported
from rpaug.core.types import Episode


@dataclass(frozen=True)
class Windows:
    """Every run of `length` frames, `stride` apart, each run beginning `step` frames after the one before.

    An episode that is shorter gives one window, its last frame repeated.
    """

    length: int
    stride: int = 1
    step: int = 1

    def __post_init__(self) -> None:
        if min(self.length, self.stride, self.step) < 1:
            raise Unsupported(f"{self}: expected whole numbers from 1")

    def starts(self, frames: int) -> range:
        """The first frames of all windows of an episode."""
        return range(0, max(1, frames - (self.length - 1) * self.stride), self.step)

    def frames(self, start: int, frames: int) -> list[int]:
        """The frames of one window."""
        return [min(start + n * self.stride, frames - 1) for n in range(self.length)]


Frames = Literal["key", "all"] | Sequence[int] | Windows


def check(frames: Frames) -> None:
    """Raises Unsupported for what is none of those."""
    if isinstance(frames, Windows):
        return
    if isinstance(frames, str) and frames not in ("key", "all"):
        raise Unsupported(f"frames={frames!r}: expected 'key', 'all', Windows or frame numbers")
    if not isinstance(frames, str) and not all(isinstance(t, int) and t >= 0 for t in frames):
        raise Unsupported(f"frames={frames!r}: expected frame numbers from 0")


def of(episode: Episode, frames: Frames, start: int = 0) -> list[int]:
    """The frame numbers of one item. Raises Unsupported."""
    if isinstance(frames, Windows):
        return frames.frames(start, episode.length)
    if frames == "all":
        return list(range(episode.length))
    if not isinstance(frames, str):
        if frames and max(frames) >= episode.length:
            raise Unsupported(
                f"{episode.key}: frame {max(frames)} of {episode.length}; expected numbers below that"
            )
        return list(frames)
    if episode.robot.gripper_open is None:
        raise Unsupported(
            f"{episode.key}: key frames need the gripper's opening; ask for frames='all'"
        )
    return sorted({0, *keyframes.find(episode.robot)})
