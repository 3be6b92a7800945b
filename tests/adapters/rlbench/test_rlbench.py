"""RLBench episodes: layouts, conventions, refusals; unknown things survive."""

import os
import pickle
import re
import shutil
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from rpaug_adapters.rlbench import RLBench, write
from rpaug_adapters.rlbench.pickles import dump, load
from rpaug_adapters.rlbench.read import DEPTH_STEPS, read_code

from rpaug import BadInput
from rpaug.core import geometry
from rpaug.core.files import decode_png, encode_png
from rpaug.pipeline.contracts import AdapterContract

KEY = "roll_ball/all_variations/episodes/episode0"


class TestContract(AdapterContract):
    @pytest.fixture(autouse=True)
    def _template(self, template: Path) -> None:
        self.template = template

    def adapter(self) -> RLBench:
        return RLBench()

    def dataset(self, folder: Path) -> Path:
        return Path(shutil.copytree(self.template, folder))


def refusal(root: Path, key: str = KEY) -> str:
    with pytest.raises(BadInput) as caught:
        RLBench().read(root, key)
    return str(caught.value)


def edit_demo(root: Path, change) -> None:  # type: ignore[no-untyped-def]
    path = root / KEY / "low_dim_obs.pkl"
    demo = load(path)
    change(demo)
    path.write_bytes(dump(demo))


def test_all_layouts_are_found_in_natural_order(dataset: Path, tmp_path: Path) -> None:
    root = tmp_path / "all"
    keys = [
        "all_variations/episodes/episode0",
        "slide_2/variation0/episodes/episode10",
        "slide_2/variation0/episodes/episode9",
        "stack_cups_1/episodes/episode0",
    ]
    for key in keys:
        shutil.copytree(dataset / KEY, root / key)
    found = RLBench().episodes(root)
    assert sorted(found) == sorted(keys)
    assert found.index(keys[2]) < found.index(keys[1])
    assert RLBench().episodes(dataset / KEY) == ["."]


def test_upstream_keeps_descriptions_beside_the_episodes(dataset: Path, tmp_path: Path) -> None:
    root, out = tmp_path / "up", tmp_path / "out"
    key = "reach/variation3/episodes/episode0"
    shutil.copytree(dataset / KEY, root / key)
    shutil.move(root / key / "variation_descriptions.pkl", root / "reach/variation3")
    adapter = RLBench()
    episode = adapter.read(root, key)
    assert episode.descriptions == ("roll the ball", "push it")
    adapter.write(episode, out, key, dict)
    adapter.finish(root, out)
    assert adapter.read(out, key).descriptions == episode.descriptions


def test_cameras_are_opencv_with_integer_centres(template: Path) -> None:
    episode = RLBench().read(template, KEY)
    stored = load(template / KEY / "low_dim_obs.pkl")._observations[0].misc
    assert (np.diag(stored["front_camera_intrinsics"])[:2] < 0).all()
    camera = episode.views["front"].camera
    assert (np.diag(camera.K) > 0).all()
    points = geometry.world_points(episode.views["front"].depth(0), camera, 0)
    table = episode.views["front"].ids(0) == 7
    assert np.abs(points[table][:, 2]).max() < 1e-5  # the table is the plane z = 0


def test_two_real_cameras_see_the_same_points(samples: Path) -> None:
    root = samples / "rlbench_open_drawer"
    episode = RLBench().read(root, RLBench().episodes(root)[0])
    front, other = episode.views["front"], episode.views["overhead"]
    points = geometry.world_points(front.depth(0), front.camera, 0)
    pixels, z = geometry.project(points.reshape(-1, 3), other.camera, 0)
    near = 1.0 / other.depth(0)  # affine on planes, so bilinear sampling is exact there
    seen = cv2.remap(near, pixels[None].astype(np.float32), None, cv2.INTER_LINEAR)[0]
    gap = np.abs(1.0 / np.maximum(seen, 1e-6) - z)
    inside = ((pixels > 1) & (pixels < 126)).all(-1) & (gap < 0.02)
    assert inside.sum() > 500
    assert np.median(gap[inside]) < 1e-4


def test_real_episodes_are_written_back_byte_for_byte(samples: Path, tmp_path: Path) -> None:
    root, adapter = samples / "rlbench_open_drawer", RLBench()
    key = adapter.episodes(root)[1]
    adapter.write(adapter.read(root, key), tmp_path, key, dict)
    theirs = {
        p.relative_to(root / key): p.read_bytes() for p in (root / key).rglob("*") if p.is_file()
    }
    ours = {
        p.relative_to(tmp_path / key): p.read_bytes()
        for p in (tmp_path / key).rglob("*")
        if p.is_file()
    }
    assert ours == theirs


def test_only_what_changed_is_encoded_anew(dataset: Path, tmp_path: Path) -> None:
    adapter = RLBench()
    episode = adapter.read(dataset, KEY)
    view = episode.views["front"]
    deeper = view.depth(1).copy()
    deeper[0, 0] = 1.25

    def depth(t: int) -> np.ndarray:
        return deeper if t == 1 else view.depth(t)

    edited = replace(episode, views={**episode.views, "front": replace(view, depth=depth)})
    adapter.write(edited, tmp_path / "out", KEY, dict)
    for t in range(episode.length):
        for kind in ("rgb", "depth", "mask"):
            name = f"front_{kind}/{t}.png"
            new, old = tmp_path / "out" / KEY / name, dataset / KEY / name
            if (kind, t) != ("depth", 1):
                assert new.read_bytes() == old.read_bytes()
                continue
            differs = (decode_png(new) != decode_png(old)).any(-1)
            assert differs.sum() == 1
            assert (
                abs(adapter.read(tmp_path / "out", KEY).views["front"].depth(1)[0, 0] - 1.25) < 1e-6
            )


def test_large_images_are_written_by_threads_to_the_same_bytes(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    episode = RLBench().read(dataset, KEY)
    name, view = next(iter(episode.views.items()))
    met = threading.Barrier(3, timeout=30)

    def written(small: int, threads: int) -> dict[str, bytes]:
        monkeypatch.setattr(write, "SMALL", small)
        makers = set()

        def inverted(t: int) -> np.ndarray:
            makers.add(threading.get_ident())
            if threads == 3 and t < 3:
                met.wait()  # three are at work at once
            return 255 - view.rgb(t)

        edited = {**episode.views, name: replace(view, rgb=inverted)}
        out = tmp_path / str(small)
        RLBench().write(replace(episode, views=edited), out, KEY, dict)
        assert len(makers) == threads
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*.png")}

    assert written(write.SMALL, 1) == written(1, 3)


def test_a_moved_camera_is_the_only_new_matrix(dataset: Path, tmp_path: Path) -> None:
    adapter = RLBench()
    episode = adapter.read(dataset, KEY)
    view = episode.views["front"]
    pose = view.camera.cam_to_world @ geometry.rigid(np.array([0, 0.02, 0]), np.array([0.1, 0, 0]))
    moved = replace(view, camera=replace(view.camera, cam_to_world=pose))
    adapter.write(
        replace(episode, views={**episode.views, "front": moved}), tmp_path / "out", KEY, dict
    )
    back = adapter.read(tmp_path / "out", KEY)
    assert np.allclose(back.views["front"].camera.cam_to_world, pose, atol=1e-15)
    old, new = (
        load(root / KEY / "low_dim_obs.pkl")._observations for root in (dataset, tmp_path / "out")
    )
    for before, after in zip(old, new, strict=True):
        assert before.misc.keys() == after.misc.keys()
        assert before.__dict__.keys() == after.__dict__.keys()
        changed = [k for k in before.misc if not np.array_equal(before.misc[k], after.misc[k])]
        assert changed == ["front_camera_extrinsics"]


def test_depth_goes_to_the_nearest_code(dataset: Path, tmp_path: Path) -> None:
    episode = RLBench().read(dataset, KEY)
    view = episode.views["front"]
    misc = load(dataset / KEY / "low_dim_obs.pkl")._observations[0].misc
    near, far = (float(misc[f"front_camera_{plane}"]) for plane in ("near", "far"))
    between = np.linspace(0.01, 0.99, view.camera.width)  # of a step
    depth = view.depth(0).copy()
    wanted = 3_000_000 + np.arange(view.camera.width) + between
    depth[0] = near + wanted / DEPTH_STEPS * (far - near)
    edited = replace(view, depth=lambda t: depth)
    RLBench().write(replace(episode, views={**episode.views, "front": edited}), tmp_path, KEY, dict)
    codes = read_code(tmp_path / KEY / "front_depth/0.png")[0]
    given = (depth[0].astype(np.float64) - near) / (far - near) * DEPTH_STEPS
    assert np.abs(codes - given).max() < 0.501
    assert np.ptp(given - np.floor(given)) > 0.5  # codes were between two steps


def test_where_nothing_is_depth_is_the_far_plane(dataset: Path, tmp_path: Path) -> None:
    episode = RLBench().read(dataset, KEY)
    view = episode.views["front"]
    depth = view.depth(0).copy()
    depth[0, :3] = 0, np.inf, np.nan
    edited = replace(
        episode, views={**episode.views, "front": replace(view, depth=lambda t: depth)}
    )
    RLBench().write(edited, tmp_path, KEY, dict)
    back = RLBench().read(tmp_path, KEY).views["front"].depth(0)
    first = load(dataset / KEY / "low_dim_obs.pkl")._observations[0]
    assert back[0, :3] == pytest.approx(first.misc["front_camera_far"])
    np.testing.assert_array_equal(back[1:], view.depth(0)[1:])


def test_depth_beyond_the_usual_range_moves_the_far_plane(dataset: Path, tmp_path: Path) -> None:
    """Of a source that is not CoppeliaSim's; where its camera sees nothing so far away the plane stays."""
    episode = replace(RLBench().read(dataset, KEY), source=None)
    view = episode.views["front"]
    depth = view.depth(0).copy()
    depth[0, :3] = 250.0, 0, np.inf
    far = replace(view, depth=lambda t: depth if t else view.depth(0))
    RLBench().write(replace(episode, views={**episode.views, "front": far}), tmp_path, KEY, dict)
    back = RLBench().read(tmp_path, KEY).views["front"].depth(1)
    assert back[0, :3] == pytest.approx(250.0)
    np.testing.assert_allclose(back[1:], depth[1:], atol=1e-4)
    misc = load(tmp_path / KEY / "low_dim_obs.pkl")._observations[1].misc
    assert misc["front_camera_far"] == 250.0
    assert {misc[f"{name}_camera_far"] for name in episode.views if name != "front"} <= {10.0}


def test_unknown_files_and_fields_survive(dataset: Path, tmp_path: Path) -> None:
    def add(demo) -> None:  # type: ignore[no-untyped-def]
        demo.num_reset_attempts = 3
        demo._observations[2].surprise = np.arange(3)

    edit_demo(dataset, add)
    (dataset / KEY / "extra.txt").write_text("kept")
    adapter = RLBench()
    adapter.write(adapter.read(dataset, KEY), tmp_path / "out", KEY, dict)
    demo = load(tmp_path / "out" / KEY / "low_dim_obs.pkl")
    assert demo.num_reset_attempts == 3
    assert np.array_equal(demo._observations[2].surprise, np.arange(3))
    assert (tmp_path / "out" / KEY / "extra.txt").read_text() == "kept"


class Evil:
    """Code to whoever opens its pickle trustingly."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("true",)


def test_every_pickle_that_is_passed_on_goes_through_the_whitelist(dataset: Path) -> None:
    for name in ("variation_number.pkl", "notes.pkl"):
        (dataset / KEY / name).write_bytes(pickle.dumps(Evil()))
        assert f"{name}: pickle: found the foreign global posix.system" in refusal(dataset)
        (dataset / KEY / name).unlink()


@pytest.mark.parametrize("value", [[3], {"number": 3}, "3", 3.0, True, None])
def test_a_variation_that_is_no_number_is_refused(dataset: Path, value: object) -> None:
    (dataset / KEY / "variation_number.pkl").write_bytes(pickle.dumps(value))
    assert "variation_number.pkl: variation: found" in refusal(dataset)


@pytest.mark.parametrize("value", [3, np.int64(3)])
def test_a_variation_is_a_whole_number_of_any_kind(dataset: Path, value: object) -> None:
    (dataset / KEY / "variation_number.pkl").write_bytes(pickle.dumps(value))
    assert RLBench().read(dataset, KEY).length > 0


def test_descriptions_beside_episodes_go_through_the_whitelist(dataset: Path) -> None:
    """They are passed on even where each episode has its own."""
    beside = dataset / "roll_ball/all_variations/variation_descriptions.pkl"
    beside.write_bytes(pickle.dumps(Evil()))
    assert (dataset / KEY / beside.name).is_file()
    assert f"{beside.name}: pickle: found the foreign global" in refusal(dataset)


def test_pickles_deeper_down_are_checked_when_they_are_passed_on(
    dataset: Path, tmp_path: Path
) -> None:
    (dataset / KEY / "logs").mkdir()
    (dataset / KEY / "logs/a.pickle").write_bytes(pickle.dumps(Evil()))
    with pytest.raises(BadInput, match=r"a\.pickle: pickle: found the foreign global"):
        RLBench().write(RLBench().read(dataset, KEY), tmp_path / "out", KEY, dict)
    assert not (tmp_path / "out" / KEY).exists()


def test_a_pickle_that_is_not_read_is_not_passed_on(dataset: Path, tmp_path: Path) -> None:
    (dataset / KEY / "policy.pt").write_bytes(b"cos\nsystem\n.")
    with pytest.raises(BadInput, match=r"policy\.pt: format: found a pickle"):
        RLBench().write(RLBench().read(dataset, KEY), tmp_path / "out", KEY, dict)


def test_links_that_leave_the_episode_are_not_followed(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("secret")
    for target in (tmp_path / "secret.txt", dataset / KEY / "front_rgb", tmp_path):
        link = dataset / KEY / "notes.txt"
        link.symlink_to(target)
        with pytest.raises(BadInput, match=r"notes\.txt: link: found a link to .*"):
            RLBench().write(RLBench().read(dataset, KEY), tmp_path / "out", KEY, dict)
        link.unlink()
        assert not (tmp_path / "out" / KEY).exists()
    link.symlink_to(dataset / KEY / "variation_number.pkl")
    RLBench().write(RLBench().read(dataset, KEY), tmp_path / "out", KEY, dict)
    assert not (tmp_path / "out" / KEY / "notes.txt").is_symlink()


@pytest.mark.parametrize(
    "name", ["front_rgb/3.png", "front_mask", "low_dim_obs.pkl", "variation_number.pkl"]
)
def test_what_is_read_is_no_link_out(name: str, dataset: Path, tmp_path: Path) -> None:
    """An image of somebody else's would lie in the copy."""
    path, outside = dataset / KEY / name, tmp_path / "outside"
    path.rename(outside)
    path.symlink_to(outside)
    found = (
        rf"{re.escape(name)}: link: found a link to .*outside; expected a file within .*episode0"
    )
    with pytest.raises(BadInput, match=found):
        RLBench().read(dataset, KEY)
    whole = dataset / KEY / "kept"  # a link within the episode is a file of it
    path.unlink()
    outside.rename(whole)
    if whole.is_file():
        path.symlink_to(whole)
        assert RLBench().read(dataset, KEY).length > 0


def test_folders_within_an_episode_are_passed_on(dataset: Path, tmp_path: Path) -> None:
    (dataset / KEY / "logs/deep").mkdir(parents=True)
    (dataset / KEY / "logs/deep/a.txt").write_text("kept")
    RLBench().write(RLBench().read(dataset, KEY), tmp_path / "out", KEY, dict)
    assert (tmp_path / "out" / KEY / "logs/deep/a.txt").read_text() == "kept"


def test_lists_in_lists_are_refused_before_they_grow(dataset: Path) -> None:
    def spoil(demo) -> None:  # type: ignore[no-untyped-def]
        value: list[object] = [0.0]
        for _ in range(30):
            value = [value, value]
        demo._observations[0].joint_positions = value

    edit_demo(dataset, spoil)
    assert (dataset / KEY / "low_dim_obs.pkl").stat().st_size < 2**20
    assert "observation 0, joint_positions: found list" in refusal(dataset)


def test_one_observation_or_wording_many_times_over_is_refused_at_once(dataset: Path) -> None:
    (dataset / KEY / "variation_descriptions.pkl").write_bytes(dump(["push it"] * 2_000_000))
    assert "descriptions: found 2000000; expected at most 1000" in refusal(dataset)
    (dataset / KEY / "variation_descriptions.pkl").write_bytes(dump(["push it"]))

    def spoil(demo) -> None:  # type: ignore[no-untyped-def]
        demo._observations = [demo._observations[0]] * 500_000

    edit_demo(dataset, spoil)
    assert "found 500000, some of them one and the same" in refusal(dataset)


def test_single_channel_masks_are_handles_as_they_are(dataset: Path, tmp_path: Path) -> None:
    for path in (dataset / KEY / "front_mask").iterdir():
        path.write_bytes(encode_png(decode_png(path)[..., 0]))
    adapter = RLBench()
    episode = adapter.read(dataset, KEY)
    assert set(np.unique(episode.views["front"].ids(0))) <= set(range(256))
    view = episode.views["front"]
    shifted = replace(view, ids=lambda t: np.roll(view.ids(t), 1, 0))
    adapter.write(
        replace(episode, views={**episode.views, "front": shifted}), tmp_path / "out", KEY, dict
    )
    back = adapter.read(tmp_path / "out", KEY).views["front"]
    assert np.array_equal(back.ids(3), np.roll(view.ids(3), 1, 0))
    assert decode_png(tmp_path / "out" / KEY / "front_mask/3.png").ndim == 2


def test_grey_or_deep_images_are_refused_where_three_channels_are_meant(dataset: Path) -> None:
    path = dataset / KEY / "front_depth/2.png"
    path.write_bytes(encode_png(np.zeros((80, 96), np.uint8)))
    assert "front_depth/2.png" in refusal(dataset)
    path.write_bytes(cv2.imencode(".png", np.zeros((80, 96, 3), np.uint16))[1].tobytes())
    assert "16 bits" in refusal(dataset)


def test_the_instruction_survives_when_only_the_episodes_folder_is_given(
    dataset: Path, tmp_path: Path
) -> None:
    root, adapter = tmp_path / "variation3/episodes", RLBench()
    shutil.copytree(dataset / KEY, root / "episode0")
    shutil.move(root / "episode0/variation_descriptions.pkl", tmp_path / "variation3")
    episode = adapter.read(root, "episode0")
    adapter.write(episode, tmp_path / "out", "episode0", dict)
    adapter.finish(root, tmp_path / "out")
    assert adapter.read(tmp_path / "out", "episode0").descriptions == ("roll the ball", "push it")


def test_a_missing_camera_folder_is_a_camera_less(dataset: Path) -> None:
    for kind in ("rgb", "depth", "mask"):
        shutil.rmtree(dataset / KEY / f"overhead_{kind}")
    assert list(RLBench().read(dataset, KEY).views) == ["front"]


def test_broken_episodes_are_refused_with_file_and_field(dataset: Path) -> None:
    folder = dataset / KEY
    whole = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    def check(*words: str) -> None:
        message = refusal(dataset)
        assert all(word in message for word in words), message
        for path, data in whole.items():
            path.write_bytes(data)

    (folder / "front_rgb/3.png").unlink()
    check("front_rgb/3.png", "expected a file")
    (folder / "front_rgb/3.png").write_bytes(whole[folder / "front_rgb/3.png"][:-20])
    check("front_rgb/3.png", "cut off")
    (folder / "front_depth/8.png").write_bytes(whole[folder / "front_depth/7.png"])
    check("front_depth", "9 images", "8")
    (folder / "front_depth/8.png").unlink()
    (folder / "front_mask/2.png").write_bytes(encode_png(np.zeros((3, 4, 3), np.uint8)))
    check("front_mask/2.png", "4x3", "96x80")
    (folder / "low_dim_obs.pkl").unlink()
    check("low_dim_obs.pkl")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda o: o.gripper_pose.__setitem__(0, np.nan), ["observation 3", "gripper_pose", "NaN"]),
        (
            lambda o: o.misc["front_camera_extrinsics"].__setitem__((0, 3), np.nan),
            ["observation 3", "front_camera_extrinsics", "NaN"],
        ),
        (
            lambda o: o.misc["front_camera_intrinsics"].__setitem__((1, 1), 0.0),
            ["observation 3", "focal length 0 at [1, 1]"],
        ),
        (
            lambda o: o.misc["front_camera_extrinsics"].__setitem__((0, 0), 9.0),
            ["observation 3", "rotation"],
        ),
        (
            lambda o: o.gripper_pose.__setitem__(slice(3, 7), 0.0),
            ["observation 3", "gripper_pose", "length 0"],
        ),
        (
            lambda o: o.misc.pop("front_camera_extrinsics"),
            ["observation 3", "front_camera_extrinsics"],
        ),
        (lambda o: o.misc.update(front_camera_far=0.0), ["front_camera_far", "near < far"]),
        (
            lambda o: setattr(o, "joint_positions", np.zeros(6)),
            ["joint_positions", "changes over time"],
        ),
        (
            lambda o: setattr(o, "gripper_pose", np.zeros(6)),
            ["observation 3", "gripper_pose", "(6,)", "(7,)"],
        ),
        (lambda o: setattr(o, "misc", None), ["observation 3", "misc"]),
        (lambda o: setattr(o, "gripper_open", "wide"), ["observation 3", "gripper_open", "str"]),
    ],
)
def test_bad_numbers_are_refused_with_frame_and_field(
    dataset: Path, change, words: list[str]
) -> None:  # type: ignore[no-untyped-def]
    edit_demo(dataset, lambda demo: change(demo._observations[3]))
    message = refusal(dataset)
    assert all(word in message for word in ["low_dim_obs.pkl", *words]), message


def test_colosseums_own_layout(dataset: Path, tmp_path: Path) -> None:
    """As robot-colosseum's `save_demo` and dataset generator leave it: masks of one channel, words beside the
    episodes, no overhead camera, a state of its own among the episodes."""
    place = tmp_path / "in/slide_block_to_target_3/variation0/episodes"
    shutil.copytree(dataset / KEY, place / "episode0")
    episode = place / "episode0"
    shutil.move(episode / "variation_descriptions.pkl", place.parent)
    (episode / "variation_number.pkl").unlink()
    (place / "save_state.pkl").write_bytes(b"cos\nsystem\n(S'true'\ntR.")  # never opened
    for path in episode.glob("*_mask/*.png"):
        instance_ids = RLBench().read(dataset, KEY).views[path.parent.name[:-5]].ids(int(path.stem))
        path.write_bytes(encode_png((instance_ids * 255 % 256).astype(np.uint8)))
    for kind in ("rgb", "depth", "mask"):
        shutil.rmtree(episode / f"overhead_{kind}", ignore_errors=True)
    adapter, key = RLBench(), "slide_block_to_target_3/variation0/episodes/episode0"
    assert adapter.episodes(tmp_path / "in") == [key]
    read, recorded = adapter.read(tmp_path / "in", key), adapter.read(dataset, KEY)
    assert read.descriptions == ("roll the ball", "push it")
    assert "overhead" not in read.views
    one, other = read.views["front"].ids(0), recorded.views["front"].ids(0)
    assert np.array_equal(one, -other % 256)
    adapter.write(read, tmp_path / "out", key, dict)
    adapter.finish(tmp_path / "in", tmp_path / "out")
    again = adapter.read(tmp_path / "out", key)
    assert again.descriptions == read.descriptions
    assert np.array_equal(again.views["front"].ids(0), one)
    assert not list((tmp_path / "out").rglob("save_state.pkl"))
