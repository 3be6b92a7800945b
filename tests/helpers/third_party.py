"""Packages of examples/, installed by pip into folders of their own, and commands that find them there."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
USE = """
import json, sys
from typer.testing import CliRunner
from rpaug.cli import app
for words in json.loads(sys.argv[1]):
    done = CliRunner().invoke(app, words)
    print(json.dumps([done.exit_code, done.output]))
"""
HOLD = "import os, sys, pytest; sys.exit(pytest.main(['-q', '-c', os.devnull, '--rootdir', sys.argv[1], sys.argv[1]]))"


def install(name: str, under: Path) -> Path:
    """The folder into which pip put a package of examples/."""
    folder = under / name
    shutil.copytree(ROOT / "examples" / name, folder)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    target = folder / "installed"
    subprocess.run([*pip, *offline, "--target", target, folder], check=True)
    return target


def run(installed: Path, code: str, argument: str) -> str:
    """What Python code prints where an installed package is found."""
    path = os.pathsep.join(map(str, (installed, ROOT, ROOT / "tests/helpers")))
    done = subprocess.run(
        [sys.executable, "-c", code, argument],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def commands(installed: Path, given: list[list[str]]) -> list[tuple[int, str]]:
    """Exit code and output of each command of rpaug."""
    return [tuple(json.loads(line)) for line in run(installed, USE, json.dumps(given)).splitlines()]


def own_tests(installed: Path, name: str, folder: Path) -> str:
    """What pytest says of the package's own tests."""
    shutil.copy(ROOT / f"examples/{name}/test_{name}.py", folder)
    return run(installed, HOLD, str(folder))
