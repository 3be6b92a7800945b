"""A task that roams is the same task elsewhere: what the gripper does to its things stays as it was."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core import geometry
from rpaug.core.errors import RpaugError
from rpaug.twin import tabletop
from rpaug.twin.look import Look
from rpaug.twin.panda import HOME
from rpaug.twin.record import stage
from rpaug.twin.roaming import APART, FIELD, TURN, occupied
from rpaug.twin.staging import LOOSE, StagedTask
from rpaug.twin.tasks import TASKS

FAR = 0.08


def strewn(job: StagedTask) -> list[str]:
    return [
        name
        for name in LOOSE
        if name not in (job.manipulated, job.receiver) and name in job.placing
    ]


@settings(max_examples=5, deadline=None)
@given(st.sampled_from(sorted(TASKS)), st.integers(0, 1000))
def test_the_gripper_does_the_same_to_the_things_of_the_task(task: str, seed: int) -> None:
    here, _, _ = stage(task, seed, 0, Look())
    there, _, _ = stage(task, seed, 0, Look(), FAR)
    motion = there.placing[here.manipulated] @ geometry.inverse(here.placing[here.manipulated])
    assert (
        np.abs(motion[2] - [0, 0, 1, 0]).max() < 1e-9
    )  # turned about the vertical, as high as before
    assert np.arccos(np.clip(motion[0, 0], -1, 1)) <= TURN
    for name in here.placing.keys() - set(strewn(here)):
        np.testing.assert_allclose(there.placing[name], motion @ here.placing[name], atol=1e-9)
    q = HOME
    for before, after in zip(here.script, there.script, strict=True):
        if before.tip is not None:
            assert after.tip is not None
            np.testing.assert_allclose(after.tip, motion @ before.tip, atol=1e-9)
            q = tabletop.ARM.solve(after.tip, q)  # raises for what is out of reach
        if before.about is not None:
            assert after.about is not None
            np.testing.assert_allclose(
                after.about.at, geometry.transform(motion, before.about.at), atol=1e-9
            )


@settings(max_examples=5, deadline=None)
@given(st.sampled_from(sorted(TASKS)), st.integers(0, 1000))
def test_other_things_lie_clear_of_all_and_upright(task: str, seed: int) -> None:
    job, _, _ = stage(task, seed, 0, Look(), FAR)
    names = strewn(job)
    assert names
    for name in names:
        pose = job.placing[name]
        others = {other: at for other, at in job.placing.items() if other != name}
        gaps = [np.linalg.norm(pose[:2, 3] - spot) for spot in occupied(others, job.script)]
        assert min(gaps) >= APART
        assert np.all(pose[:2, 3] >= FIELD[0])
        assert np.all(pose[:2, 3] <= FIELD[1])
        assert pose[2, 3] == pytest.approx(tabletop.TABLE + tabletop.resting_height(name))
        np.testing.assert_allclose(pose[:3, 2], [0, 0, 1], atol=1e-12)


def test_layouts_differ_and_come_again() -> None:
    first, second, again = (stage("put_in_box", 4, n, Look(), FAR)[0] for n in (0, 1, 0))
    assert first.placing.keys() == again.placing.keys()
    for name, pose in first.placing.items():
        np.testing.assert_array_equal(pose, again.placing[name])
        assert np.linalg.norm(pose[:2, 3] - second.placing[name][:2, 3]) > 1e-3


def test_what_bends_cannot_roam() -> None:
    with pytest.raises(RpaugError, match="towel bends"):
        stage("push_towel", 0, 0, Look(), FAR)
