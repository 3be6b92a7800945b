"""`rpaug verify` passes what augment writes, and names each thing that was tampered with."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest
from analytic import scene
from rpaug_adapters.rlbench.pickles import dump, load
from typer.testing import CliRunner

from rpaug import BadInput
from rpaug.cli import app
from rpaug.core.interfaces import Adapter
from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.convert import convert
from rpaug.pipeline.verify import Finding, _kept, compare, verify

EPISODES = "roll_ball/all_variations/episodes"
RECIPE = {"version": 1, "edits": [{"op": "recolor", "target": {"handle": 300}, "color": "blue"}]}


@pytest.fixture(scope="module")
def augmented(template: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("verify") / "out"
    execute(Run(template, recipe.build(RECIPE), out))
    return out


@pytest.fixture
def output(augmented: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(augmented, tmp_path / "out"))


def bad(target: Path, source: Path) -> list[Finding]:
    return [finding for finding in verify(target, source).findings if finding.level == "bad"]


def change_pickle(episode: Path) -> None:
    demo = load(episode / "low_dim_obs.pkl")
    demo._observations[1].joint_velocities[0] += 1e-9
    (episode / "low_dim_obs.pkl").write_bytes(dump(demo))


def change_words(episode: Path) -> None:
    (episode / "variation_descriptions.pkl").write_bytes(dump(["do something else"]))


def change_depth(episode: Path) -> None:
    path = sorted(episode.glob("*_depth"))[0] / "0.png"
    image = cv2.imread(str(path))
    image[0, 0] ^= 1
    cv2.imwrite(str(path), image)


def change_size(episode: Path) -> None:
    for path in (sorted(episode.glob("*_rgb"))[0]).parent.glob("*_*/*.png"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), image[:-2])


def change_camera(episode: Path) -> None:
    demo = load(episode / "low_dim_obs.pkl")
    for observation in demo._observations:
        for name, value in observation.misc.items():
            if name.endswith("_extrinsics"):
                value[:3, 3] += 0.01
    (episode / "low_dim_obs.pkl").write_bytes(dump(demo))


def change_source(episode: Path) -> None:
    given = json.loads((episode / "rpaug.json").read_bytes())
    (episode / "rpaug.json").write_text(json.dumps(given | {"source": "nowhere"}))


def change_field(episode: Path) -> None:
    demo = load(episode / "low_dim_obs.pkl")
    demo._observations[1].misc["front_camera_far"] += 1e-9
    (episode / "low_dim_obs.pkl").write_bytes(dump(demo))


def add_file(episode: Path) -> None:
    (episode / "variation_number.pkl").write_bytes(dump(7))


def lose_report(episode: Path) -> None:
    (episode / "rpaug.json").unlink()


def spoil_report(episode: Path) -> None:
    (episode / "rpaug.json").write_text("{")


def spoil_colors(episode: Path) -> None:
    for path in sorted(episode.glob("*_rgb"))[0].glob("*.png"):
        cv2.imwrite(str(path), 255 - cv2.imread(str(path)))


def leave_gap(episode: Path) -> None:
    episode.rename(episode.with_name("episode7"))


def test_what_augment_writes_passes(augmented: Path, template: Path) -> None:
    verdict = verify(augmented, template, frames=None)
    assert verdict.passed, verdict.findings
    assert verdict.episodes == 2
    assert verdict.statistics["rgb, output"] != verdict.statistics["rgb, source"]
    assert any("128x128" in finding.message for finding in verdict.findings)  # RVT's trap


@pytest.mark.parametrize(
    ("tamper", "topic"),
    [
        (change_pickle, "robot"),
        (change_words, "instruction"),
        (change_depth, "untouched images"),
        (change_size, "size"),
        (change_camera, "camera"),
        (change_source, "source"),
        (change_field, "untouched data"),
        (add_file, "untouched data"),
        (lose_report, "report"),
        (spoil_report, "report"),
        (spoil_colors, "images beyond the report"),
        (leave_gap, "numbering"),
    ],
)
def test_tampering_is_found(
    output: Path, template: Path, tamper: Callable[[Path], None], topic: str
) -> None:
    tamper(output / EPISODES / "episode1")
    assert topic in {finding.topic for finding in bad(output, template)}


def test_a_run_that_has_not_ended_is_named(output: Path, template: Path) -> None:
    (output / "rpaug.summary.json").unlink()
    (said,) = bad(output, template)
    assert said.message == (
        "the run that made these 2 has not ended: the same command with --resume goes on"
    )


def test_data_that_is_gone_new_or_changed_is_named() -> None:
    adapter = cast(Adapter, SimpleNamespace(untouched=lambda held, _: held))
    before, after = ({"a": b"1", "b": b"2", "c": b"3"}, {"a": b"1", "c": b"4", "d": b"5"})
    found = _kept(adapter, "k", cast(Any, before), cast(Any, after), {"draws": []})
    assert [one.message.split(",")[0] for one in found] == ["b: gone", "c: changed", "d: new"]


def test_another_dataset_than_the_source_is_refused(
    augmented: Path, template: Path, tmp_path: Path
) -> None:
    other = tmp_path / "in" / "other"
    shutil.copytree(template / EPISODES / "episode0", other / "episodes" / "episode0")
    with pytest.raises(BadInput, match="expected the dataset that was the source"):
        verify(augmented, other)


def test_a_copy_in_another_split_is_a_leak(augmented: Path, template: Path, tmp_path: Path) -> None:
    shutil.copytree(augmented, tmp_path / "data" / "train")
    shutil.copytree(template, tmp_path / "source" / "val")
    for path in (tmp_path / "data").rglob("rpaug.json"):
        given = json.loads(path.read_bytes())
        path.write_text(json.dumps(given | {"source": f"val/{given['source']}"}))
    found = {finding.topic for finding in bad(tmp_path / "data", tmp_path / "source")}
    assert found == {"splits"}


def test_the_command_says_what_is_wrong(output: Path, template: Path, tmp_path: Path) -> None:
    def run(*more: object) -> tuple[int, str, str]:
        given = ["verify", output, "--against", template, *more]
        result = CliRunner().invoke(app, [str(argument) for argument in given])
        return result.exit_code, result.stdout, result.stderr

    code, out, _ = run()
    assert code == 0
    assert "what no edit reaches are as recorded" in out.splitlines()[-1]
    assert "Whether edits look right is not judged" in out.splitlines()[-1]
    replay = tmp_path / "replay"
    replay.mkdir()
    assert run("--replay", replay)[0] == 0
    (replay / "0.replay").touch()
    code, _, words = run("--replay", replay)
    assert code == 1
    assert "delete it" in words
    change_pickle(output / EPISODES / "episode0")
    code, out, _ = run("--json")
    assert code == 1
    described = json.loads(out)
    assert not described["passed"]
    wrong = [one["topic"] for one in described["findings"] if one["level"] == "bad"]
    assert wrong == ["robot", "untouched data"]


def test_depth_that_no_longer_fits_the_cameras_is_found() -> None:
    episode = scene({"front": (1.6, 0.3, 1.0), "left": (1.2, 1.0, 1.0)}, length=2).episode
    left = episode.views["left"]
    assert left.depth is not None
    farther = replace(left, depth=lambda t: left.depth(t) + np.float32(0.008))  # type: ignore[misc]
    given = {"source": "x", "draws": [{"op": "camera_pose"}]}  # which may change depth
    assert not list(compare("x", episode, episode, given))
    found = list(
        compare("x", episode, replace(episode, views={**episode.views, "left": farther}), given)
    )
    assert {finding.topic for finding in found} == {"depth and cameras"}


def test_depth_left_as_it_was_under_a_moved_camera_is_found() -> None:
    """What a reader turns into points in the wrong place, though the cameras that did not move agree as before."""
    around = {"front": (1.6, 0.3, 1.0), "left": (1.2, 1.0, 1.0), "right": (1.2, -1.0, 1.0)}
    recorded = scene(around, length=2).episode
    moved = scene(around | {"front": (1.6, 0.3, 1.05)}, length=2).episode
    given = {"source": "x", "draws": [{"op": "camera_pose"}]}
    assert not list(compare("x", recorded, moved, given))
    stale = replace(moved.views["front"], depth=recorded.views["front"].depth)
    episode = replace(moved, views={**moved.views, "front": stale})
    found = list(compare("x", recorded, episode, given))
    assert {finding.topic for finding in found} == {"depth and cameras"}
    assert all("front" in finding.message and "stale" in finding.message for finding in found)


def shown(**changes: object) -> list[str]:
    """Topics found in the analytic episode after some of its fields were replaced."""
    episode = scene({"front": (1.6, 0.3, 1.0), "left": (1.2, 1.0, 1.0)}, length=2).episode
    front = episode.views["front"]
    one = {
        "shorter": lambda: replace(episode, length=1),
        "without a camera": lambda: replace(episode, views={"front": front}),
        "without depth": lambda: replace(
            episode, views={**episode.views, "front": replace(front, depth=None)}
        ),
        "of floats": lambda: replace(
            episode,
            views={**episode.views, "front": replace(front, rgb=lambda t: front.rgb(t) / 1.0)},
        ),
        "another pixel": lambda: replace(
            episode,
            views={**episode.views, "front": replace(front, rgb=lambda t: front.rgb(t) ^ 1)},
        ),
    }
    given = {"source": "x", "synthetic": True, "draws": changes.get("draws", [])}
    return [found.topic for found in compare("x", episode, one[str(changes["how"])](), given)]


@pytest.mark.parametrize(
    ("how", "topic"),
    [
        ("shorter", "length"),
        ("without a camera", "cameras"),
        ("without depth", "depth"),
        ("of floats", "kind of image"),
        ("another pixel", "untouched images"),
    ],
)
def test_what_is_missing_or_of_another_kind_is_found(how: str, topic: str) -> None:
    assert shown(how=how) == [topic]


def test_an_edit_that_shows_nothing_is_noted() -> None:
    episode = scene({"front": (1.6, 0.3, 1.0)}, length=2).episode
    given = {"source": "x", "synthetic": True, "draws": [{"op": "light_color"}]}
    assert [found.topic for found in compare("x", episode, episode, given)] == ["statistics"]


def test_a_lost_episode_is_counted(output: Path, template: Path) -> None:
    shutil.rmtree(output / EPISODES / "episode1")
    assert [finding.topic for finding in bad(output, template)] == ["counts"]


def test_wrong_counts_of_a_tfds_dataset_are_found(template: Path, tmp_path: Path) -> None:
    convert(template, tmp_path / "rlds", "rlds")
    assert verify(tmp_path / "rlds", template).passed
    path = next((tmp_path / "rlds").rglob("dataset_info.json"))
    given = json.loads(path.read_bytes())
    given["splits"][0]["numBytes"] = "7"
    path.write_text(json.dumps(given))
    (found,) = bad(tmp_path / "rlds", template)
    assert (found.topic, "dataset_info.json: train: numBytes: found 7;" in found.message) == (
        "dataset",
        True,
    )


def test_wrong_statistics_of_a_lerobot_dataset_are_found(template: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    convert(template, tmp_path / "out", "lerobot", fps=20)
    assert verify(tmp_path / "out", template).passed
    path = next((tmp_path / "out").rglob("stats.json"))
    given = json.loads(path.read_bytes())
    given["action"]["mean"][0] += 1
    path.write_text(json.dumps(given))
    (found,) = bad(tmp_path / "out", template)
    assert (found.topic, "stats.json: action: mean: found" in found.message) == ("dataset", True)
    described = path.with_name("info.json")
    described.write_text(json.dumps(json.loads(described.read_bytes()) | {"total_frames": 3}))
    assert any(
        "info.json: total_frames: found 3;" in one.message
        for one in bad(tmp_path / "out", template)
    )
