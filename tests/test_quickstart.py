"""The lines of the quickstart run as they stand, on small datasets of each layout."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from droid_samples import droid
from typer.testing import CliRunner
from videos import write

from rpaug import twin
from rpaug.cli import app

PAGE = Path(__file__).parent.parent / "docs/quickstart.md"
SECTIONS = dict(re.findall(r"^## (.+?)\n.*?```sh\n(.*?)```", PAGE.read_text(), re.M | re.S))


def run(line: str) -> None:
    done = CliRunner().invoke(app, line.split()[1:])
    assert done.exit_code == 0, (line, done.output)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "twin"
    twin.record("open_drawer", 0, folder, size=64, frames=11)
    return folder


def converted(recorded: Path, layout: str) -> None:
    run(f"rpaug convert {recorded} --to {layout} --out my_{layout} --fps 10")


DATASETS: dict[str, Callable[[Path], object]] = {
    "RLBench, PerAct, RVT": lambda recorded: Path("my_rlbench").symlink_to(recorded),
    "Open X-Embodiment": lambda recorded: converted(recorded, "rlds"),
    "LeRobot": lambda recorded: converted(recorded, "lerobot"),
    "RDT": lambda recorded: converted(recorded, "rdt"),
    "DROID": lambda _: droid(Path("my_droid")),
    "Ego4D and other videos": lambda _: (
        Path("my_clips").mkdir(),
        write(Path("my_clips/a.mp4"), 8),
    ),
}


def test_every_section_is_run() -> None:
    assert SECTIONS.keys() == DATASETS.keys()


@pytest.mark.parametrize("section", DATASETS)
def test_its_lines_run_as_they_stand(
    section: str, recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    DATASETS[section](recorded)
    lines = SECTIONS[section].splitlines()
    assert [line.split()[1] for line in lines][-2:] == ["augment", "verify"]
    for line in lines:
        run(line)


def test_the_package_is_found_beside_its_clone(tmp_path: Path) -> None:
    """A folder called rpaug where Python starts is the clone, not the package."""
    (tmp_path / "rpaug" / "rpaug").mkdir(parents=True)
    told = subprocess.run(
        [sys.executable, "-c", "import rpaug; print(rpaug.read.__name__)"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert told.stdout.strip() == "read", told.stderr
