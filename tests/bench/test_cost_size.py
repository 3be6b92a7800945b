"""The fit of what runs cost finds terms that are there, and none below nothing."""

import numpy as np

from tools.bench import cost_size

COUNTS = np.array([size.counts() for size in cost_size.FITTED])


def test_terms_are_found_again() -> None:
    terms = np.array([2.0, 0.001, 0.2, 0.0005, 0.1, 0.05])
    np.testing.assert_allclose(cost_size.fit(COUNTS, COUNTS @ terms), terms, rtol=1e-6)


def test_no_term_is_below_nothing() -> None:
    seconds = COUNTS @ np.array([2.0, 0.001, 0.2, -0.002, 0.3, 0.05])
    found = cost_size.fit(COUNTS, seconds)
    assert (found >= 0).all()
    assert np.abs(COUNTS @ found / seconds - 1).mean() < 0.1


def test_runs_that_it_is_held_against_are_none_that_it_was_fitted_to() -> None:
    assert not set(cost_size.FITTED) & set(cost_size.CHECKED)
