"""Static Gaussians lent by another episode of a place: what agrees is taken over bit for bit, what does not is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic import BALL, BOX, EYES, LENGTH, TABLE, ball_at, scene, seen_by

from rpaug.core.errors import BadInput
from rpaug.core.types import Body, Gaussians, Scene
from rpaug.gaussians import cached, sharing, store
from rpaug.gaussians.descent import settings_for
from rpaug.gaussians.fit import fitted

SETTINGS = replace(settings_for(steps=60), train_frames=4, checked_frames=1, threads=1)
OTHER_TABLE = 71  # its handle in the second episode


def rolling(scene_: Scene, table: int = TABLE) -> Scene:
    still = np.tile(np.eye(4), (LENGTH, 1, 1))
    roll = still.copy()
    roll[:, :3, 3] = [ball_at(t, LENGTH) - ball_at(0, LENGTH) for t in range(LENGTH)]
    bodies = (
        Body(frozenset({table, BOX}), still, "static"),
        Body(frozenset({BALL}), roll, "gripper"),
    )
    return replace(scene_, bodies=bodies)


def first_scene() -> Scene:
    return rolling(scene(EYES, length=LENGTH, moving="wrist"))


def second_scene() -> Scene:
    """The same place, but its table has another handle and its box another color."""

    def change(name, t, rgb, depth, ids):
        rgb[ids == BOX] = (30, 200, 40)
        ids[ids == TABLE] = OTHER_TABLE
        return rgb, depth, ids

    plain = scene(EYES, length=LENGTH, moving="wrist")
    changed = seen_by(rolling(plain, OTHER_TABLE), change)
    return replace(changed, episode=replace(changed.episode, key="episode1"))


@pytest.fixture(scope="module")
def donor() -> Scene:
    return fitted(first_scene(), settings=SETTINGS)[0]


def test_a_place_is_told_by_its_fixed_cameras() -> None:
    first, second = first_scene().episode, second_scene().episode
    assert sharing.place(first) == sharing.place(second)
    view = first.views["front"]
    pose = view.camera.cam_to_world.copy()
    pose[:, 0, 3] += 0.01
    moved = {**first.views, "front": replace(view, camera=replace(view.camera, cam_to_world=pose))}
    assert sharing.place(replace(first, views=moved)) != sharing.place(first)
    assert sharing.place(replace(first, views={"wrist": first.views["wrist"]})) is None


def test_what_agrees_is_borrowed_and_nothing_else(donor: Scene) -> None:
    donated = sharing.borrowed(second_scene(), "abc", donor)
    assert set(donated.gaussians.ids.tolist()) == {OTHER_TABLE}
    assert donor.gaussians is not None
    tables = (donor.gaussians.ids == TABLE).sum()
    assert len(donated) > 0.6 * tables
    np.testing.assert_array_equal(donated.gaussians.means, donor.gaussians.means[donated.rows])


def test_what_is_looked_through_is_not_borrowed(donor: Scene) -> None:
    """The box is gone: where it stood one sees the table, which no Gaussian of the founder shows there."""

    def change(name, t, rgb, depth, ids):
        gone = ids == BOX
        depth[gone] *= 1.5
        ids[gone], rgb[gone] = TABLE, (90, 90, 90)
        return rgb, depth, ids

    donated = sharing.borrowed(seen_by(first_scene(), change), "abc", donor)
    assert donor.gaussians is not None
    boxes = donor.gaussians.ids == BOX
    assert boxes[donated.rows].sum() < 0.01 * boxes.sum()


def test_a_thousandth_of_the_size_borrows_as_much(donor: Scene) -> None:
    def small(given: Scene) -> Scene:
        views = {}
        for name, view in given.episode.views.items():
            pose = view.camera.cam_to_world.copy()
            pose[:, :3, 3] *= 1e-3
            camera = replace(view.camera, cam_to_world=pose)
            depth = lambda t, v=view: (1e-3 * v.depth(t)).astype(np.float32)  # noqa: E731
            views[name] = replace(view, camera=camera, depth=depth)
        return replace(given, episode=replace(given.episode, views=views))

    assert donor.gaussians is not None
    g = donor.gaussians
    tiny = replace(donor, gaussians=replace(g, means=g.means * 1e-3, scales=g.scales * 1e-3))
    usual = sharing.borrowed(second_scene(), "abc", donor)
    # Moving the ball's body to millimetres is not needed: what moves is never lent.
    found = sharing.borrowed(small(second_scene()), "abc", tiny)
    assert len(found) == pytest.approx(len(usual), rel=0.02)


def test_a_borrower_is_stored_once_and_comes_back_whole(tmp_path: Path) -> None:
    first, second = first_scene(), second_scene()
    made, facts = cached.fitted(second, tmp_path, settings=SETTINGS, donor=first)
    assert facts["founder"] == first.episode.key
    assert facts["borrowed"] > 1000
    assert SETTINGS.steps / 2 < facts["steps"] < SETTINGS.steps
    # In any order, and with or without a store, the same.
    again, _ = cached.fitted(second, None, settings=SETTINGS, donor=first)
    key = cached.name_of(second, SETTINGS, 0, first)
    found = store.load(tmp_path, key)
    assert found is not None
    for name in Gaussians.ARRAYS:
        np.testing.assert_array_equal(
            getattr(found.gaussians, name), getattr(made.gaussians, name), err_msg=name
        )
        np.testing.assert_array_equal(
            getattr(again.gaussians, name), getattr(made.gaussians, name), err_msg=name
        )
    donor_adapter = store.key(first, SETTINGS, 0)
    assert store.borrowers(tmp_path, donor_adapter) == [key]
    held = store.load(tmp_path, donor_adapter)
    assert held is not None
    assert found.borrowed is not None
    rows = found.borrowed.rows
    np.testing.assert_array_equal(found.gaussians.sh[: len(rows)], held.gaussians.sh[rows])
    alone, together = (store.described(tmp_path, name)["bytes"] for name in (donor_adapter, key))
    assert together < 0.8 * alone
    store.remove(tmp_path, donor_adapter)
    with pytest.raises(BadInput, match=f"borrowed: found no scene {donor_adapter}"):
        store.load(tmp_path, key)
