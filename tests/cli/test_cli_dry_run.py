"""What `--dry-run` prints, however many episodes there are."""

import json
import os
import shutil
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from runs import GROUP
from test_cli import run

import rpaug
from rpaug.cli import dry_run
from rpaug.pipeline import augment, plan, prepare, recipe
from tools.bench import dry_run as bench

RECIPE = "version: 1\nedits:\n  - {op: light_color}\n"


def test_unreadable_episodes_and_other_parts_do_not_count(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    shutil.copytree(dataset / GROUP / "episode0", dataset / GROUP / "episode2")
    (dataset / GROUP / "episode0/low_dim_obs.pkl").write_bytes(b"")
    given = ("augment", dataset, "--recipe", tmp_path / "r.yaml", "--out", tmp_path / "out")
    code, out, _ = run(*given, "--dry-run", "--json", "--shard", "1/2")
    told = json.loads(out)
    assert code == 1
    assert [one["episode"] for one in told["plans"]] == [f"{GROUP}/episode2"]
    assert list(told["unreadable"]) == [f"{GROUP}/episode0"]
    code, out, err = run(*given, "--dry-run", "--shard", "1/2")
    assert (code, "1 copies" in out, f"would skip {GROUP}/episode0" in err) == (1, True, True)
    shutil.rmtree(dataset / GROUP / "episode2")
    code, out, _ = run(*given, "--dry-run", "--json", "--shard", "1/2")
    assert (code, json.loads(out)["plans"]) == (2, [])


def test_it_takes_no_output_and_a_run_does(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    given = ("augment", dataset, "--recipe", tmp_path / "r.yaml")
    code, out, _ = run(*given, "--dry-run")
    assert (code, "Nothing was written" in out) == (0, True)
    for more in ((), ("--dry-run", "--resume")):
        code, _, err = run(*given, *more)
        assert code == 2
        assert "--out: missing" in err


def test_what_is_assumed_of_one_episode_after_the_other_is_said_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    known = list[str]()
    for key, assumed in (("a", ["a level support", "77 px"]), ("b", ["a level support", "80 px"])):
        one = {
            "episode": key,
            "frames": 3,
            "carriers": {"front": "tier 0"},
            "bodies": False,
            "estimate": {"seconds": 1, "megabytes": 1},
            "assumed": assumed,
        }
        known = dry_run._tell(one, [], known)
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert [line.split(":")[0] for line in lines] == ["a", "a level support", "77 px", "b", "80 px"]


def test_what_is_said_of_several_cameras_is_said_once() -> None:
    lines = ["front: 77 px", "side: 77 px", "side: dark", "a table: seen"]
    assert dry_run._of_several(lines, ["front", "side"]) == [
        "front, side: 77 px", "side: dark", "a table: seen",
    ]  # fmt: skip


def test_a_warning_of_several_episodes_is_counted_at_the_end(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warning = (
        "recolor: no such thing; there is: 1 (red)",
        "recolor: no such thing; there is: 2 (tan)",
    )

    def planned(episode: rpaug.Episode, *rest: object) -> plan.Plan:
        made = plan.make([], episode)
        return replace(made, warnings=(warning[int(episode.key[-1])],))

    (tmp_path / "r.yaml").write_text(RECIPE)
    monkeypatch.setattr(prepare, "planned", planned)
    given = ("augment", dataset, "--recipe", tmp_path / "r.yaml", "--out", tmp_path / "out")
    code, _, err = run(*given, "--dry-run")
    assert code == 0
    assert err.count("no such thing") == 2
    assert "in 2 of 2 episodes: recolor: no such thing\n" in err


def test_episodes_of_which_the_same_is_said_are_folded(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(RECIPE)
    for number in range(2, 12):
        shutil.copytree(dataset / GROUP / "episode0", dataset / GROUP / f"episode{number}")
    for number in range(7, 12):
        (dataset / GROUP / f"episode{number}/low_dim_obs.pkl").write_bytes(b"")
    given = ("augment", dataset, "--recipe", tmp_path / "r.yaml", "--out", tmp_path / "out")
    code, out, err = run(*given, "--dry-run")
    assert code == 1
    listed = [line for line in out.splitlines() if line.startswith(GROUP) and " frames; " in line]
    assert len(listed) == dry_run.SHOWN
    assert f"{GROUP}/episode0: and 4 other episodes alike (--json lists all)" in out
    (skipped,) = [line for line in err.splitlines() if "would skip" in line]
    assert " and 2 more: " in skipped
    assert "7 copies" in out
    _, out, _ = run(*given, "--dry-run", "--json")
    assert len(json.loads(out)["plans"]) == 7
    assert len(json.loads(out)["unreadable"]) == 5


@pytest.mark.parametrize("as_json", [False, True])
def test_memory_does_not_grow_with_the_episodes(
    as_json: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Plans of two thousand are a megabyte of text, and more as values."""
    peak(20, as_json, monkeypatch)  # what is loaded once
    few, many = peak(200, as_json, monkeypatch), peak(2000, as_json, monkeypatch)
    assert many < few + 3e5


def peak(episodes: int, as_json: bool, monkeypatch: pytest.MonkeyPatch) -> int:
    """Bytes at most while so many are planned."""
    episode = bench.tiny()
    held = SimpleNamespace(
        adapter=SimpleNamespace(read=lambda *_: episode, episodes=lambda _: [""] * episodes),
        keys=[f"group/episode{number}" for number in range(episodes)],
        copies=range(1, 2),
        makes=lambda _: True,
        recipe=recipe.build(bench.recipe("tiny", "light_color", 1)),
        source=Path(os.devnull),
        tier=0,
        linked=False,
    )
    with Path(os.devnull).open("w") as nowhere:
        monkeypatch.setattr(augment, "check", lambda *_: None)
        monkeypatch.setattr(sys, "stdout", nowhere)
        tracemalloc.start()
        try:
            assert dry_run.print_plans(held, False, as_json) == 0
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
            monkeypatch.undo()
