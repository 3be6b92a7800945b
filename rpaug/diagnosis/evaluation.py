"""An evaluation: rollouts of a policy that succeeded or failed, and what cameras saw of them, read when asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int32, UInt8

from rpaug.core import registry
from rpaug.core.errors import BadInput
from rpaug.core.types import CameraView

Image = Callable[[], UInt8[np.ndarray, "h w 3"]]


@dataclass(frozen=True)
class CameraShot:
    """What one camera saw at one frame. `ids` and `pose` (camera to world) are None where the evaluation lacks them."""

    image: Image
    ids: Callable[[], Int32[np.ndarray, "h w"]] | None = None
    pose: Float64[np.ndarray, "4 4"] | None = None


@dataclass(frozen=True)
class Rollout:
    """One rollout. `shots[camera][t]` are its images, `roles` ids of masks by what they do (see `jsonl.Line`)."""

    name: str
    success: bool
    instruction: str
    shots: Mapping[str, Mapping[int, CameraShot]]
    roles: Mapping[str, frozenset[int]] = field(default_factory=dict)
    failed_at: int | None = None
    factor: str | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Evaluation:
    """All rollouts, and in sentences what the source does not say."""

    rollouts: tuple[Rollout, ...]
    notes: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[Rollout, ...]:
        """Those that failed."""
        return tuple(one for one in self.rollouts if not one.success)


def checked(path: Path, evaluation: Evaluation) -> Evaluation:
    """The evaluation, if there is any rollout in it. Raises BadInput."""
    if not evaluation.rollouts:
        raise BadInput(path, "rollouts", found="none", expected="one or more")
    return evaluation


def filmed(path: Path) -> Mapping[int, CameraShot]:
    """The frames of a video, decoded when asked for. Raises BadInput."""
    episode = registry.adapter("video").read(path.parent, path.stem)
    view: CameraView = next(iter(episode.views.values()))
    return {t: CameraShot(partial(view.rgb, t)) for t in range(episode.length)}
