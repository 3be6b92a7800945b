"""Where rollouts tell little, a diagnosis is less sure and says why."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from rpaug.diagnosis.analyst import Judged
from rpaug.diagnosis.diagnose import diagnose
from rpaug.diagnosis.evaluation import CameraShot, Evaluation, Rollout
from rpaug.diagnosis.messages import Cause, Diagnosis


class Sure:
    """An analyst that is sure of the light, whatever it sees."""

    label = "sure"

    def __init__(self, confidence: float) -> None:
        self.confidence = confidence

    def __call__(
        self, evaluation: Evaluation, reference: Any, moments: Mapping[str, Sequence[int]]
    ) -> Judged:
        cause = Cause(factor="lighting", confidence=self.confidence, rate=0.5, detail="It is dark.")
        return Judged((cause,))


def diagnosed(failed: int, succeeded: int, confidence: float) -> Diagnosis:
    shot = CameraShot(lambda: np.zeros((4, 4, 3), np.uint8))
    rollouts = [
        Rollout(f"r{n}", n >= failed, "push it", {"front": {0: shot}})
        for n in range(failed + succeeded)
    ]
    return diagnose(Evaluation(tuple(rollouts)), None, analyst=Sure(confidence))


def test_ten_rollouts_with_a_success_are_believed_as_they_are() -> None:
    found = diagnosed(9, 1, 0.81)
    assert [one.confidence for one in found.causes] == [0.81]
    assert found.notes == ()


@pytest.mark.parametrize(
    ("failed", "succeeded", "factor", "words"),
    [
        (4, 5, 0.9, "9 rollouts, fewer than 10: confidences are multiplied by 0.9"),
        (10, 0, 0.9, "every rollout failed, so none shows what succeeds"),
        (9, 0, 0.81, "every rollout failed"),
    ],
)
def test_confidence_is_lowered_and_the_reason_said(
    failed: int, succeeded: int, factor: float, words: str
) -> None:
    sure = diagnosed(failed, succeeded, 1.0)
    assert [one.confidence for one in sure.causes] == pytest.approx([factor])
    assert any(words in note for note in sure.notes)
    unsure = diagnosed(failed, succeeded, 0.85)
    assert unsure.verdict == "no cause found"
    assert unsure.recipe is None


def test_hardly_any_rollouts_name_no_cause() -> None:
    found = diagnosed(2, 1, 1.0)
    assert found.causes == ()
    assert any(
        "3 rollouts, fewer than 10: confidences are multiplied by 0.3" in n for n in found.notes
    )
