"""Datasets in another layout hold the same images, cameras, words and robot."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rolling import demonstration
from rpaug_adapters.rlbench import RLBench
from rpaug_adapters.rlds import RLDS
from typer.testing import CliRunner

from rpaug import BadInput, Episode, Robot, Unsupported
from rpaug.cli import app
from rpaug.core import keyframes, registry
from rpaug.pipeline import compare_layouts
from rpaug.pipeline.convert import convert
from rpaug.pipeline.verify import verify


def episodes(root: Path) -> list[Episode]:
    adapter = registry.adapter_for(root)
    return [adapter.read(root, key) for key in adapter.episodes(root)]


def assert_alike(before: Episode, after: Episode, *, exact: bool = True) -> None:
    assert after.length == before.length
    assert after.instruction == before.instruction
    for name, view in before.views.items():
        other = after.views[name]
        assert np.allclose(other.camera.K, view.camera.K)
        assert np.allclose(other.camera.cam_to_world, view.camera.cam_to_world, atol=1e-12)
        for t in range(before.length):
            assert np.array_equal(other.rgb(t), view.rgb(t)) or not exact
            assert view.depth is not None
            assert other.depth is not None
            assert np.allclose(other.depth(t), view.depth(t), atol=0 if exact else 1e-6)
            assert view.ids is not None
            assert other.ids is not None
            assert np.array_equal(other.ids(t), view.ids(t))
    for name in ("joint_positions", "joint_velocities", "gripper_to_world", "gripper_open"):
        assert np.allclose(getattr(after.robot, name), getattr(before.robot, name), atol=1e-5), name


def test_there_and_back_through_rlds(template: Path, tmp_path: Path) -> None:
    done = convert(template, tmp_path / "rlds", "rlds")
    assert (done.episodes, done.failures, done.exit_code) == (2, {}, 0)
    info = json.loads(next((tmp_path / "rlds").rglob("dataset_info.json")).read_text())
    assert [split["name"] for split in info["splits"]] == ["train"]
    assert info["splits"][0]["shardLengths"] == ["2"]
    recorded, there = episodes(template), episodes(tmp_path / "rlds")
    for before, after in zip(recorded, there, strict=True):
        assert_alike(before, after)
    convert(tmp_path / "rlds", tmp_path / "back", "rlbench")
    for before, after in zip(recorded, episodes(tmp_path / "back"), strict=True):
        assert_alike(before, after)


def test_the_card_of_a_conversion(template: Path, tmp_path: Path) -> None:
    convert(template, tmp_path / "out", "rlds", licence="CC-BY-4.0")
    card = (tmp_path / "out/README.md").read_text()
    header = yaml.safe_load(card.split("---")[1])
    assert header["synthetic"] is False
    assert header["license"] == "CC-BY-4.0"
    assert header["episodes"] == {"recorded": 2, "synthetic": 0}
    assert "in the layout `rlds`" in card
    assert "the layout `rlbench`" in card
    assert "| train | 2 | 0 |" in card
    assert "Recipe" not in card


def test_rdt_says_what_its_reader_drops(template: Path, tmp_path: Path) -> None:
    done = convert(template, tmp_path / "rdt", "rdt")
    assert done.episodes == 2
    assert any(
        "fewer than 128 steps" in words and count == 2 for words, count in done.traps.items()
    )
    for before, after in zip(episodes(template), episodes(tmp_path / "rdt"), strict=True):
        arms = after.robot.extra["observations/qpos"]  # what RDT's reader takes
        assert np.array_equal(arms[:, 7:13], before.robot.joint_positions[:, :6])


def test_bridge_has_no_joints_for_rdt(samples: Path, tmp_path: Path) -> None:
    done = convert(samples / "rlds_bridge", tmp_path / "rdt", "rdt")
    assert done.exit_code == 2
    assert not (tmp_path / "rdt").exists()
    assert all("joint positions" in reason for reason in done.failures.values())


def test_nothing_is_overwritten(template: Path, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(BadInput, match="already"):
        convert(template, tmp_path / "there", "rlds")


def test_nothing_is_written_into_the_dataset(template: Path) -> None:
    with pytest.raises(BadInput, match="inside the dataset; expected a path outside it"):
        convert(template, template / "rdt", "rdt")
    assert registry.adapter_for(template).name == "rlbench"


def test_a_source_without_words_is_told(template: Path, tmp_path: Path) -> None:
    silent = Path(shutil.copytree(template, tmp_path / "in"))
    for path in silent.rglob("variation_descriptions.pkl"):
        path.unlink()
    done = convert(silent, tmp_path / "out", "rlds")
    assert [count for words, count in done.traps.items() if "no instruction" in words] == [2]


def test_an_unknown_layout_is_named(template: Path, tmp_path: Path) -> None:
    given = ["convert", str(template), "--to", "zip", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 2
    assert "rlds" in result.stderr
    given[3] = "rlds"
    result = CliRunner().invoke(app, [*given, "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["episodes"] == 2


LAYOUTS = ("rlbench", "rlds", "rdt", "hdf5_sim", "lerobot")
RATE = 20


def rich(folder: Path) -> Path:
    """An RLBench episode with all that one holds: three descriptions, flags that change, forces, velocities."""
    episode = demonstration(8)
    flags = np.arange(8.0)[:, None] % 3 == 1
    rng = np.random.default_rng(0)
    robot = replace(
        episode.robot,
        joint_velocities=rng.normal(size=episode.robot.joint_positions.shape),
        extra={"ignore_collisions": flags.astype(float), "joint_forces": rng.normal(size=(8, 7))},
    )
    words = ("roll the red ball", "push the ball", "move the red thing")
    made = replace(episode, robot=robot, descriptions=words)
    RLBench().write(made, folder, "roll_ball/all_variations/episodes/episode0", dict)
    return folder


@pytest.mark.parametrize("layout", ["rlds", "rdt"])
def test_a_round_trip_loses_nothing_of_words_and_robot(tmp_path: Path, layout: str) -> None:
    source = rich(tmp_path / "in")
    convert(source, tmp_path / "there", layout)
    back = convert(tmp_path / "there", tmp_path / "back", "rlbench")
    assert back.episodes == 1
    ((before,), (after,)) = episodes(source), episodes(tmp_path / "back")
    assert after.descriptions == before.descriptions
    assert keyframes.find(after.robot) == keyframes.find(before.robot)
    assert after.robot.joint_positions.shape == before.robot.joint_positions.shape
    assert np.allclose(after.robot.joint_velocities, before.robot.joint_velocities, atol=1e-6)
    assert after.robot.extra.keys() == before.robot.extra.keys()
    for name, track in before.robot.extra.items():
        assert np.allclose(after.robot.extra[name], track, atol=1e-6), name


def test_nothing_is_made_up_for_rlbench(template: Path, tmp_path: Path) -> None:
    episode = replace(demonstration(6), source=None)
    still = np.zeros((6, 0))
    bare = replace(episode, robot=replace(episode.robot, joint_velocities=still, extra={}))
    with pytest.raises(Unsupported, match="--fps"):
        RLBench().write(bare, tmp_path, "a/episode0", dict)
    RLBench().write(replace(bare, rate=20.0), tmp_path, "a/episode1", dict)
    made = RLBench().read(tmp_path, "a/episode1")
    assert "ignore_collisions" not in made.robot.extra
    wanted = np.gradient(bare.robot.joint_positions, 1 / 20, axis=0)
    assert np.allclose(made.robot.joint_velocities, wanted)
    found = list(compare_layouts.compare("x", bare, made, [0]))
    assert "joint_velocities: worked out, the source has none" in [one[3] for one in found]
    assert any("pixels without depth" in one[3] for one in found)  # RLBench has no code for those
    assert {one[0] for one in found} == {"near"}


def test_what_is_lost_is_said_and_recorded(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    source = rich(tmp_path / "in")
    given = ["convert", str(source), "--out", str(tmp_path / "out"), "--to", "lerobot"]
    refused = CliRunner().invoke(app, given)
    assert refused.exit_code == 2
    assert "--fps" in refused.output + refused.stderr
    result = CliRunner().invoke(app, [*given, "--fps", "20"])
    assert result.exit_code == 0
    words = "front: color is encoded with loss, 34 dB or more near"
    assert f"not kept exactly {words}" in result.output + result.stderr
    assert f"- {words} (episodes: 1)" in (tmp_path / "out/README.md").read_text()
    (report,) = (tmp_path / "out").rglob("rpaug.json")
    assert words in json.loads(report.read_text())["lost"]
    verdict = verify(tmp_path / "out", source, frames=2)
    assert verdict.passed
    assert words in [one.message for one in verdict.findings]
    # What the conversion did not say is no loss but damage.
    report.write_text(json.dumps(json.loads(report.read_text()) | {"lost": []}))
    assert not verify(tmp_path / "out", source, frames=2).passed


def test_names_come_back_and_policies_take_nothing_wrong_for_state(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    episode = replace(demonstration(6), rate=5.0)
    rng = np.random.default_rng(0)
    names = ("reward", "observation/state", "observation/language_embedding", "action/turn")
    extra = {name: rng.normal(size=(6, 3)) for name in names}
    robot = Robot(np.zeros((6, 0)), np.zeros((6, 0)), None, None, extra)
    episode = replace(episode, robot=robot, source=None)
    RLDS().write(episode, tmp_path / "in", "a/1.0.0/train/0", dict)
    RLDS().finish(tmp_path, tmp_path / "in")
    convert(tmp_path / "in", tmp_path / "there", "lerobot")
    info = json.loads(next((tmp_path / "there").rglob("info.json")).read_text())
    assert info["fps"] == 5
    wanted = {"reward", "observation.state", "language_embedding", "action.turn"}
    assert wanted <= {*info["features"]}
    assert "action" not in info["features"]
    convert(tmp_path / "there", tmp_path / "back", "rlds")
    ((before,), (after,)) = episodes(tmp_path / "in"), episodes(tmp_path / "back")
    assert after.rate == before.rate
    for name in ("reward", "observation/state", "action/turn"):
        assert np.array_equal(after.robot.extra[name], before.robot.extra[name]), name
    vectors = before.robot.extra["observation/language_embedding"]
    assert np.array_equal(after.robot.extra["language_embedding"], vectors)


def test_what_only_its_layout_holds_is_listed(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RLBench, "unshared", lambda *_: ["seed"])
    done = convert(template, tmp_path / "rlds", "rlds")
    assert done.lost["seed: the layout has no place for it"] == done.episodes
    assert "- seed: the layout has no place for it" in (tmp_path / "rlds/README.md").read_text()


def test_a_rate_that_contradicts_the_source_is_refused(tmp_path: Path) -> None:
    episode = replace(demonstration(6), rate=5.0, source=None)
    RLDS().write(episode, tmp_path / "in", "a/1.0.0/train/0", dict)
    done = convert(tmp_path / "in", tmp_path / "out", "rlbench", fps=20)
    assert done.exit_code == 2
    assert all("5 frames a second, and --fps says 20" in words for words in done.failures.values())


@pytest.fixture(scope="module")
def in_every_layout(template: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    folder = tmp_path_factory.mktemp("layouts")
    for layout in LAYOUTS[1:]:
        convert(template, folder / layout, layout, fps=RATE)
    return {"rlbench": template} | {layout: folder / layout for layout in LAYOUTS[1:]}


@pytest.mark.parametrize("to", LAYOUTS)
@pytest.mark.parametrize("source", LAYOUTS)
def test_every_layout_becomes_every_other(
    in_every_layout: dict[str, Path], source: str, to: str, tmp_path: Path
) -> None:
    if source == to:
        return
    done = convert(in_every_layout[source], tmp_path / "out", to, fps=RATE)
    assert (done.episodes, done.failures) == (2, {})
    verdict = verify(tmp_path / "out", in_every_layout[source], frames=2)
    assert verdict.passed, verdict.findings
    assert verdict.episodes == 2


def test_a_converted_episode_that_was_spoilt_is_found(template: Path) -> None:
    (episode, _) = episodes(template)
    front = episode.views["front"]

    def topics(**changes: object) -> set[str]:
        view = replace(front, **changes)
        made = replace(episode, views={**episode.views, "front": view})
        return {found[2] for found in compare_layouts.compare("x", episode, made, [0, 3])}

    assert topics() == set()
    assert topics(rgb=lambda t: 255 - front.rgb(t)) == {"images"}
    assert topics(depth=lambda t: front.depth(t) + 0.01) == {"depth"}
    assert topics(ids=lambda t: front.ids(t) + 1) == {"ids"}
    assert topics(camera=replace(front.camera, assumed=True)) == {"camera"}
    moved = front.camera.cam_to_world + np.eye(4)[3] * 0.01
    assert topics(camera=replace(front.camera, cam_to_world=moved)) == {"camera"}
    swapped = dict(zip(episode.views, reversed(episode.views.values()), strict=True))
    found = {
        one[2]
        for one in compare_layouts.compare("x", episode, replace(episode, views=swapped), [0])
    }
    assert found == {"images"}
    other = replace(episode, descriptions=("do nothing",))
    assert [one[2] for one in compare_layouts.compare("x", episode, other, [0])] == ["instruction"]
    shorter = replace(episode, length=3)
    assert [one[2] for one in compare_layouts.compare("x", episode, shorter, [0])] == ["length"]
    robot = replace(episode.robot, joint_positions=episode.robot.joint_positions + 0.1)
    bent = replace(episode, robot=robot)
    assert [one[2] for one in compare_layouts.compare("x", episode, bent, [0])] == ["robot"]


def test_an_episode_that_reads_otherwise_is_taken_back(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = RLDS.write

    def spoiling(self: RLDS, episode: Episode, *where: Any) -> None:
        front = episode.views["front"]
        if episode.key.endswith("episode1"):
            spoilt = replace(front, ids=lambda t: front.ids(t) + 1)
            episode = replace(episode, views={**episode.views, "front": spoilt})
        write(self, episode, *where)

    monkeypatch.setattr(RLDS, "write", spoiling)
    done = convert(template, tmp_path / "out", "rlds")
    (why,) = done.failures.values()
    assert "written, it reads otherwise: ids: front: off by" in why
    assert done.episodes == len(RLDS().episodes(tmp_path / "out")) == 1


def test_images_with_less_light_that_have_no_place_are_said(template: Path) -> None:
    (episode, *_) = episodes(template)
    views = {
        name: replace(view, radiance=lambda t, view=view: view.rgb(t).astype(float))
        for name, view in episode.views.items()
    }
    (found, *_) = compare_layouts.compare("a", replace(episode, views=views), episode, [0])
    assert found[0] == "lost"
    assert "images with less light" in found[3]


def test_uneven_times_are_said(template: Path) -> None:
    recorded = registry.read(template, None)
    times = np.arange(recorded.length) / 10
    for shift, wanted in ((0.0, 0), (0.01, 1)):
        times[1] += shift
        robot = replace(recorded.robot, extra={**recorded.robot.extra, "seconds": times[:, None]})
        made = replace(recorded, rate=10.0)
        found = compare_layouts.compare("", replace(recorded, robot=robot), made, [0])
        assert sum(topic == "rate" for _, _, topic, _ in found) == wanted


def test_numbers_that_float32_rounds_are_said(template: Path) -> None:
    recorded = registry.adapter("rlbench").read(
        template, "roll_ball/all_variations/episodes/episode0"
    )
    ticks = 1.7e12 + 100.0 * np.arange(recorded.length)[:, None]

    def told(track: np.ndarray) -> list[str]:
        one, other = (
            replace(recorded, robot=replace(recorded.robot, extra={"stamp": rows}))
            for rows in (ticks, track)
        )
        return [words for *_, words in compare_layouts.compare("a", one, other, [0])]

    assert told(ticks) == []
    (words,) = told(ticks.astype(np.float32).astype(float))
    assert words == "stamp: numbers too large for float32 are rounded"
