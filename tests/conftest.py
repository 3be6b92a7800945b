"""Shared fixtures: a small exact dataset in RLBench's format, real samples where they are at hand, analysed scenes."""

import os
from pathlib import Path

import boxes
import pytest
from analysed import analysed
from rolling import demonstration

from rpaug.core.registry import adapter
from rpaug.core.types import Scene

for name in ("RPAUG_LLM_URL", "RPAUG_LLM_MODEL", "RPAUG_LLM_KEY"):
    os.environ.pop(name, None)  # no test asks the model that a developer has settled on
os.environ["XDG_CONFIG_HOME"] = os.devnull
EPISODES = "rlbench_open_drawer/all_variations/episodes"


@pytest.fixture(scope="session")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two episodes of `roll_ball` in PerAct's layout. Not to be written to."""
    root = tmp_path_factory.mktemp("template")
    for number, length in enumerate((8, 6)):
        key = f"roll_ball/all_variations/episodes/episode{number}"
        adapter("rlbench").write(demonstration(length), root, key, dict)
    return root


@pytest.fixture
def dataset(template: Path, tmp_path: Path) -> Path:
    """A copy of the template that a test may spoil."""
    import shutil

    return Path(shutil.copytree(template, tmp_path / "dataset"))


@pytest.fixture(scope="session")
def samples() -> Path:
    """The folder of real recordings, or a skip."""
    folder = os.environ.get("RPAUG_TEST_DATA")
    if not folder:
        pytest.skip("RPAUG_TEST_DATA names no folder of real recordings")
    return Path(folder)


@pytest.fixture(scope="session", params=["episode0", "episode5"])
def real(request: pytest.FixtureRequest, samples: Path) -> Scene:
    """A real RLBench open_drawer recording, with its bodies and roles."""
    folder = samples / EPISODES / request.param
    return analysed(adapter("rlbench").read(folder.parent, request.param))


@pytest.fixture(scope="session")
def placed() -> tuple[boxes.World, Scene]:
    world = boxes.pick_and_place()
    return world, analysed(world.episode())


@pytest.fixture(scope="session")
def pushed() -> tuple[boxes.World, Scene]:
    world = boxes.push()
    return world, analysed(world.episode())
