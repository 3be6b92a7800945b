"""Whether images show more than an episode's report counts: what was spoilt after the edit was not the edit."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from rpaug.core.types import Episode

Found = tuple[Literal["bad"], str, str, str]
CLEAR = 32  # levels in one channel: more than a JPEG or a video at the quality that is written is off by
STRAY = 0.01  # of the pixels compared: where a codec is off by more than that all the same


def compare(
    key: str, recorded: Episode, made: Episode, given: Mapping[str, Any], times: Sequence[int]
) -> Iterator[Found]:
    """A finding for each camera in which more pixels differ clearly in a few frames than the report counts in all."""
    counted = given.get("changed_pixels")
    for name, view in made.views.items():
        most = counted.get(name) if isinstance(counted, dict) else None
        old, new = recorded.views[name].camera, view.camera
        if not isinstance(most, int) or (old.width, old.height) != (new.width, new.height):
            continue  # of another size: said already
        differ = [_clearly(recorded.views[name].rgb(t), view.rgb(t)) for t in times]
        pixels = sum(one.size for one in differ)
        found = sum(int(one.sum()) for one in differ)
        if found > most + STRAY * pixels:
            words = (
                f"{name}: {found} of {pixels} pixels differ clearly in the frames compared; "
                f"the report counts {most} that changed in all frames"
            )
            yield "bad", key, "images beyond the report", words


def _clearly(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return np.abs(before.astype(np.int16) - after).max(-1) > CLEAR
