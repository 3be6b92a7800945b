"""RVT's and LeRobot's evaluation folders, as their own code lays them out."""

import json
from pathlib import Path

import pytest
from rollouts import video

from rpaug.core.errors import BadInput
from rpaug.diagnosis import read

HEAD = "task,success rate,length,total_transitions\n"


def rvt(folder: Path, rate: str = "50.0") -> Path:
    for how in ("success", "fail"):
        video(folder / "videos" / f"push_buttons_{how}_0.mp4", [10, 20, 30, 40])
    (folder / "eval_results.csv").write_text(f"{HEAD}push_buttons,{rate},4.5,9\n")
    return folder


def test_rvt_is_read(tmp_path: Path) -> None:
    found = read(rvt(tmp_path), camera="front")
    assert [(one.name, one.success) for one in found.rollouts] == [
        ("push_buttons/fail_0", False),
        ("push_buttons/success_0", True),
    ]
    assert found.rollouts[0].instruction == "push buttons"
    shots = found.rollouts[0].shots["front"]
    assert len(shots) == 4
    assert abs(int(shots[0].image()[60, 60, 0]) - 10) < 12
    assert not found.notes


def test_rvts_table_and_videos_that_disagree_are_told(tmp_path: Path) -> None:
    assert "some are missing" in read(rvt(tmp_path, "80.0")).notes[0]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (HEAD, "rows"),
        (HEAD + "../x,50,1,1\n", "task"),
        (HEAD + "a,lots,1,1\n", "success rate"),
        (HEAD + "a,nan,1,1\n", "success rate"),
        (HEAD + "a,50,1,1\n", "videos"),
        ("", "rows"),
    ],
)
def test_a_wrong_table_is_told(tmp_path: Path, table: str, words: str) -> None:
    (tmp_path / "eval_results.csv").write_text(table)
    with pytest.raises(BadInput) as caught:
        read(tmp_path)
    assert caught.value.field == words


def lerobot(folder: Path, info: object) -> Path:
    for name in ("eval_episode_0.mp4", "pusht_0/eval_episode_0.mp4", "pusht_0/eval_episode_1.mp4"):
        video(folder / "videos" / name, [10, 30])
    (folder / "eval_info.json").write_text(json.dumps(info))
    return folder


def test_lerobots_several_tasks_are_read(tmp_path: Path) -> None:
    paths = [f"/elsewhere/run/videos/pusht_0/eval_episode_{n}.mp4" for n in range(2)]
    metrics = {"successes": [True, False, True], "sum_rewards": [1, 0, 1], "video_paths": paths}
    info = {"per_task": [{"task_group": "pusht", "task_id": 0, "metrics": metrics}], "overall": {}}
    found = read(lerobot(tmp_path, info), camera="front")
    assert [(one.name, one.success) for one in found.rollouts] == [
        ("pusht_0/0", True),
        ("pusht_0/1", False),
    ]
    assert "1 rollouts have no video" in found.notes[0]


def test_lerobots_one_environment_is_read(tmp_path: Path) -> None:
    info = {
        "per_episode": [{"episode_ix": 0, "success": False, "seed": 1, "max_reward": 0.0}],
        "aggregated": {},
        "video_paths": ["outputs/eval/videos/eval_episode_0.mp4"],
    }
    assert [one.success for one in read(lerobot(tmp_path, info)).rollouts] == [False]


@pytest.mark.parametrize(
    "info",
    [
        {},
        [],
        {"per_episode": [{"success": "maybe"}]},
        {"per_task": [{"task_group": "x"}]},
        {"per_episode": [{"success": True}], "video_paths": ["/etc/passwd"]},
        {"per_episode": [{"success": True}], "video_paths": ["../../x.mp4"]},
        {"per_episode": [{"success": True}]},
    ],
)
def test_a_wrong_info_is_told(tmp_path: Path, info: object) -> None:
    with pytest.raises(BadInput, match=r"eval_info\.json"):
        read(lerobot(tmp_path, info))


def test_a_folder_of_nothing_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="one JSONL file"):
        read(tmp_path)
