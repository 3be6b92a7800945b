"""Depth as LeRobot's recorder films it: 12-bit codes in even steps of the depth, or of its logarithm.

`info` of the feature has `video.{depth_min, depth_max, shift, use_log}`, in metres (`datasets/depth_utils.py` of
huggingface/lerobot @ 7427f318). Code 0 stands for all that is at most `depth_min`: the recorder gives it to pixels
without a measurement, and it is read as none.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt16

from rpaug import BadInput

MOST = 4095
UNITS = {"m": 1.0, "mm": 0.001}


@dataclass(frozen=True)
class Scale:
    """The depths, in metres, of the codes 0 and 4095; with `use_log` steps are even in log(depth + shift)."""

    depth_min: float = 0.01
    depth_max: float = 10.0
    shift: float = 3.5
    use_log: bool = True

    def metres(self, codes: UInt16[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
        """Depth of codes, 0 where nothing was measured."""
        low, high = self._ends()
        along = low + codes.astype(np.float64) / MOST * (high - low)
        depth = np.exp(along) - self.shift if self.use_log else along
        return np.where(codes == 0, 0, depth).astype(np.float32)

    def codes(self, metres: Float32[np.ndarray, "h w"]) -> UInt16[np.ndarray, "h w"]:
        """The nearest codes of depths; what lies beyond the ends gets theirs."""
        low, high = self._ends()
        held = np.clip(metres.astype(np.float64), self.depth_min, self.depth_max)
        along = np.log(held + self.shift) if self.use_log else held
        return np.rint((along - low) / (high - low) * MOST).astype(np.uint16)

    def _ends(self) -> tuple[float, float]:
        ends = self.depth_min, self.depth_max
        return (
            (float(np.log(ends[0] + self.shift)), float(np.log(ends[1] + self.shift)))
            if self.use_log
            else ends
        )


def scale(where: Path, key: str, feature: Mapping[str, Any]) -> Scale:
    """What is said of a depth video; the recorder's own values where nothing is. Raises BadInput."""
    about = feature.get("info") or {}
    stated = {
        name: about[f"video.{name}"]
        for name in vars(Scale())
        if about.get(f"video.{name}") is not None
    }
    given = Scale(**stated)
    numbers = (given.depth_min, given.depth_max, given.shift)
    finite = all(
        isinstance(one, (int, float)) and not isinstance(one, bool) and abs(one) < 1e6
        for one in numbers
    )
    if (
        not finite
        or not isinstance(given.use_log, bool)
        or not 0 <= given.depth_min < given.depth_max
        or (given.use_log and given.depth_min + given.shift <= 0)
    ):
        found, expected = repr(stated)[:80], "depths that rise, in metres"
        raise BadInput(where, f"features.{key}.info", found=found, expected=expected)
    return given


def unit(feature: Mapping[str, Any]) -> float:
    """Metres of one unit that a feature's depth was recorded in, and its statistics are in; 0 where none is stated."""
    return UNITS.get(str((feature.get("info") or {}).get("depth_unit")), 0.0)
