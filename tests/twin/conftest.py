"""Recordings that several tests look at, made once."""

import pytest

from rpaug import twin


@pytest.fixture(scope="session")
def drawer() -> twin.Take:
    return twin.perform("open_drawer", 3, frames=16)


@pytest.fixture(scope="session")
def block() -> twin.Take:
    return twin.perform("pick_block", 5, frames=24)
