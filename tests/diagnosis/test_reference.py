"""A rollout is held against the recordings of its own task."""

from pathlib import Path

import numpy as np
import pytest

from rpaug import twin
from rpaug.diagnosis import measure, reference
from rpaug.diagnosis.evaluation import CameraShot, Evaluation, Rollout
from rpaug.diagnosis.reference import Reference

TASKS = ("push_button", "stack_cups")


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    root = tmp_path_factory.mktemp("two") / "tasks"
    for task in TASKS:
        twin.record(task, 5, root, size=96, frames=20, episodes=3)
    return reference.learn(root)


def rollouts(usual: Reference, task: int, instruction: str) -> tuple[Rollout, ...]:
    """What a task's recordings show at first, as rollouts under that instruction."""
    plate = list(usual.tasks.values())[task]["front"]
    return tuple(
        Rollout(
            f"{task}-{n}",
            True,
            instruction,
            {"front": {0: CameraShot(lambda i=one.image: i, lambda i=one.ids: i)}},  # type: ignore[misc]
            one.roles,
        )
        for n, one in enumerate(plate.firsts)
    )


@pytest.mark.gl
def test_tasks_are_told_apart_by_their_instructions(usual: Reference) -> None:
    assert [sorted(words & {"button", "cups"}) for words in usual.tasks] == [["button"], ["cups"]]
    button, cups = usual.tasks.values()
    assert usual.of("press the red Button!") is button
    assert usual.of("stack the other cups") is cups
    assert usual.of("") is usual.of("grasp it") is usual.plates
    assert [len(one["front"].firsts) for one in (button, cups, usual.plates)] == [3, 3, 6]


@pytest.mark.gl
def test_what_one_task_is_about_is_strange_in_another(usual: Reference) -> None:
    right = rollouts(usual, 0, "push the button")
    wrong = rollouts(usual, 0, "stack the cups")
    away = measure.table(Evaluation(right + wrong), usual).away["object color"]
    assert np.isfinite(away).sum() >= 4  # a button is small
    assert np.nanmax(away[:3]) < 2
    assert np.nanmin(away[3:]) > 8


@pytest.mark.gl
def test_folders_of_one_task_are_one(tmp_path: Path) -> None:
    for name in ("one", "two"):
        twin.record("push_button", 5, tmp_path / "all" / name, size=64, frames=20, episodes=1)
    assert reference.learn(tmp_path / "all").tasks == {}
