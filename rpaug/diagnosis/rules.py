"""The offline analyst: measured statistics of images weighed by rules. No model looks at anything."""

from typing import ClassVar

from rpaug.diagnosis import measure, weigh
from rpaug.diagnosis.analyst import Judged, Moments
from rpaug.diagnosis.evaluation import Evaluation
from rpaug.diagnosis.messages import KEPT, Cause
from rpaug.diagnosis.reference import Reference
from rpaug.diagnosis.remedies import WORDS


class RuleAnalyst:
    """Says which measured factor tells failed from succeeded rollouts."""

    label: ClassVar[str] = "rule-based analyst: measured image statistics, no model looked"

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    def __call__(
        self, evaluation: Evaluation, reference: Reference | None, moments: Moments
    ) -> Judged:
        """Causes by the likelihood that their distance from the recordings explains failures."""
        if reference is None:
            why = "the rule-based analyst compares with the training recordings: give --dataset"
            return Judged(notes=(why,))
        return judged(measure.table(evaluation, reference), self._seed, reference.notes)


def judged(table: measure.Table, seed: int = 0, notes: tuple[str, ...] = ()) -> Judged:
    """What the table's distances and outcomes say."""
    found = weigh.ranked(table, seed)
    causes = tuple(
        Cause(
            factor=one.factor,
            confidence=one.confidence,
            rate=one.exposed,
            detail=weigh.given(one, table),
            remedy=WORDS.get(one.factor, ""),
            spans=weigh.spans(one, table),
        )
        for one in found
        if one.confidence > KEPT / 2
    )
    return Judged(causes, tuple(found), (*notes, *table.notes))
