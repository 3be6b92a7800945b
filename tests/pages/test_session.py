"""A session's masks: every instance that any frame of a page shows has one number, whatever the frames' order."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rpaug.pages.session import Session
from rpaug.pipeline.copies import Made

RECORDED, ADDED, LENGTH = (3, 7, 12), (40, 41, 55), 4


def session() -> Session:
    made = Session(Path())
    made.__dict__["found"] = {}, tuple(SimpleNamespace(instance_id=one) for one in RECORDED), None
    return made


def made(shown: Sequence[Sequence[int]]) -> Made:
    """What a copy is to `_numbers`: `shown[t]` are the instances that its cameras see, half of them each."""

    def view(half: int) -> Any:
        return SimpleNamespace(ids=lambda t: np.array([[0, *shown[t][half::2]]], np.int32))

    body = SimpleNamespace(mesh=object(), copy_of=None, instance_ids=frozenset(ADDED))
    views = {"front": view(0), "wrist": view(1), "color alone": SimpleNamespace(ids=None)}
    return cast(
        Made,
        SimpleNamespace(
            recorded=SimpleNamespace(views=views), scene=SimpleNamespace(bodies=(body,))
        ),
    )


SHOWN = st.lists(
    st.lists(st.sampled_from(RECORDED + ADDED), unique=True), min_size=LENGTH, max_size=LENGTH
)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(SHOWN, st.lists(st.integers(0, LENGTH - 1), min_size=1, unique=True))
def test_what_any_frame_shows_has_a_number(shown: list[list[int]], frames: list[int]) -> None:
    numbers = session()._numbers(made(shown), frames)
    seen = {one for t in frames for one in shown[t]}
    assert set(numbers) == {*RECORDED, *(seen & {*ADDED})}
    assert sorted(numbers.values()) == list(range(1, len(numbers) + 1))  # 0 is nothing
    assert [numbers[one] for one in RECORDED] == [1, 2, 3]  # as on the page of the recording
    assert numbers == session()._numbers(made(shown), frames[::-1])
