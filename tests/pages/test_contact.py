"""The contact sheet of an output folder, whatever the number of its episodes."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from analytic import EYES, scene

from rpaug.core.types import Episode, Robot
from rpaug.pages import contact
from rpaug.pipeline import journal, report


def test_some_augmented_episodes_are_shown_and_their_reports_alone_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = [f"train/{number}" for number in range(61)]
    for number, key in enumerate(keys):  # recorded and augmented ones by turns
        (tmp_path / key).mkdir(parents=True)
        described = {"synthetic": bool(number % 2), "source": key}
        (tmp_path / key / report.NAME).write_text(json.dumps(described))
    (tmp_path / report.SUMMARY).write_text(json.dumps({"recipe": {}}))
    read, of = list[Path](), report.of
    monkeypatch.setattr(report, "of", lambda path: read.append(path) or of(path))
    monkeypatch.setattr(contact, "_section", lambda _a, _s, _t, key, _d, _rows: f"<p>{key}")
    held = SimpleNamespace(episodes=lambda _: [*keys, "rejected/train/0"])
    page = contact.write(held, tmp_path, tmp_path).read_text()  # type: ignore[arg-type]
    assert "61 episodes, 8 augmented ones shown" in page
    shown = [int(part.split("<")[0]) for part in page.split("<p>train/")[1:]]
    assert all(number % 2 for number in shown)
    assert shown == sorted(set(shown))
    assert shown[0] == 1
    assert max(b - a for a, b in pairwise(shown)) < 14  # over the whole
    assert len(read) < 20


def test_episodes_that_lack_no_edit_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = [f"train/{number}" for number in range(20)]
    lines = []
    for key in keys:
        (tmp_path / key).mkdir(parents=True)
        described = {"synthetic": True, "source": key}
        (tmp_path / key / report.NAME).write_text(json.dumps(described))
        left_out = None if key in ("train/5", "train/18") else "nothing fits"
        draws = [[0, 0, left_out, {}], [1, 0, "no table" if key == "train/1" else None, {}]]
        lines.append({"made": key if key != "train/18" else "train/99", "facts": {"draws": draws}})
    lines.append({"renamed": "train/99", "to": "train/18"})
    journal.append(tmp_path, lines, durable=False)
    (tmp_path / report.SUMMARY).write_text(json.dumps({"recipe": {}}))
    monkeypatch.setattr(contact, "_section", lambda _a, _s, _t, key, _d, _rows: f"<p>{key}")
    held = SimpleNamespace(episodes=lambda _: keys)
    page = contact.write(held, tmp_path, tmp_path).read_text()  # type: ignore[arg-type]
    shown = [int(part.split("<")[0]) for part in page.split("<p>train/")[1:]]
    assert shown[:2] == [5, 18]
    assert len(shown) == contact.MOST_EPISODES
    assert 1 not in shown  # it lacks all


def test_each_shown_frame_says_how_much_of_it_changed() -> None:
    view = scene(EYES, length=3).episode.views["front"]

    def edited(t: int) -> np.ndarray:
        out = view.rgb(t).copy()
        out[:40] = ~out[:40] if t == 1 else out[:40]
        out[0, 0] = ~out[0, 0] if t == 2 else out[0, 0]
        return out

    words = contact._by_frame(view, replace(view, rgb=edited), range(3))
    assert words == "frame 0: unchanged, frame 1: 50 %, frame 2: under 1 %"
    coded = replace(view, rgb=lambda t: view.rgb(t) ^ 1)  # a file's own error, a level everywhere
    assert contact._by_frame(view, coded, range(1)) == "frame 0: under 1 %"


def test_a_recorded_episode_is_read_once_for_its_copies(tmp_path: Path) -> None:
    keys = [f"episode{number}" for number in range(6)]
    for number, key in enumerate(keys):
        described = {"synthetic": True, "source": f"episode{number // 3}", "copy": number % 3 + 1}
        (tmp_path / key).mkdir()
        described |= {"changed_share": {}, "draws": []}
        (tmp_path / key / report.NAME).write_text(json.dumps(described))
    (tmp_path / report.SUMMARY).write_text(json.dumps({"recipe": {}}))
    recorded, read = scene(EYES, length=2).episode, list[str]()
    robot = replace(recorded.robot, joint_velocities=np.ones((2, 7)))
    recorded = replace(recorded, robot=robot, descriptions=("roll it",))
    source = tmp_path / "source"

    def take(root: Path, key: str) -> Episode:
        if root == source:
            read.append(key)
        return recorded

    held = SimpleNamespace(episodes=lambda _: keys, read=take)
    page = contact.write(held, source, tmp_path).read_text()  # type: ignore[arg-type]
    assert all(f"copy {1 + number % 3} of episode{number // 3}" in page for number in range(6))
    assert read == ["episode0", "episode1"]


@pytest.mark.parametrize(("cameras", "copies", "rows"), [(1, 1, 3), (1, 2, 1), (2, 1, 1)])
def test_one_camera_of_one_episode_is_shown_at_more_times(
    cameras: int, copies: int, rows: int, tmp_path: Path
) -> None:
    keys = [f"clip_{number}" for number in range(copies)]
    for number, key in enumerate(keys):
        told = {"synthetic": True, "source": "clip", "copy": number + 1, "changed_share": {}}
        (tmp_path / key).mkdir()
        (tmp_path / key / report.NAME).write_text(json.dumps(told | {"draws": []}))
    (tmp_path / report.SUMMARY).write_text(json.dumps({"recipe": {}}))
    recorded = scene(EYES, length=20).episode
    views = dict(list(recorded.views.items())[:cameras])
    still = Robot(np.zeros((20, 0)), np.zeros((20, 0)), None, None)
    recorded = replace(recorded, views=views, robot=still, descriptions=("roll it",))
    held = SimpleNamespace(episodes=lambda _: keys, read=lambda root, key: recorded)
    page = contact.write(held, tmp_path / "source", tmp_path).read_text()  # type: ignore[arg-type]
    assert page.count("<img") == rows * cameras * copies
    assert page.count("frame 19:") == cameras * copies


EVIL = "<script>alert(1)</script>"


@pytest.mark.parametrize("part", ["key", "source", "camera", "instruction", "recipe", "edit", "op"])
def test_no_part_of_a_page_is_markup_of_others(part: str, tmp_path: Path) -> None:
    """Names of episodes, cameras and files, instructions, and what recipes say."""
    said = {part: EVIL.replace("/", "|")}  # a key goes on after a slash
    recorded = scene(EYES, length=2).episode
    views = {said.get("camera", name): view for name, view in recorded.views.items()}
    robot = replace(recorded.robot, joint_velocities=np.ones((2, 7)))
    recorded = replace(
        recorded, views=views, robot=robot, descriptions=(said.get("instruction", "roll it"),)
    )
    key = said.get("key", "episode0")
    (tmp_path / key).mkdir()
    described = {
        "synthetic": True,
        "source": said.get("source", "episode0"),
        "copy": 1,
        "changed_share": dict.fromkeys(views, 0.5),
        "draws": [{"op": said.get("op", "recolor"), "edit": {"word": said.get("edit", "red")}}],
    }
    (tmp_path / key / report.NAME).write_text(json.dumps(described))
    (tmp_path / report.SUMMARY).write_text(json.dumps({"recipe": {"a": said.get("recipe", "")}}))
    held = SimpleNamespace(episodes=lambda _: [key], read=lambda *_: recorded)
    page = contact.write(held, tmp_path, tmp_path).read_text()  # type: ignore[arg-type]
    assert "&lt;script&gt;alert(1)" in page
    assert "<script" not in page


def test_a_camera_that_is_black_throughout_is_left_out_with_a_line(tmp_path: Path) -> None:
    recorded = scene(EYES, length=2).episode
    robot = replace(recorded.robot, joint_velocities=np.ones((2, 7)))
    first, late = list(recorded.views)[:2]
    views = dict(recorded.views)
    dark = np.zeros_like(views[first].rgb(0))
    views[first] = replace(views[first], rgb=lambda t: dark)
    lit = views[late].rgb
    views[late] = replace(views[late], rgb=lambda t: lit(t) if t else np.zeros_like(lit(t)))
    recorded = replace(recorded, robot=robot, views=views)
    described = {"synthetic": True, "source": "a", "copy": 1, "draws": []}
    described |= {"changed_share": dict.fromkeys(views, 1.0), "mean_change": {late: 3.25}}
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / report.NAME).write_text(json.dumps(described))
    (tmp_path / report.SUMMARY).write_text(json.dumps({"recipe": {}, "mean_change": {late: 3.25}}))
    held = SimpleNamespace(episodes=lambda _: ["a"], read=lambda *_: recorded)
    page = contact.write(held, tmp_path, tmp_path).read_text()  # type: ignore[arg-type]
    assert f"Black throughout, left out: {first}." in page
    assert page.count("<figure") == len(views) - 1
    assert "100.0 % of pixels changed, by 3.2 of 255 levels over all" in page
    assert f"{late} 3.2" in page


def test_the_mean_change_is_over_all_pixels_of_all_frames() -> None:
    tally = report.Tally(["front"])
    before = np.full((4, 4, 3), 100, np.uint8)
    after = before.copy()
    after[:2] = 96
    tally.frame("front", 0, before, after, 0.0)
    tally.frame("front", 1, before, before, 0.0)
    assert tally.summary()["mean_change"] == {"front": 1.0}
    assert tally.summary()["changed_share"] == {"front": 0.25}
