"""Few frames that tell how a rollout went: its first, those around the failure, its last, by how images change."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float32

from rpaug.diagnosis.evaluation import Rollout

MOST = 4
SMALL = 32  # pixels a side of the images that are compared
SEEN = 120  # frames of a rollout that are looked at
STIR = 0.25  # of the strongest change from frame to frame: less is standing still


def select(rollout: Rollout, most: int = MOST) -> tuple[int, ...]:
    """At most `most` frames, in order.

    The first and the last; where it went wrong (`failed_at`, else the last frame with much change: what comes after a
    missed grasp is standing still or going back); then, one by one, the frame least like those taken already.
    """
    camera = max(rollout.shots, key=lambda name: len(rollout.shots[name]), default=None)
    times = sorted(rollout.shots[camera]) if camera is not None else []
    if len(times) <= most or camera is None:
        return tuple(times)
    seen = [times[i] for i in np.unique(np.linspace(0, len(times) - 1, SEEN).round().astype(int))]
    small = np.stack([_small(rollout.shots[camera][t].image()) for t in seen])
    picked = [0, len(seen) - 1]
    wrong = _failure(seen, small, rollout.failed_at)
    if wrong not in picked:
        picked.append(wrong)
    while len(picked) < most:
        apart = np.min([np.abs(small - small[i]).mean(1) for i in picked], 0)
        apart[picked] = -1
        picked.append(int(apart.argmax()))
    return tuple(seen[i] for i in sorted(picked[:most]))


def _failure(seen: Sequence[int], small: Float32[np.ndarray, "t n"], given: int | None) -> int:
    """Where it went wrong, as a row of `small`."""
    if given is not None:
        return int(np.abs(np.array(seen) - given).argmin())
    change = np.abs(np.diff(small, axis=0)).mean(1)
    return int(np.flatnonzero(change >= STIR * change.max())[-1]) + 1


def _small(image: np.ndarray) -> Float32[np.ndarray, "n"]:
    return (
        cv2.resize(image, (SMALL, SMALL), interpolation=cv2.INTER_AREA).astype(np.float32).ravel()
    )
