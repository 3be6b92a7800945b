"""What a diagnosis says, as plain values."""

from typing import Any, Literal, get_args

from pydantic import Field

from rpaug.language.messages import Message

Factor = Literal[
    "object position",
    "object color",
    "object texture",
    "object size",
    "lighting",
    "table",
    "background",
    "distractor",
    "camera",
    "other",
]
FACTORS: tuple[Factor, ...] = get_args(Factor)
KEPT = 0.8  # a cause is kept if its confidence is above


class Measured(Message):
    """How far one factor lies from the training recordings, in failed and in succeeded rollouts.

    `failed` and `succeeded` are medians of the distance, in standard deviations of the recordings. `effect` is Cliff's
    delta: how much likelier a failed rollout lies further off than a succeeded one, -1 to 1. `exposed` is the failure
    rate among the rollouts beyond `threshold`, `spared` that of the others. `gain` is the logarithm of the likelihood
    ratio of that split, `confidence` how surely that is more than chance (`weigh`).
    """

    factor: Factor
    failed: float
    succeeded: float
    effect: float
    threshold: float
    exposed: float
    spared: float
    gain: float
    confidence: float


class Cause(Message):
    """One reason for failures. `rate` is how often rollouts that meet it fail for it: the remedy's probability.

    `remedy` is in words; `edits` is what they came to, empty where no edit of a recording can help, which `note` says.
    `named` tells of a model's answers in how many of the failed rollouts that it saw it named the cause. `spans` are
    low and high of the factor's measured differences (`sight.NUMBERS`) in those failures, which edits then draw from.
    """

    factor: Factor
    confidence: float = Field(ge=0, le=1)
    rate: float = Field(ge=0, le=1)
    detail: str
    remedy: str = ""
    edits: tuple[dict[str, Any], ...] = ()
    note: str = ""
    named: str = ""
    spans: tuple[tuple[float, float], ...] = ()


class Diagnosis(Message):
    """What came of an evaluation. `analyst` says who judged and by what; `recipe` is None if nothing can be run."""

    version: Literal[1] = 1
    verdict: Literal["nothing to fix", "causes found", "no cause found"]
    analyst: str
    rollouts: int
    failures: int
    causes: tuple[Cause, ...] = ()
    measured: tuple[Measured, ...] = ()
    notes: tuple[str, ...] = ()
    recipe: dict[str, Any] | None = None
    key_frames: dict[str, tuple[int, ...]] = {}
    usage: dict[str, Any] = {}
    trace: tuple[dict[str, Any], ...] = ()

    @property
    def ranked(self) -> tuple[Factor, ...]:
        """All factors that were measured or named, the likeliest cause first."""
        kept = [cause.factor for cause in self.causes]
        rest = [one.factor for one in self.measured if one.factor not in kept]
        return (*kept, *rest)
