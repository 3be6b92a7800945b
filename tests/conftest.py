"""Shared fixtures: a small exact dataset in RLBench's format, real samples where they are at hand, analysed scenes."""

import hashlib
import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import boxes
import pytest
from analysed import analysed
from rolling import demonstration

from rpaug.core.registry import adapter
from rpaug.core.types import Episode, Scene
from rpaug.scene import build

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


@pytest.fixture(scope="module")
def tracked_once() -> Iterator[None]:
    """Find how instances move once an episode in a file whose tests ask for nothing of how that is found. Episodes are
    told apart by their content: one that is spoilt or edited is tracked anew."""
    found: dict[tuple[str, str], Any] = {}
    track = build._tracked

    def tracked(episode: Episode, arms: tuple[Any, ...]) -> Any:
        key = content(episode), repr(arms)
        if key not in found:
            found[key] = track(episode, arms)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "_tracked", tracked)
        yield


def content(episode: Episode) -> str:
    """Hash of all that tracking may read."""
    digest = hashlib.sha256(pickle.dumps((episode.robot, episode.descriptions, episode.length)))
    for name, view in sorted(episode.views.items()):
        digest.update(pickle.dumps((name, view.camera)))
        for read in (view.rgb, view.depth, view.ids):
            for t in range(episode.length if read else 0):
                digest.update(pickle.dumps(read(t)))
    return digest.hexdigest()
