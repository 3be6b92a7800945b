"""The bench of foreign worlds, where it needs no simulator: halves, grades, shares, and the way into datasets."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core import registry
from rpaug.twin import covers
from tools.bench.foreign import (
    cameras,
    changed,
    convert,
    distractors,
    edits,
    furnished,
    neutral,
    reobserved,
    roles,
    run,
    scoring,
    simulated,
)
from tools.bench.harness import pages

NAMES = [f"task-{k}" for k in range(9)]
IDS = st.sets(st.integers(1, 6))
WEIGHTS = dict.fromkeys(range(1, 7), 100)


def test_halves_depend_on_names_alone_and_are_even() -> None:
    halves = {name: neutral.half(name, NAMES) for name in NAMES}
    assert halves == {name: neutral.half(name, NAMES[::-1]) for name in NAMES}
    assert sorted(map(list(halves.values()).count, neutral.HALVES)) == [4, 5]


@settings(max_examples=50, deadline=None)
@given(must=IDS, may=IDS)
def test_the_truth_is_right_with_and_without_what_it_may_hold(must: set, may: set) -> None:
    truth = {"must": must, "may": may}
    assert scoring.grade(truth, must, WEIGHTS) == scoring.RIGHT
    assert scoring.grade(truth, must | may, WEIGHTS) == scoring.RIGHT


@settings(max_examples=50, deadline=None)
@given(must=IDS, may=IDS, found=IDS)
def test_a_role_is_right_only_if_nothing_seen_is_missing_or_added(
    must: set, may: set, found: set
) -> None:
    grade = scoring.grade({"must": must, "may": may}, found, WEIGHTS)
    fits = must <= found <= must | may
    if must and found:
        assert (grade == scoring.RIGHT) == fits
    elif must:
        assert grade == scoring.ABSENT
    else:
        assert grade == (scoring.RIGHT if found <= may else scoring.INVENTED)


def test_what_no_camera_shows_weighs_nothing() -> None:
    truth = {"must": [1, 2], "may": []}
    assert scoring.grade(truth, [1], {1: 990, 2: 10}) == scoring.RIGHT
    assert scoring.grade(truth, [1], {1: 900, 2: 100}) == scoring.WRONG
    assert scoring.grade(truth, [1, 3], {1: 500, 2: 5, 3: 100}) == scoring.WRONG
    assert scoring.grade({"must": [9], "may": []}, [], {1: 5}) == scoring.RIGHT


TWO_BALLS = """<mujoco><option gravity="0 0 0"/><worldbody>
  <body name="hand"><joint type="slide" axis="1 0 0"/><geom size="0.05"/></body>
  <body name="near" pos="0.1 0 0"><joint type="slide" axis="1 0 0"/><geom size="0.05"/></body>
  <body name="beyond" pos="0.25 0 0"><joint type="slide" axis="1 0 0"/><geom size="0.05"/></body>
  <body name="alone" pos="0 1 0"><joint type="slide" axis="0 0 1"/><geom size="0.05"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(("far", "expected"), [(0.0, {"near"}), (0.1, {"near", "beyond"})])
def test_what_the_robot_pushes_is_told_apart_from_what_falls(far: float, expected: set) -> None:
    model = mujoco.MjModel.from_xml_string(TWO_BALLS)
    way = np.linspace(0, 0.05 + far, 20)
    beyond = np.maximum(0, way - 0.05)
    qpos = np.stack([way, way, beyond, -way], 1)
    still = simulated.state(mujoco.MjData(model))
    states = {name: np.stack([value] * 20) for name, value in still.items()}
    assert simulated.pushed(model, states | {"qpos": qpos}, {"hand"}) == expected


def test_a_share_knows_that_tasks_differ() -> None:
    alike = scoring.share([[True, False]] * 10)
    apart = scoring.share([[True, True]] * 5 + [[False, False]] * 5)
    assert alike.percent == apart.percent == 50
    assert apart.high - apart.low > alike.high - alike.low > 0
    assert np.isnan(scoring.share([]).percent)


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """Two tiny episodes as a simulator leaves them: a table, something on it, and sky."""
    rng = np.random.default_rng(0)
    for seed in (7, 10):
        ids = np.zeros((3, 8, 8), np.int32)
        ids[:, 4:], ids[:, 5:, 2:4] = 2, 1
        depth = rng.uniform(0.5, 2, ids.shape).astype(np.float32) * (ids > 0)
        film = {
            "rgb": rng.integers(0, 256, (*ids.shape, 3), np.uint8), "depth": depth, "ids": ids,
            "K": np.array([[8.0, 0, 3.5], [0, 8, 3.5], [0, 0, 1]]), "cam_to_world": np.stack([np.eye(4)] * 3),
        }  # fmt: skip
        robot = {
            "gripper_to_world": np.stack([np.eye(4)] * 3), "gripper_open": np.array([1.0, 1, 0]),
            "joint_positions": rng.normal(size=(3, 7)), "actions": np.zeros((3, 4)),
        }  # fmt: skip
        facts = {
            "seed": seed, "instruction": "push it", "cameras": {"front": {}}, "ids": {"puck": 1, "top": 2},
            "roles": {role: {"must": [], "may": []} for role in roles.ROLES},
        }  # fmt: skip
        neutral.save(tmp_path / "recorded" / str(seed), facts, {"front": film, "robot": robot})
    return tmp_path / "recorded"


def test_a_neutral_folder_becomes_an_rlbench_dataset_with_its_truth_beside(
    task: Path, tmp_path: Path
) -> None:
    out = tmp_path / "data"
    convert.rlbench(task, out)
    keys = registry.adapter_for(out).episodes(out)
    assert list(keys) == list(json.loads((out / convert.TRUTH).read_text()))
    for key, seed in zip(keys, (7, 10), strict=True):
        episode, film = registry.read(out, key), neutral.arrays(task / str(seed), "front")
        view = episode.views["front"]
        assert episode.instruction == "push it"
        np.testing.assert_allclose(view.camera.K, film["K"])
        for t in range(3):
            seen = film["ids"][t] > 0
            np.testing.assert_array_equal(view.rgb(t), film["rgb"][t])
            np.testing.assert_array_equal(view.ids(t), film["ids"][t])
            np.testing.assert_allclose(view.depth(t)[seen], film["depth"][t][seen], atol=1e-5)
            assert (view.depth(t)[~seen] == convert.FAR).all()
        assert episode.robot.gripper_open.tolist() == [1, 1, 0]
    assert not any("truth" in path.name for path in (out / keys[0]).iterdir())


def test_the_roles_told_by_eye_are_complete() -> None:
    told = json.loads(roles.BY_EYE.read_text())
    assert set(told) == {f"episode{k}" for k in range(6)}
    for episode in told.values():
        taken = [one for role in roles.ROLES for one in episode[role]["must"]]
        assert len(taken) == len(set(taken))


SOLIDS = {
    "box": ("0.1 0.2 0.3", 0.048),
    "cylinder": ("0.1 0.2", 0.004 * np.pi),
    "sphere": ("0.3", 0.036 * np.pi),
}


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_covered_surface_is_closed_and_faces_outwards(kind: str) -> None:
    size, volume = SOLIDS[kind]
    xml = f'<mujoco><worldbody><geom type="{kind}" size="{size}"/></worldbody></mujoco>'
    points, normals = changed.triangles(mujoco.MjModel.from_xml_string(xml), 0)
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    assert (points[:, 0] * across).sum() / 6 == pytest.approx(volume, rel=0.03)
    assert ((across[:, None] * normals).sum(-1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_pictures_lie_as_the_mapping_of_the_twin_lays_them(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(5, 3, 3))
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    facing = across / np.linalg.norm(across, axis=1, keepdims=True)
    meant = [
        covers.coordinates(three, np.tile(one, (3, 1)), 1.0)
        for three, one in zip(points, facing, strict=True)
    ]
    np.testing.assert_allclose(changed.box(points), meant)


def test_kept_figures_add_up_to_rows() -> None:
    kept = {
        "a|robust|1": {"became": "kept", "left_out": {"recolor": "no receiver"}, "edits": []},
        "a|robust|2": {"became": "rejected", "why": "hides"},
        "b|move|1": {"became": "refused", "why": "nothing to move"},
    }
    found = {row[0]: row[1:] for row in run.rows(kept, "worked")}
    assert found["worked: robust"] == [2, 50.0, 1, 0, 1, "hides"]
    assert found["worked: all"][:2] == [3, {"value": 33.3, "target": ">= 95"}]
    assert ["worked: left out: recolor", 1, "no receiver"] in run.reasons(kept, "worked")


@settings(max_examples=20, deadline=None)
@given(number=st.integers(13, 50))
def test_recipes_in_turn_leave_none_out(number: int) -> None:
    chosen = run.asked([f"task-{k}" for k in range(number)], 2)
    given_out = [one for each in chosen.values() for one in each]
    assert {name for name, _ in given_out} == {name for name, _ in run.recipes()}
    assert all(each[0][0] == "robust" and len(each) == 3 for each in chosen.values())


def test_edits_are_told_by_medians_beside_the_twin_and_refused_tasks_apart() -> None:
    def task(psnr: float) -> dict:
        told = {"psnr": psnr, "psnr_seen": psnr + 1, "holes": 0.1, "outside": 2.0}
        return {"rpaug": told, "no edit": {"psnr": 12.0}}

    kept = {f"w|{n}|light_color": task(psnr) for n, psnr in enumerate((10.0, 20.0, 24.0))}
    (row,) = edits.rows(
        kept | {"w|3|light_color": {"refused": "why"}}, "worked", {"light_color": 30.0}
    )
    found = dict(zip(edits.COLUMNS, row, strict=True))
    assert (found["tasks"], found["refused"], found["given, dB"], found["worst task"]) == (
        3,
        1,
        20.0,
        10.0,
    )
    assert found["no better than no edit"] == 1
    assert found["short of it, dB"] == {"value": 10.0, "target": "<= 3"}
    assert found["pixels changed outside, worst"] == {"value": 2, "target": "<= 0"}
    assert edits.twins()["light_color"] > 20


def test_what_is_resized_stands_as_before(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 0.2, 0.1, 0.8
    thing = furnished.Thing("bowl_wood", 7, pose)
    larger = furnished.KINDS["object_size"].true((thing,), {"scale": 1.2})[0]
    plain, large = (np.array(one.extra(tmp_path)["points"]) for one in (thing, larger))
    assert np.ptp(large, axis=0) == pytest.approx(1.2 * np.ptp(plain, axis=0), rel=1e-6)
    assert large[:, 2].min() == pytest.approx(plain[:, 2].min(), abs=1e-9)


def test_what_truly_stands_there_follows_the_edit() -> None:
    there = tuple(furnished.Thing("bowl_wood", one, np.eye(4)) for one in (7, 8))
    aside = np.eye(4)
    aside[0, 3] = 0.1
    true = {name: kind.true for name, kind in furnished.KINDS.items()}
    assert true["remove"](there, {}) == there[1:]
    moved = true["move"](there, {"motion": aside.tolist()})
    assert moved[0].pose[0, 3] == 0.1
    assert moved[1] is there[1]
    copies = {"copies": [{"handles": {"7": 9}, "motion": aside.tolist()}]}
    assert [one.handle for one in true["duplicate"](there, copies)] == [7, 8, 9]
    spread = true["spread"](there, {"moves": [{"handles": [8], "motion": aside.tolist()}]})
    assert spread[0] is there[0]
    assert spread[1].pose[0, 3] == 0.1


def test_furnished_rows_tell_refused_tasks_apart() -> None:
    figures = {"psnr": 25.0, "psnr_seen": 26.0, "holes": 0.1, "iou": 0.99, "outside": 3.0}
    made = {"rpaug": figures, "no edit": figures | {"psnr": 12.0}}
    kept = {"w|a|move": made, "w|b|move": {"refused": "no room"}, "w|a|shadows": {"refused": "no"}}
    rows = {row[0]: row[1:] for row in furnished.rows(kept)}
    assert rows["move"][:3] == [1, 1, 25.0]
    assert rows["shadows"][:3] == [0, 1, "-"]


def test_a_thing_in_the_air_touches_nothing_and_one_inside_does() -> None:
    cloud = np.random.default_rng(0).normal(size=(500, 3))
    assert distractors._touches(cloud[:3] + 0.001, cloud)
    assert not distractors._touches(cloud[:3] + 10, cloud)


def test_cameras_move_as_far_as_their_rows_say() -> None:
    moves = cameras.bumps("open_drawer")
    assert moves == cameras.bumps("open_drawer") != cameras.bumps("close_drawer")
    for bump in moves[cameras.WITHIN].values():
        assert np.abs(bump.shift).max() <= 0.1
        assert np.abs(bump.turn).max() <= 0.05
    for bump in moves[cameras.BEYOND].values():
        assert np.linalg.norm(bump.shift) == pytest.approx(0.2)
        assert np.linalg.norm(bump.turn) == pytest.approx(np.deg2rad(15))


def test_rows_pool_squared_errors_of_all_views() -> None:
    near = {"totals": [[0.19, 100], [0.095, 50], [0.1, 25]], "flicker": 1.0, "faults": []}
    far = near | {
        "totals": [[0.01, 100], [0.005, 50], [0.1, 25]],
        "flicker": None,
        "faults": ["holes"],
    }
    moves = (cameras.WITHIN, cameras.BEYOND, cameras.WRIST)
    row = cameras.rows({"a": dict.fromkeys(moves, near), "b": dict.fromkeys(moves, far)}, "worked")[
        0
    ]
    assert row[2] == {"value": 30.0, "target": ">= 28"}
    assert row[4] == {"value": 30.0, "target": ">= 26"}
    assert row[3] == row[5] == "27.2 to 40.0"
    assert row[7:] == [25.0, 1.0, 50]


def test_what_was_left_out_or_seen_otherwise_misses_its_target(tmp_path: Path) -> None:
    one = {"images": 4, "pixels": 8, "depths": 0, "masks": 0}
    found = {"Lift": {"demo_0": one}, "Stack": {"demo_0": one, "demo_1": one | {"depths": 3}}}
    for task, demonstrations in found.items():
        (tmp_path / "compared" / task).mkdir(parents=True)
        (tmp_path / "compared" / task / "compared.json").write_text(json.dumps(demonstrations))
    lift, stack = reobserved.exactness(tmp_path, {"Lift": 0, "Stack": 1})
    assert lift[:2] == ["Lift", 1]
    assert all(pages.met(cell) for cell in lift if isinstance(cell, dict))
    assert [pages.met(cell) for cell in stack if isinstance(cell, dict)] == [False, False, True]
    assert stack[3:5] == [8, 16]
