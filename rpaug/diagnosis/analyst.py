"""Who says why rollouts fail: what an analyst is given, and what it gives back."""

from dataclasses import dataclass
from typing import Any, Protocol

from rpaug.diagnosis.evaluation import Evaluation
from rpaug.diagnosis.messages import Cause, Measured
from rpaug.diagnosis.reference import Reference

Moments = dict[str, tuple[int, ...]]
"""Key frames by rollout."""


@dataclass(frozen=True)
class Judged:
    """What an analyst says: causes that have no edits yet, what it measured, and what it cost."""

    causes: tuple[Cause, ...] = ()
    measured: tuple[Measured, ...] = ()
    notes: tuple[str, ...] = ()
    usage: dict[str, Any] | None = None
    trace: tuple[dict[str, Any], ...] = ()


class Analyst(Protocol):
    """Judges an evaluation with failures in it. Raises RpaugError."""

    @property
    def label(self) -> str: ...

    def __call__(
        self, evaluation: Evaluation, reference: Reference | None, moments: Moments
    ) -> Judged: ...
