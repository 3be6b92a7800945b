"""A small recording of the twin that several tests edit, with things that the robot leaves alone."""

from functools import lru_cache

import pytest

from rpaug import twin
from rpaug.core.types import Scene
from rpaug.scene.build import build


@lru_cache(1)
def take() -> twin.Take:
    return twin.perform("pick_block", 3, frames=17, size=96)


@lru_cache(1)
def scene() -> Scene:
    return build(take().episode, with_bodies=True)


def instance_id(name: str) -> int:
    return take().truth.handles[name]


gl = pytest.mark.gl
