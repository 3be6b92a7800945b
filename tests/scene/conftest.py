"""Episodes that several tests of the scene package look at."""

from pathlib import Path

import boxes
import pytest
from analysed import analysed

from rpaug.core.registry import adapter
from rpaug.core.types import Scene

EPISODES = "rlbench_open_drawer/all_variations/episodes"


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
