"""`rpaug cache`: listing what is kept and removing some of it, from the outside."""

import json
import os
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import cache
from rpaug.core.files import write_atomic

HELD = (("kernels", "splat-0", 30, 1), ("videos", "abc1", 20, 40), ("weights", "w.npz", 10, 90))


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RPAUG_CACHE", str(tmp_path))
    for kind, name, size, days in HELD:
        write_atomic(tmp_path / kind / name, bytes(size))
        long_ago = time.time() - 86400 * days
        os.utime(tmp_path / kind / name, (long_ago, long_ago))
    return tmp_path


def run(*arguments: str) -> tuple[int, str]:
    made = CliRunner().invoke(app, ["cache", *arguments])
    return made.exit_code, made.output


def left() -> list[str]:
    return sorted(entry.name for entry in cache.entries())


def test_ls_names_everything_and_the_folder(root: Path) -> None:
    code, text = run("ls", "--json")
    told = json.loads(text)
    assert code == 0
    assert told["folder"] == str(root)
    assert told["bytes"] == 60
    assert told["limit_bytes"] == 20_000_000_000
    assert [(one["kind"], one["name"]) for one in told["entries"]] == [held[:2] for held in HELD]
    code, text = run("ls")
    assert "3 things" in text
    assert "splat-0" in text


def test_ls_of_a_kind_and_of_what_is_not_there() -> None:
    code, text = run("ls", "videos", "--json")
    assert [one["name"] for one in json.loads(text)["entries"]] == ["abc1"]
    code, text = run("ls", "films", "--json")
    assert code == 2
    assert "kernels, videos, weights" in json.loads(text)["error"]


def test_rm_by_kind_and_by_the_beginning_of_a_name() -> None:
    code, text = run("rm", "kernels", "ab", "--json")
    assert code == 0
    assert sorted(one["name"] for one in json.loads(text)["removed"]) == ["abc1", "splat-0"]
    assert left() == ["w.npz"]


def test_rm_of_a_wrong_name_removes_nothing() -> None:
    assert run("rm", "videos", "zzz")[0] == 2
    assert len(left()) == 3


def test_rm_needs_to_be_told_what() -> None:
    code, text = run("rm", "--json")
    assert code == 2
    assert "--older-than" in json.loads(text)["error"]
    assert len(left()) == 3


def test_what_was_fetched_goes_by_its_name_or_with_all() -> None:
    assert run("rm", "--older-than", "30")[0] == 0
    assert left() == ["splat-0", "w.npz"]
    assert run("rm", "weights", "--older-than", "100")[0] == 0
    assert left() == ["splat-0", "w.npz"]
    assert run("rm", "--all")[0] == 0
    assert left() == []


def test_what_cannot_be_removed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(entry: cache.Entry) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(cache, "remove", refuse)
    code, text = run("rm", "videos", "--json")
    assert code == 1
    assert json.loads(text) == {"removed": [], "kept": {"videos/abc1": "Permission denied"}}
