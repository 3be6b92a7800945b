"""What long work tells of itself."""

import pytest

from rpaug.core import progress


def test_a_stage_that_goes_on_is_passed_on_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each stage's start and end is, and what is between a few times a second."""
    clock, heard = iter(range(1000)), []
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock) * progress.EVERY / 10)
    with progress.heard(progress.seldom(lambda told: heard.append((told["stage"], told["done"])))):
        progress.told("e", "reading")
        for done in range(1, 31):
            progress.told("e", "making frames", done, 30)
        progress.told("e", progress.FINISHED)
    assert heard[0] == ("reading", 0)
    assert heard[-2:] == [("making frames", 30), (progress.FINISHED, 0)]
    between = [done for stage, done in heard if stage == "making frames"]
    assert between == [1, 11, 21, 30]
