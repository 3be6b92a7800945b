"""When a fit has done enough: views it never saw stop improving, or the recorded ones are shown well enough."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Kind = Literal["heldout", "fidelity"]


@dataclass(frozen=True)
class StopCheck:
    """Where a fit stood after `step` steps: PSNR in decibels (up) on what it is fitted to and on what it is not."""

    step: int
    recorded_db: float
    held_out_db: float


@dataclass(frozen=True, kw_only=True)
class Stop:
    """The rule that ends a fit early.

    `heldout` ends it once held-out views gained less than `gain` decibels within the last `patience` checks: going
    on would learn the recorded views by heart. `fidelity` ends it once recorded views reach `target`, whatever
    becomes of the others. A check is due every `every` steps. A fit that never meets its rule runs all its steps.
    """

    kind: Kind = "heldout"
    target: float = 35.0  # dB, of `fidelity`
    every: int = 100  # steps
    patience: int = 3  # checks
    gain: float = 0.05  # dB

    def due(self, step: int) -> bool:
        """True if the fit is to be checked after this many steps."""
        return step > 0 and step % self.every == 0

    def reached(self, checks: Sequence[StopCheck]) -> bool:
        """True if a fit with these checks behind it is done."""
        if self.kind == "fidelity":
            return bool(checks) and checks[-1].recorded_db >= self.target
        if len(checks) <= self.patience:
            return False
        before = max(check.held_out_db for check in checks[: -self.patience])
        lately = max(check.held_out_db for check in checks[-self.patience :])
        return lately < before + self.gain

    def best(self, checks: Sequence[StopCheck]) -> int:
        """Which check to keep: the highest by what the rule looks at, the earliest of equals.

        Raises ValueError if there are none.
        """
        held_out = self.kind == "heldout"
        scores = [check.held_out_db if held_out else check.recorded_db for check in checks]
        return scores.index(max(scores))
