"""What is shown while a command works: frames of copies, stage and time left, in logs and from workers too."""

import re
from itertools import pairwise
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.cli import progress as shown
from rpaug.core import progress

RECIPE = "version: 1\ncopies: 2\nedits:\n  - {op: recolor, target: {handle: 300}, color: blue}\n"


@pytest.mark.parametrize("workers", [1, 2])
def test_a_log_is_told_frames_of_copies(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    monkeypatch.setattr(shown, "EVERY", 0.0)
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    given = ["augment", str(template), "--recipe", str(tmp_path / "recipe.yaml")]
    done = CliRunner().invoke(
        app, [*given, "--out", str(tmp_path / "out"), "--workers", str(workers)]
    )
    assert done.exit_code == 0
    lines = [line for line in done.stderr.splitlines() if line.startswith("augmenting: ")]
    assert any(re.search(r"making frames, \d+ of 16", line) for line in lines)  # two cameras of 8
    assert any("finding what is in the scene" in line for line in lines)
    assert any(line.endswith(f": {progress.WRITING}") for line in lines)
    assert any("left" in line for line in lines)
    reached = [float(line.split()[1]) for line in lines if " of 4;" in line]
    assert reached == sorted(reached)
    assert "augmenting: 4 of 4; " in lines[-1]


def test_nothing_is_told_in_json(template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shown, "EVERY", 0.0)
    assert CliRunner().invoke(app, ["inspect", str(template), "--json"]).stderr == ""
    assert (
        "finding what is in the scene" in CliRunner().invoke(app, ["inspect", str(template)]).stderr
    )


def test_converting_and_verifying_name_the_episode(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shown, "EVERY", 0.0)
    out = str(tmp_path / "out")
    told = CliRunner().invoke(app, ["convert", str(template), "--to", "rdt", "--out", out]).stderr
    assert "episode1: reading and writing" in told
    assert (
        "comparing" in CliRunner().invoke(app, ["verify", out, "--against", str(template)]).stderr
    )


def test_a_redrawn_copy_does_not_go_back_and_time_left_follows() -> None:
    now = [0.0]
    position = shown.Position("augmenting", lambda: now[0])
    position.count(0, 4)
    assert position.left == ""
    told = {"key": "a", "stage": "making frames", "total": 10}
    now[0] = 10.0
    position.hear({**told, "done": 1})
    now[0] = 30.0
    position.hear({**told, "done": 5})
    assert position.counted == "0.5 of 4"
    assert position.left == "about 3 min left"  # 3.5 copies of 50 s each
    position.hear({**told, "done": 1})  # drawn again
    assert position.counted == "0.5 of 4"
    position.hear({"key": "a", "stage": progress.COPY, "done": 1, "total": 2})
    position.hear({**told, "done": 2})
    assert position.counted == "1.2 of 4"
    position.hear({"key": "a", "stage": progress.FINISHED, "done": 0, "total": 0})
    position.count(2, 4)
    assert position.counted == "2 of 4"


def test_time_left_is_that_of_the_stage_where_parts_are_not_counted() -> None:
    now = [0.0]
    position = shown.Position("looking", lambda: now[0])
    for seconds, done in ((0.0, 40), (10.0, 60)):
        now[0] = seconds
        position.hear({"key": "a", "stage": "depth", "done": done, "total": 100})
    assert position.left == "about 20 s left of this stage"
    position.hear({"key": "a", "stage": "measuring", "done": 0, "total": 0})
    assert position.left == ""


def test_what_comes_before_the_first_frame_is_no_share_of_a_copy() -> None:
    now = [0.0]
    position = shown.Position("augmenting", lambda: now[0])
    position.count(0, 2)
    for seconds, done in ((0.0, 0), (100.0, 50)):
        now[0] = seconds
        position.hear({"key": "a", "stage": "depth, percent", "done": done, "total": 100})
    assert position.counted == "0 of 2"
    assert position.left == "about 2 min left of this stage"
    for seconds, done in ((200.0, 0), (201.0, 1), (210.0, 10)):
        now[0] = seconds
        position.hear({"key": "a", "stage": progress.FRAMES, "done": done, "total": 20})
    assert position.counted == "0.5 of 2"
    assert position.left == "about 30 s left"  # 1.5 copies, a second each frame


def test_nobody_hears_what_is_told_afterwards() -> None:
    heard: list[progress.Told] = []
    with progress.heard(heard.append):
        progress.told("a", "reading")
    progress.told("a", "reading")
    assert [one["stage"] for one in heard] == ["reading"]


def test_what_was_told_last_is_told_again_while_somebody_listens() -> None:
    heard: list[progress.Told] = []
    with progress.heard(heard.append):
        progress.again()
        progress.told("a", "reading")
        progress.told("a", progress.WRITING)
        progress.again()
    assert [one["stage"] for one in heard] == ["reading", progress.WRITING, progress.WRITING]
    with progress.heard(heard.append):
        progress.again()  # it was said to others
    assert len(heard) == 3


def test_a_run_says_that_it_goes_on_while_its_workers_say_nothing(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shown, "EVERY", 0.0)
    monkeypatch.setattr("rpaug.pipeline.workers.wait", lambda busy, seconds: [])
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    given = ["augment", str(template), "--recipe", str(tmp_path / "recipe.yaml")]
    told = CliRunner().invoke(app, [*given, "--out", str(tmp_path / "out")]).stderr
    stages = [line.rpartition("; ")[2] for line in told.splitlines()]
    assert any(one == other for one, other in pairwise(stages))
    assert "augmenting: 4 of 4; " in told


def stderr_of(monkeypatch: pytest.MonkeyPatch, *given: object) -> str:
    """What a command says of its progress where every line is shown."""
    monkeypatch.setattr(shown, "EVERY", 0.0)
    done = CliRunner().invoke(app, [*map(str, given)])
    assert done.exit_code == 0, done.output
    return done.stderr


@pytest.mark.gl
def test_recording_counts_episodes_and_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ["--frames", 12, "--size", 16, "--episodes", 2, "--out", tmp_path / "truth"]
    told = stderr_of(monkeypatch, "twin", "record", "--task", "push_button", *given)
    assert "making frames, 11 of 12" in told
    assert "recording: 1 of 2; about" in told
    assert "recording: 2 of 2" in told


def test_a_page_counts_its_episodes(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    out = tmp_path / "out"
    given = ["augment", template, "--recipe", tmp_path / "recipe.yaml", "--out", out]
    stderr_of(monkeypatch, *given)
    told = stderr_of(monkeypatch, "contact", out, "--html", tmp_path / "page.html")
    assert re.search(r"drawing: 3 of 4; about .* left", told)


def test_a_view_says_what_it_does_frame_by_frame(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = stderr_of(monkeypatch, "view", template, "--rerun", tmp_path / "a.rrd")
    assert "finding what is in the scene" in told
    assert re.search(r"left of this stage; .*writing frames, 7 of 8", told)
