"""What someone tries first: version, help, a wrong path, a folder above datasets, Ctrl-C."""

import errno
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rpaug import __version__
from rpaug.cli import app
from rpaug.pipeline import augment as pipeline
from rpaug.pipeline import recipe
from rpaug.pipeline.recipe import Recipe

GOOD = "version: 1\nedits:\n  - {op: recolor, target: {handle: 300}, color: '#2040ff'}\n"


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    return done.exit_code, done.stdout, done.stderr


def test_version_and_help() -> None:
    assert run("--version") == (0, f"rpaug {__version__}\n", "")
    for given in (["-h"], ["inspect", "-h"], ["assets", "-h"], ["assets", "ls", "-h"]):
        code, out, _ = run(*given)
        assert code == 0
        assert "--help" in out, given
    done = subprocess.run([sys.executable, "-m", "rpaug", "--version"], capture_output=True)
    assert done.stdout.decode() == f"rpaug {__version__}\n"


def test_the_shell_completes_commands_and_options(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_RPAUG_COMPLETE", "complete_bash")
    for words, number, found in (
        ("rpaug ins", 1, "inspect"),
        ("rpaug augment --dr", 2, "--dry-run"),
    ):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(number))
        done = subprocess.run([sys.executable, "-m", "rpaug"], capture_output=True, text=True)
        assert done.stdout.split() == [found]


def test_what_is_not_there_imports_nothing_heavy(tmp_path: Path) -> None:
    program = (
        "import sys; from typer.testing import CliRunner; from rpaug.cli import app\n"
        f"done = CliRunner().invoke(app, ['inspect', '{tmp_path / 'nowhere'}'])\n"
        "print(done.exit_code, {'torch', 'numba', 'cv2', 'mujoco', 'rpaug.pipeline'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "2 set()\n"


def test_inspect_above_several_datasets_lists_them(template: Path, tmp_path: Path) -> None:
    shutil.copytree(template, tmp_path / "here" / "first")
    assert run("convert", template, "--to", "rdt", "--out", tmp_path / "here" / "other")[0] == 0
    code, out, _ = run("inspect", tmp_path / "here")
    assert code == 0
    assert "2 datasets" in out
    assert "first: rlbench, 2 episodes" in out
    assert "other: rdt, 2 episodes" in out
    listed = json.loads(run("inspect", tmp_path / "here", "--json")[1])["datasets"]
    assert [one["layout"] for one in listed] == ["rlbench", "rdt"]


def test_colors_in_hexadecimal_are_taken_as_they_are() -> None:
    made = recipe.build(
        {"version": 1, "edits": [{"op": "recolor", "target": {"handle": 1}, "color": "#ff8000"}]}
    )
    palette: Any = made.steps[0].options[0].operator
    assert palette.color.colors == ((1.0, 128 / 255, 0.0),)
    assert palette.color.exact
    lamps: Any = Recipe.from_dict(
        {"version": 1, "edits": [{"op": "light_color", "range": ["#333", "#808080"]}]}
    )
    assert lamps.steps[0].options[0].operator.range[0] == pytest.approx((0.2, 0.2, 0.2))


def test_what_all_episodes_lack_is_told_once(template: Path, tmp_path: Path) -> None:
    (tmp_path / "recipe.yaml").write_text(GOOD.replace("300", "9999"))
    code, _, err = run(
        "augment", template, "--recipe", tmp_path / "recipe.yaml", "--out", tmp_path / "out"
    )
    assert code == 2
    assert err.count("no such instance 9999") == 1
    assert "and 1 other episode alike" in err


@pytest.mark.parametrize(
    "stop", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")]
)
def test_a_stopped_run_names_resume(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop: BaseException
) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise stop

    (tmp_path / "recipe.yaml").write_text(GOOD)
    monkeypatch.setattr(pipeline, "execute", stopped)
    code, _, err = run(
        "augment", template, "--recipe", tmp_path / "recipe.yaml", "--out", tmp_path / "out"
    )
    assert code == 2
    assert "--resume goes on" in err
