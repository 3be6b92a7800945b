"""A session draws what a run writes, anew only what a change of the recipe asks for; in its masks every instance that
any frame of a page shows has one number, whatever the frames' order."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from runs import augment

from rpaug.core import registry
from rpaug.core.types import Scene
from rpaug.pages.session import Session, smallest
from rpaug.pipeline import copies, recipe
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


ROOM = {"op": "distractors", "count": 1}
RECIPES: tuple[list[dict[str, Any]], ...] = (
    [{"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"}, ROOM],
    [{"op": "light_color"}],
    [{"op": "table_texture"}, ROOM, {"op": "camera_pose", "camera": "front", "shift": 0.05}],
    [{"op": "table_texture"}, ROOM, {"op": "camera_pose", "camera": "front", "shift": 0.02}],
)


def test_frames_are_those_that_a_run_writes_whatever_was_drawn_before(tmp_path: Path) -> None:
    session, top = Session(registry.SAMPLE), {"version": 1, "seed": 5, "gates": False}
    asked = [recipe.build({**top, "edits": edits}) for edits in RECIPES]
    for one in (*asked, *asked[::-1]):
        session.copy(one, 1)
    for number in (1, 3):
        out = tmp_path / str(number)
        augment(registry.SAMPLE, asked[number], out)
        adapter = registry.adapter_for(out)
        (key,) = adapter.episodes(out)
        written, drawn = (
            adapter.read(out, key),
            session.copy(asked[number], 1).made.recorded,
        )
        for name, view in written.views.items():
            for t in (0, 9):
                np.testing.assert_array_equal(drawn.views[name].rgb(t), view.rgb(t))
                np.testing.assert_array_equal(drawn.views[name].ids(t), view.ids(t))  # type: ignore[misc]


def test_a_recipe_that_differs_in_its_last_step_draws_that_one_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session, drawn = Session(registry.SAMPLE), []
    kept = copies._drawn

    def watched(scene: Scene, made: recipe.Recipe, number: int, *rest: int) -> Any:
        drawn.append(number)
        return kept(scene, made, number, *rest)

    monkeypatch.setattr(copies, "_drawn", watched)
    for edits in (RECIPES[2], RECIPES[3], RECIPES[2]):
        session.copy(recipe.build({"version": 1, "edits": edits}), 1)
    assert drawn == [0, 1, 2, 2]
    session.copy(recipe.build({"version": 1, "seed": 1, "edits": RECIPES[2]}), 1)
    assert drawn[4:] == [0, 1, 2]


def test_a_video_is_shown_by_its_recorded_frames_whatever_frames_it_was_worked_out_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def episode(levels: Sequence[int]) -> Any:
        camera = SimpleNamespace(width=16, height=16)
        view = SimpleNamespace(
            camera=camera, ids=None, depth=None,
            rgb=lambda t: np.full((16, 16, 3), levels[t], np.uint8),
        )  # fmt: skip
        return SimpleNamespace(key="walk", instruction="", length=len(levels), views={"ego": view})

    session = Session(Path())
    session.__dict__["_episode"] = episode([0, 10, 20, 30, 40])
    session.__dict__["found"] = {}, (), episode([0, 30, 40])  # two frames have no camera pose
    copy = SimpleNamespace(
        recorded=episode([5, 15, 25, 35, 45]), draws=(), repainted={}, lacking=("doubted",),
        scene=SimpleNamespace(bodies=()),
    )  # fmt: skip
    shown = SimpleNamespace(made=copy, verdict=dict)
    monkeypatch.setattr(Session, "copy", lambda *_: shown)
    assert session.describe()["length"] == 5
    asked = recipe.build({"version": 1, "edits": [{"op": "light_color"}]})
    for t in range(5):
        drawn = session.drawn(asked, 1, [t], judged=False)
        assert drawn["change"] == {"ego": 5.0}
        assert drawn["warnings"] == ["doubted"]
        recorded = smallest(session.episode.views["ego"], [t])
        assert session.before([t]) == {"ego": {"before": recorded}}
