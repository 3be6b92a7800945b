"""Videos as scenes: lenses, up, depth by sweeping, things, and edits brought back into the recording."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import walks

from rpaug import BadInput, Unsupported
from rpaug.compose import views
from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.operators.light_color import LightColor
from rpaug.pipeline import recipe
from rpaug.pipeline.copies import Draw, Made
from rpaug.pipeline.inspect import inspect
from rpaug.pipeline.plan import Plan
from rpaug.pipeline.report import Tally
from rpaug.scene.placement import untouched
from rpaug.scene.targets import agreement, survey, targets
from rpaug.scene.targets.settled import SettledRole, settle
from rpaug.scene.video import colmap, instances, reconstruct, sweep, world
from rpaug.scene.video.lens import Lens
from rpaug.scene.video.model import Reconstruction, believed, load, save
from rpaug.scene.video.settings import VideoSettings
from rpaug.scene.video.video_scene import VideoScene

LENGTH = 10
TIMES = [0, 1, 2, 3, 4, 5, 6, 7, 9]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> VideoScene:
    """The walk with a model in which one frame was not registered."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(colmap, "reconstruct", lambda *args, **named: walks.model(LENGTH, TIMES))
        return reconstruct.develop(walks.walk(LENGTH), cache=tmp_path_factory.mktemp("cache"))


def test_instances_that_were_told_before_are_not_told_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(colmap, "reconstruct", lambda *args, **named: walks.model(LENGTH, TIMES))

    def ids() -> list[np.ndarray]:
        read = reconstruct.develop(walks.walk(LENGTH), cache=tmp_path).episode.views["ego"].ids
        assert read is not None
        return [read(k) for k in range(len(TIMES))]

    told = ids()
    (damaged,) = tmp_path.rglob("00003.npz")
    damaged.write_bytes(damaged.read_bytes()[:-40])
    made, of = [], instances.InstanceMap.of
    monkeypatch.setattr(instances.InstanceMap, "of", lambda *given: made.append(0) or of(*given))
    monkeypatch.setattr(instances, "find", None)
    assert all(np.array_equal(a, b) for a, b in zip(told, ids(), strict=True))
    assert len(made) == 5  # the damaged frame, and the four around it that it is held against


def test_only_a_camera_that_moves_is_looked_for() -> None:
    walk = walks.walk(LENGTH)
    assert reconstruct.unplaced(walk)
    (view,) = walk.views.values()
    still = replace(walk, views={"ego": replace(view, rgb=lambda t: view.rgb(0))})
    assert not reconstruct.unplaced(still)
    depth = replace(walk, views={"ego": replace(view, depth=lambda t: np.ones((144, 192)))})
    assert not reconstruct.unplaced(depth)


def test_a_lens_that_does_not_bend_changes_nothing() -> None:
    lens, image = Lens(walks.model(3)), walks.walk(3).views["ego"].rgb(1)
    assert lens.margin == (0, 0)
    assert np.array_equal(lens.flat(image), image)


@pytest.mark.parametrize("radial", [-0.1, 0.2])
def test_edits_go_back_through_the_lens_where_they_belong(radial: float) -> None:
    lens, image = Lens(walks.model(3, radial=radial)), walks.walk(3).views["ego"].rgb(1)
    flat = lens.flat(image)
    assert flat.shape == (lens.size[1], lens.size[0], 3)
    assert np.array_equal(lens.bent(image, flat, flat), image)
    edited = flat.copy()
    edited[60:90, 40:80] = np.clip(flat[60:90, 40:80].astype(int) + 40, 0, 255)
    back = lens.bent(image, flat, edited)
    changed = (back != image).any(-1)
    assert 0.5 < changed.sum() / (30 * 40) < 1.6
    again = lens.flat(back)
    assert np.abs(again[65:85, 45:75].astype(int) - edited[65:85, 45:75]).mean() < 8


def test_straight_undoes_bent() -> None:
    lens = Lens(walks.model(3, radial=-0.08))
    x, y = lens._straight(np.array([10.0, 150.0]), np.array([20.0, 100.0]))
    at = np.rint([x + lens.margin[0], y + lens.margin[1]]).astype(int)
    there = lens._forward[0][at[1], at[0]], lens._forward[1][at[1], at[0]]
    assert np.abs(there[0] - [10, 150]).max() < 1
    assert np.abs(there[1] - [20, 100]).max() < 1


def test_up_is_what_the_support_faces() -> None:
    model = walks.model(LENGTH)
    motion, level = world.upright(model, world.upward(model.cam_to_world))
    placed = model.moved(motion, 1.0)
    assert level is not None
    assert np.abs(placed.points[:, 2] - level).max() < 1e-6
    assert (placed.cam_to_world[:, 2, 3] > level).all()


def test_alignment_finds_the_motion_and_the_scale() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3))
    motion = geometry.rigid(np.array([0.1, 0.7, -0.3]), np.array([1.0, -2.0, 0.5]))
    found, scale = world.aligned(points, geometry.transform(motion, 2.5 * points))
    assert scale == pytest.approx(2.5)
    assert np.allclose(found, motion)


def test_swept_depth_is_the_scenes(made: VideoScene) -> None:
    """The plane is exact where its things are told, and the sweep is near it."""
    view = made.episode.views["ego"]
    assert view.depth is not None
    for k in (2, 6):
        pose = made.camera.cam_to_world[k]
        met = instances.plane_depth(made.camera.K, pose, (144, 192), made.instances.level or 0)
        table = (met > 0) & ~walks._beyond(walks.poses(LENGTH)[TIMES[k]])
        assert np.median(np.abs(made.depths[k] / met - 1)[table]) < 0.06
        assert np.median(np.abs(view.depth(k) / met - 1)[table]) < 0.06


def test_things_keep_their_handles_over_frames(made: VideoScene) -> None:
    view = made.episode.views["ego"]
    assert view.ids is not None
    instance_ids = []
    for k in range(made.episode.length):
        image = view.rgb(k).astype(int)
        red = (image[..., 0] > 150) & (image[..., 1] < 60)
        if red.sum() > 200:
            found, count = np.unique(view.ids(k)[red], return_counts=True)
            assert count.max() > 0.7 * red.sum()
            instance_ids.append(int(found[count.argmax()]))
    assert len(instance_ids) > 4
    assert len(set(instance_ids)) == 1


def test_unregistered_frames_and_untouched_pixels_pass_through(made: VideoScene) -> None:
    scene = made.scene()
    shown = views.edited(scene, {"ego": 0}, lambda *given: None)
    assert made(shown, views.everywhere(scene)).views["ego"].rgb is made.recorded.views["ego"].rgb
    view = shown.views["ego"]
    painted = replace(view, rgb=lambda k: np.full_like(view.rgb(k), 77))
    back = made(replace(shown, views={"ego": painted}), views.everywhere(scene))
    assert back.length == LENGTH
    assert np.array_equal(back.views["ego"].rgb(8), made.recorded.views["ego"].rgb(8))
    assert (back.views["ego"].rgb(9) == 77).all()
    assert back.views["ego"].depth is None
    given = made.describe()
    assert given["registered"] == 9
    assert given["passed_through"] == [8]
    assert "relative" in given["unit"]


def test_light_falls_on_unregistered_frames_too(made: VideoScene) -> None:
    scene, operator = made.scene(), LightColor(recorded=(0.5, 0.5, 0.5))
    dim = operator.apply(scene, {"gain": [0.5, 0.25, 1.0], "unlit": []})
    back = made(views.edited(dim, {"ego": 0}, lambda *given: None), views.everywhere(dim))
    for t in (7, 8, 9):
        before, after = (one.views["ego"].rgb(t).astype(float) for one in (made.recorded, back))
        assert np.abs(after / 255 - before / 255 * [0.5, 0.25, 1.0]).mean() < 0.01


def test_what_unregistered_frames_go_without_is_said(made: VideoScene) -> None:
    """Frame 8 has no pose, so it keeps its table; its light and its noise need none."""
    draws = tuple(
        Draw(0, recipe.option(name, {}), {"things": []})
        for name in ("light_color", "table_texture", "sensor_noise", "distractors")
    )
    scene = made.scene()
    plan = Plan(tier=0, representations={"ego": 0}, bodies=True)
    one = Made(scene.episode, scene, draws, plan, Tally(["ego"]))
    (said,) = one.lacking
    assert said == (
        "1 of 10 frames (8) have no camera pose and go without table_texture, distractors: there these vanish, even in"
        " full view"
    )
    assert replace(one, draws=draws[:1]).lacking == ()


def test_what_comes_and_goes_is_told(made: VideoScene) -> None:
    things = {h for one in made.instances.supports if one for h in one.instance_ids}
    assert things
    assert made.unsteady(things) == ""
    assert made.unsteady([10**6]) == ""  # put in by an edit
    blinking = replace(made)
    counted = made._counted.copy()
    one = min(things)
    counted[1::2, sorted(things)] = 0
    blinking.__dict__["_counted"] = counted
    why = blinking.unsteady(things)
    assert why.startswith(", ".join(map(str, sorted(things))) + " comes and goes")
    assert "jumps in 8 of 8 steps" in why
    assert "first between frames 0 and 1" in why
    counted[:] = made._counted
    counted[4, one] = 0
    assert blinking.unsteady([one]) == ""  # two jumps are no flicker


def test_jumps_are_told_from_what_the_table_of_instances_counted(made: VideoScene) -> None:
    again = replace(made)
    rows = survey.survey(again.episode, again.scene().bodies, {})
    (name,) = rows[0].pixels
    for row in rows:
        assert again._counted[:, row.instance_id].sum() == row.pixels[name]
    ids = tuple(sorted(row.instance_id for row in rows))
    assert survey.counts(again.episode, ids) is survey.counts(again.episode, ids)  # held


def test_inspect_names_the_handles_that_edits_go_by(
    made: VideoScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reconstruct, "develop", lambda *args, **named: made)
    described, rows, seen = inspect(made.recorded)
    assert seen.views["ego"].ids is not None
    assert {row.instance_id for row in rows} == {*made.instances.every}
    assert {row.instance_id for row in rows if row.role == "table"} == made.instances.support
    assert len(described["instances"]) == len(rows)
    assert described["film"]["registered"] == 9

    def refused(*args: object, **named: object) -> None:
        raise Unsupported("degenerate: 2 of 10")

    monkeypatch.setattr(reconstruct, "develop", refused)
    described, _, _ = inspect(replace(made.recorded, key="another"))
    assert described["assumed"][0].startswith("degenerate: 2 of 10")
    assert "film" not in described


@pytest.fixture
def level_depths(monkeypatch: pytest.MonkeyPatch) -> None:
    """No sweeping: everything is one unit away."""
    monkeypatch.setattr(
        sweep,
        "depths",
        lambda shots, *given: [np.ones(one.grey.shape, np.float32) for one in shots],
    )


@pytest.mark.usefixtures("level_depths")
def test_what_was_worked_out_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def once(*args: object, **named: object) -> Reconstruction:
        calls.append(1)
        return walks.model(LENGTH)

    monkeypatch.setattr(colmap, "reconstruct", once)
    first = reconstruct.develop(walks.walk(LENGTH), cache=tmp_path)
    second = reconstruct.develop(walks.walk(LENGTH), cache=tmp_path)
    assert len(calls) == 1
    assert np.array_equal(first.model.cam_to_world, second.model.cam_to_world)
    assert all(np.array_equal(a, b) for a, b in zip(first.depths, second.depths, strict=True))


@pytest.mark.usefixtures("level_depths")
def test_a_known_height_or_length_is_metric(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(colmap, "reconstruct", lambda *args, **named: walks.model(LENGTH))

    def steps(**asked: Any) -> np.ndarray:
        found = reconstruct.develop(walks.walk(LENGTH), VideoSettings(**asked), cache=tmp_path)
        assert found.unit.startswith("metres")
        return np.linalg.norm(np.diff(found.model.cam_to_world[:, :3, 3], axis=0), axis=1)

    true = np.hypot(0.05, 0.01)
    assert np.allclose(steps(camera_height=0.5), true)
    known = {"frame": 2, "places": [[30, 100], [130, 100]], "metres": 0.2}
    first = steps(known_length=known)
    assert np.allclose(steps(known_length=known | {"metres": 0.4}), 2 * first)
    for wrong, words in (
        ({"frame": 77}, "not registered"), ({"places": [[1, 1], [1, 1]]}, "one place twice"),
        ({"places": [[1, 1], [999, 1]]}, "a pixel of 192x144"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=words):
            steps(known_length=known | wrong)
    with pytest.raises(ValueError, match="give one"):
        VideoSettings(camera_height=1.0, known_length=known)


def test_degenerate_models_are_refused_with_the_numbers(tmp_path: Path) -> None:
    good = walks.model(LENGTH)
    assert not good.faults(LENGTH)
    few = replace(
        good, times=good.times[:2], cam_to_world=good.cam_to_world[:2], seen=good.seen[:2]
    )
    still = replace(good, cam_to_world=np.repeat(good.cam_to_world[:1], LENGTH, 0))
    long = replace(good, focal=1189.0, radial=2.4)
    for one, words in ((few, "2 of 10"), (still, "degrees"), (long, "1189 px")):
        with pytest.raises(Unsupported, match=words):
            believed([one], LENGTH)
    assert believed([few, good], LENGTH) is good
    save(tmp_path / "a.npz", good)
    again = load(tmp_path / "a.npz")
    assert again is not None
    assert np.array_equal(again.seen, good.seen)
    (tmp_path / "a.npz").write_bytes(b"no")
    assert load(tmp_path / "a.npz") is None


def test_a_refusal_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def refused(*args: object, **named: object) -> Reconstruction:
        calls.append(1)
        raise Unsupported("degenerate: 2 of 10")

    monkeypatch.setattr(colmap, "reconstruct", refused)
    for _ in range(2):
        with pytest.raises(Unsupported, match="2 of 10"):
            reconstruct.develop(walks.walk(LENGTH), cache=tmp_path)
    assert len(calls) == 1


def test_colmap_refuses_what_shows_nothing() -> None:
    blank = np.full((48, 64, 3), 90, np.uint8)
    with pytest.raises(Unsupported, match="nothing in 8 frames"):
        colmap.reconstruct(lambda t: blank, range(8), settings=colmap.ColmapSettings(threads=1))
    with pytest.raises(Unsupported, match="at most 300"):
        colmap.reconstruct(lambda t: blank, range(301))


def test_plain_patches_lie_on_their_plane() -> None:
    patch = np.zeros((40, 60), np.int32)
    rows, columns = np.mgrid[:40, :60]
    truth = 1 / (0.5 + 0.004 * columns + 0.003 * rows)
    trust = np.zeros((40, 60), np.float32)
    trust[::5, ::6] = 1
    depth = np.where(trust > 0, truth, 9.0)
    laid, sure = sweep.flattened(patch, depth, trust)
    assert np.abs(laid / truth - 1).max() < 0.02
    assert (sure > 0).all()


def test_paint_in_a_video_is_paint_in_its_light(made: VideoScene) -> None:
    edit = {"op": "recolor", "target": {"handle": min(made.instances.support)}, "color": "blue"}
    (step,) = recipe.build({"version": 1, "edits": [edit]}).steps
    drawn = step.options[0].operator.sample(made.scene(), np.random.default_rng(0))["color"]
    assert drawn[2] < 1
    assert min(drawn[:2]) > 0


def test_the_background_of_a_video_is_edited_only_where_a_person_settles_it(
    made: VideoScene,
) -> None:
    scene = made.scene()
    with pytest.raises(TargetError, match=r"the background is doubted: .* all that is no instance"):
        targets.find(scene, targets.BACKGROUND)
    assert instances.BACKGROUND in agreement.apart(scene)
    with pytest.raises(Unsupported, match="may be the background, which carries"):
        untouched.check(scene, frozenset([instances.BACKGROUND]), "", "removing")
    settled, wrong = settle(scene, {"background": SettledRole(handle=instances.BACKGROUND)})
    assert targets.find(settled, targets.BACKGROUND) == {instances.BACKGROUND}
    assert not wrong
    assert made.doubts["background"]
