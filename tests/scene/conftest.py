"""Episodes that several tests of the scene package look at."""

import os
from pathlib import Path

import boxes
import pytest
import recorded
from analysed import analysed

from rpaug.types import Scene


@pytest.fixture(scope="session", params=["episode0", "episode5"])
def real(request: pytest.FixtureRequest) -> Scene:
    """A real RLBench open_drawer recording, with its bodies and roles."""
    data = os.environ.get("RPAUG_TEST_DATA")
    if not data:
        pytest.skip("RPAUG_TEST_DATA is not set: no real recordings here")
    folder = Path(data) / "rlbench_open_drawer/all_variations/episodes" / request.param
    return analysed(recorded.read(folder))


@pytest.fixture(scope="session")
def placed() -> tuple[boxes.World, Scene]:
    world = boxes.pick_and_place()
    return world, analysed(world.episode())


@pytest.fixture(scope="session")
def pushed() -> tuple[boxes.World, Scene]:
    world = boxes.push()
    return world, analysed(world.episode())
