"""`clips.yaml`: which parts of the videos beside it are episodes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rpaug_adapters.shared.texts import read_yaml
from rpaug_adapters.video.ego4d import Notes
from rpaug_adapters.video.stream import Video

from rpaug import BadInput

NAME = "clips.yaml"
MOST = 10**6  # values in the file


class Cut(BaseModel):
    """A part of a video: between two times in seconds, or around a narration or FHO action."""

    model_config = ConfigDict(extra="forbid")
    video: str = Field(description="its file's name, without the ending")
    start: float | None = Field(default=None, ge=0)
    end: float | None = Field(default=None, gt=0)
    annotation: str | None = Field(default=None, description="annotation_uid of a narration")
    margin: float = Field(default=2.0, gt=0, description="seconds on both sides of an annotation")


class Cuts(BaseModel):
    """All of the file."""

    model_config = ConfigDict(extra="forbid")
    version: Literal[1] = 1
    clips: list[Cut]


def load(folder: Path, names: Iterable[str] | None = None) -> list[Cut]:
    """What the file in a folder asks for; nothing where there is none. Raises BadInput, also for a video that is not
    among the `names` of the folder's files, if they are given."""
    path = folder / NAME
    if not path.is_file():
        return []
    clips = read_yaml(path, Cuts, MOST).clips
    stems = sorted({Path(name).stem for name in names or ()} - {path.stem})
    for number, cut in enumerate(clips if names is not None else ()):
        if cut.video not in stems:
            expected = f"a video beside it: {', '.join(stems[:10])}"
            raise BadInput(path, f"clips.{number}.video", found=cut.video, expected=expected)
    return clips


def part(whole: Video, notes: Notes, folder: Path, number: int) -> Video:
    """The frames that a cut asks for: those shown from its start on and before its end. Raises BadInput."""
    cut = load(folder)[number]
    where, seconds = folder / NAME, whole.facts.seconds
    start, end = cut.start, cut.end
    if cut.annotation is not None:
        at = notes.when(cut.annotation)
        if at is None:
            found = cut.annotation
            raise BadInput(
                where, f"clips.{number}.annotation", found=found, expected="one of its narrations"
            )
        start, end = max(0.0, at[0] - cut.margin), at[1] + cut.margin
    first = int(np.searchsorted(seconds, (start or 0.0) - 1e-6))
    stop = len(seconds) if end is None else int(np.searchsorted(seconds, end - 1e-6))
    if stop <= first:
        found = f"no frame between {start} and {end} s of {seconds[-1]:.2f}"
        raise BadInput(where, f"clips.{number}", found=found, expected="a part of the video")
    return Video(whole.path, first, stop)
