"""What moves by itself in a video: told apart, fitted in space and time, and kept in the store."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import walks

from rpaug import Episode
from rpaug.gaussians import fit_video, gaussian_view
from rpaug.gaussians.fit4 import FourSettings
from rpaug.gaussians.fit_video import SplatSettings
from rpaug.scene.video import colmap, moving, reconstruct
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.video_scene import VideoScene

LENGTH = 10
SIDE = 48
QUICK = SplatSettings(
    width=96, rounds=2.0, threads=1, most=4000, hands=FourSettings(rounds=2, densify_rounds=())
)


def where(t: int) -> tuple[int, int]:
    """Row and column of the carried square's corner in frame t."""
    return 12 + 8 * t, 70 + 2 * t


def carried(t: int) -> np.ndarray:
    """Which pixels it covers."""
    row, column = where(t)
    out = np.zeros((walks.HEIGHT, walks.WIDTH), bool)
    out[row : row + SIDE, column : column + SIDE] = True
    return out


@pytest.fixture(scope="module")
def episode() -> Episode:
    """The walk with a speckled green square that is carried through the picture."""
    walk = walks.walk(LENGTH)
    (view,) = walk.views.values()
    rng = np.random.default_rng(9)
    square = np.repeat(np.repeat(rng.integers(0, 80, (8, 8, 3)), 6, 0), 6, 1)
    square = (square + np.array([20, 140, 30])).astype(np.uint8)
    images = []
    for t in range(LENGTH):
        image = view.rgb(t).copy()
        image[carried(t)] = square[:, : carried(t).any(0).sum()].reshape(-1, 3)
        images.append(image)
    return replace(walk, views={"ego": replace(view, rgb=images.__getitem__)})


@pytest.fixture(scope="module")
def made(episode: Episode, tmp_path_factory: pytest.TempPathFactory) -> VideoScene:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(colmap, "reconstruct", lambda *args, **named: walks.model(LENGTH))
        return reconstruct.develop(episode, cache=tmp_path_factory.mktemp("cache"))


def test_what_is_carried_is_told_apart(made: VideoScene) -> None:
    assert made.hand is not None
    assert made.contradicted == ()
    view = made.episode.views["ego"]
    assert view.ids is not None
    assert view.depth is not None
    given = []
    for t in range(LENGTH):
        mine, true = view.ids(t) == made.hand, carried(t)
        given.append((mine & true).sum() / (mine | true).sum())
        around = np.roll(true, (0, -SIDE), (0, 1)) & ~mine
        assert view.depth(t)[mine].max() < np.median(view.depth(t)[around])
    assert np.median(given) > 0.7
    (body,) = [body for body in made.scene().bodies if made.hand in body.instance_ids]
    assert body.motion == "unknown"


def test_frames_that_do_not_move_as_their_poses_say_pass_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = walks.model(12)
    poses = model.cam_to_world.copy()
    poses[11] = poses[0]
    wrong = replace(model, cam_to_world=poses)
    monkeypatch.setattr(colmap, "reconstruct", lambda *args, **named: wrong)
    found = reconstruct.develop(walks.walk(12), cache=tmp_path)
    assert 11 in found.contradicted
    assert found.describe()["passed_through"] == list(found.contradicted)
    assert len(found.model.times) == 12 - len(found.contradicted)


def test_hands_are_fitted_in_time_and_found_in_the_store(made: VideoScene, tmp_path: Path) -> None:
    scene, facts = fit_video.kept(made.scene(), made, tmp_path, QUICK)
    assert scene.flowing is not None
    assert set(np.unique(scene.flowing.ids)) == {made.hand}
    assert facts["four"]["handles"] == [made.hand]
    hand = str(made.hand)
    assert facts["four"]["db"][hand] > facts["four"]["rigid_db"][hand] + 3
    assert scene.gaussians is not None
    assert made.hand not in scene.gaussians.ids
    with pytest.MonkeyPatch.context() as patch:
        patch.delattr(fit_video, "fitted")
        again, given = fit_video.kept(made.scene(), made, tmp_path, QUICK)
    assert given == facts
    assert again.flowing is not None
    assert np.array_equal(again.flowing.means, scene.flowing.means)
    other = replace(QUICK, stride=4)
    assert fit_video.name_of(made, other) != fit_video.name_of(made, QUICK)


def test_gaussians_are_named_by_what_frames_show(made: VideoScene, tmp_path: Path) -> None:
    scene, _ = fit_video.kept(made.scene(), made, tmp_path, QUICK)
    assert scene.gaussians is not None
    small = fit_video._made_small(replace(scene, flowing=None), made, QUICK)
    ids = small.episode.views["ego"].ids
    assert ids is not None

    def right(named: np.ndarray) -> float:
        shown = replace(small, gaussians=replace(scene.gaussians, ids=named))
        found, still = gaussian_view.seen(shown, "ego", 3)[2], ids(3) != made.hand
        return float((found == ids(3))[still].mean())

    assert right(scene.gaussians.ids) > max(0.9, right(made.instances.at(scene.gaussians.means)))


def test_what_moves_for_a_moment_alone_is_no_hand() -> None:
    """A square that drifts for six frames is kept, where it is told; one of three frames is not."""
    masks, flows = [], {}
    for t in range(6):
        mask = np.zeros((40, 60), bool)
        mask[5:15, 5 + 6 * t : 17 + 6 * t] = True
        mask[25:35, 5:20] = t < 3
        masks.append(mask)
        flows[t, t + 1] = np.zeros((40, 60, 2), np.float16)
        flows[t, t + 1][:20, :, 0] = 6
    found = moving.lasting(masks, {k: v for k, v in flows.items() if k[1] < 6}, 1)
    for mask, kept in zip(masks, found, strict=True):
        assert np.array_equal(kept[:20], mask[:20])
        assert not kept[20:].any()
    still = [np.zeros((40, 60), bool)] * 6
    assert not np.any(moving.lasting(still, {}, 1))


def test_boxes_are_drawn_between_annotated_frames() -> None:
    noted = {2: [(0.0, 0.0, 10.0, 10.0)], 6: [(20.0, 4.0, 30.0, 14.0)]}
    assert moving.between(noted, 2, 10) == [(0, 0, 10, 10)]
    assert moving.between(noted, 4, 10) == [(10, 2, 20, 12)]
    assert moving.between(noted, 4, 3) == []
    assert moving.between(noted, 8, 10) == []


def test_a_box_takes_what_lies_in_it_and_not_what_is_behind() -> None:
    image = np.full((90, 120, 3), 200, np.uint8)
    image[30:60, 40:70] = (150, 80, 60)
    look = PosedFrame(image, np.ones((90, 120), np.float32), walks.K(), np.eye(4))
    hand = moving.boxed(look, [(35.0, 25.0, 75.0, 65.0)])
    assert hand[32:58, 42:68].all()
    assert not hand[:25].any()
    assert not moving.boxed(look, [(80.0, 5.0, 110.0, 20.0)]).any()
