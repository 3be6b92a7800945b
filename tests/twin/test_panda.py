"""The arm's kinematics: forward against the derivative, inverse against forward."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.twin.panda import HIGHEST, HOME, LOWEST
from rpaug.twin.tabletop import ARM

inside = st.lists(st.floats(0.1, 0.9), min_size=7, max_size=7).map(
    lambda share: LOWEST + np.array(share) * (HIGHEST - LOWEST)
)


def test_home_is_rlbenchs_start():
    # The recorded demonstrations start at x = 0.278, y = -0.008, looking down: ours within 2 cm.
    tip = ARM.tip(HOME)
    np.testing.assert_allclose(tip[:3, 3], [0.278, -0.008, 1.472], atol=0.025)
    assert tip[2, 2] < -0.96
    np.testing.assert_allclose(tip[:3, 1], [0, 1, 0], atol=1e-3)


@settings(max_examples=30, deadline=None)
@given(inside)
def test_jacobian_is_the_derivative(q):
    step = 1e-6
    for joint, column in enumerate(ARM.jacobian(q).T):
        d = np.eye(7)[joint] * step
        before, after = ARM.tip(q - d), ARM.tip(q + d)
        spin = (after - before)[:3, :3] / (2 * step) @ ARM.tip(q)[:3, :3].T
        np.testing.assert_allclose(column[:3], (after - before)[:3, 3] / (2 * step), atol=1e-8)
        np.testing.assert_allclose(column[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-0.3, 0.3), min_size=7, max_size=7))
def test_solve_comes_back_to_the_pose(offset):
    target = ARM.tip(HOME + np.array([0, 0.3, 0, -0.8, 0, 0.6, 0]) + offset)
    q = ARM.solve(target, HOME)
    np.testing.assert_allclose(ARM.tip(q), target, atol=2e-9)
    assert (q >= LOWEST).all()
    assert (q <= HIGHEST).all()


def test_out_of_reach_is_an_error():
    far = ARM.tip(HOME)
    far[:3, 3] = 2.0, 0.0, 1.0
    with pytest.raises(ValueError, match="cannot reach"):
        ARM.solve(far, HOME)
