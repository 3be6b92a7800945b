"""Things put into videos: room is what most frames agree on, and they darken the support at their foot."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import walks

from rpaug.compose import inserted
from rpaug.core import geometry
from rpaug.core.types import Scene
from rpaug.operators.insert import Insert
from rpaug.pipeline.contracts import shown
from rpaug.scene.lighting import grain, shadows
from rpaug.scene.placement import placing
from rpaug.scene.placement.untouched import without
from rpaug.scene.recorded import surfels
from rpaug.scene.video import colmap, reconstruct
from rpaug.scene.video.instances import BACKGROUND

LENGTH = 10


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            colmap, "reconstruct", lambda *args, **named: walks.model(LENGTH, list(range(LENGTH)))
        )
        return reconstruct.develop(
            walks.walk(LENGTH), cache=tmp_path_factory.mktemp("cache")
        ).scene()


def half_told(scene: Scene, erring: bool) -> Scene:
    """The scene with half of its support told, and that the wrong way in one frame if it is to err."""
    (view,) = scene.episode.views.values()
    assert view.ids is not None
    assert view.depth is not None
    recorded, depth = view.ids, view.depth
    middle = np.median(geometry.world_points(depth(4), view.camera, 4)[..., 0])

    def ids(t: int) -> np.ndarray:
        left = geometry.world_points(depth(t), view.camera, t)[..., 0] < middle
        return np.where(left == (erring and t == 4), BACKGROUND, recorded(t))

    return replace(scene, episode=replace(scene.episode, views={"ego": replace(view, ids=ids)}))


def test_a_frame_that_errs_makes_no_room(scene: Scene) -> None:
    sound = placing.find_free_space(half_told(scene, False))
    erring = placing.find_free_space(half_told(scene, True))
    assert 1000 < sound.seen.sum() < 0.7 * placing.find_free_space(scene).seen.sum()
    assert abs(int(erring.seen.sum()) - int(sound.seen.sum())) < 0.1 * sound.seen.sum()


def test_a_thing_stands_on_what_frames_show_and_darkens_its_foot(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        grain, "blur", lambda image: 0.0
    )  # soft outlines lie on what is beside them
    edit = Insert(asset="die").sample(scene, np.random.default_rng(0))
    after = Insert(asset="die").apply(scene, edit)
    (thing,) = edit["things"]
    middle = np.array(thing["pose"])[:3, 3]
    (view,) = scene.episode.views.values()
    edited, darker = shown(after).views["ego"], []
    for t in range(LENGTH):
        (u, v), z = (part[0] for part in geometry.project(middle[None], view.camera, t))
        if z > 0 and 12 < u < view.camera.width - 12 and 12 < v < view.camera.height - 12:
            assert view.ids(t)[round(v), round(u)] in scene.roles["table"]
        assert view.ids is not None
        assert view.depth is not None
        before = view.rgb(t), view.depth(t), view.ids(t)
        ids = inserted.draw(after, view.camera, t, before)[2]
        support = np.isin(ids, list(scene.roles["table"]))
        support = cv2.erode(support.astype(np.uint8), np.ones((3, 3))) > 0
        change = edited.rgb(t).astype(int) - view.rgb(t)
        assert (change[support] <= 0).all()
        darker.append(int((change[support] < -4).any(-1).sum()))
    assert max(darker) > 10


def test_a_simulator_has_no_light_from_all_sides(scene: Scene) -> None:
    (view,) = scene.episode.views.values()
    episode = replace(scene.episode, views={"ego": replace(view, inferred=False)})
    simulated = replace(scene, episode=episode)
    after = replace(simulated, bodies=(*simulated.bodies, simulated.bodies[0]))
    assert shadows.grounded(simulated, after) is after


@pytest.mark.parametrize("photographs", [True, False])
def test_what_goes_takes_along_what_it_shows_beside_its_outline(
    scene: Scene, photographs: bool
) -> None:
    """In photographs its blur; where masks were recorded the one pixel that anti-aliasing mixes, and else nothing."""
    (view,) = scene.episode.views.values()
    episode = replace(scene.episode, views={"ego": replace(view, inferred=photographs)})
    known = replace(scene, episode=episode)
    assert view.ids is not None
    instance_id = next(h for h in range(5, 8) if (view.ids(5) == h).sum() > 50)
    inside = view.ids(5) == instance_id
    rim = (cv2.dilate(inside.astype(np.uint8), np.ones((3, 3))) > 0) & ~inside
    beyond = (cv2.dilate(inside.astype(np.uint8), np.ones((5, 5))) > 0) & ~inside & ~rim

    def source(of: Scene) -> np.ndarray:
        edited = without(of, [instance_id])
        return np.asarray(surfels.view(surfels.build(edited), edited, "ego", 5).source)

    drawn = source(known)
    assert (drawn[inside | rim] != 0).all()
    if not photographs:
        assert (drawn[beyond] == 0).all()
        assert (source(replace(known, antialiased=False))[rim] == 0).all()
