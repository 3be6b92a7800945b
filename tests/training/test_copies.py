"""An epoch shows exactly the copies that `rpaug augment` writes: every shipped recipe, gates and redraws included."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import boxes
import numpy as np
import pytest
import rpaug_recipes
from rpaug_adapters.rlbench import RLBench
from rpaug_adapters.rlbench.write import FAR
from runs import augment

from rpaug import Episode, Recipe
from rpaug.core.files import REJECTED
from rpaug.core.registry import SAMPLE
from rpaug.pipeline import copies, inputs, report
from rpaug.training import AugmentedEpisodes, drawing

pytestmark = pytest.mark.usefixtures("tracked_once")
EYES = dict(zip(("front", "left_shoulder", "right_shoulder"), boxes.EYES.values(), strict=True))
FRAMES = [0, 6, 15]  # before the grasp, carried, let go
STEP = 1e-6  # metres: RLBench's depth has 2^24 steps from 1 cm to 10 m
FOLDER = Path(rpaug_recipes.__file__).parent
SHIPPED = sorted(
    path.relative_to(FOLDER).with_suffix("").as_posix()
    for path in [*FOLDER.glob("*.yaml"), *FOLDER.glob("colosseum/*.yaml")]
    if path.name != inputs.FILE
)
PAINT = {"op": "recolor", "target": {"handle": 300}, "color": {"sample": "colosseum"}}
BUMP = {"op": "camera_pose", "camera": "front", "shift": 0.15, "turn": 0.05}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small episode with a manipulated thing, a receiver, a blue thing apart, and cameras called as RLBench's."""
    world = boxes.pick_and_place()
    thin = {
        n: replace(box, poses=box.poses[::2])
        for n, box in world.boxes.items()
        if box.poses.ndim == 3
    }
    painted = {
        boxes.PAD: replace(world.boxes[boxes.PAD], color=(200, 0, 0)),
        boxes.OTHER: replace(world.boxes[boxes.OTHER], color=(0, 0, 200)),
    }
    world = replace(
        world,
        boxes={**world.boxes, **thin, **painted},
        gripper=world.gripper[::2],
        gripper_open=world.gripper_open[::2],
        eyes=EYES,
    )
    episode = world.episode()
    root = tmp_path_factory.mktemp("placed")
    RLBench().write(episode, root, "place_box/all_variations/episodes/episode0", dict)
    return root


def with_copies(recipe: Any, count: int) -> Recipe:
    return inputs.recipe(recipe, [f"copies={count}"])


def written(out: Path) -> dict[int, tuple[Episode, dict]]:
    """What a run wrote, by the number of the copy, and its reports; rejected copies among it."""
    found = {}
    for root in (out, out / REJECTED):
        for key in RLBench().episodes(root) if root.is_dir() else ():
            given = json.loads((root / key / report.NAME).read_bytes())
            found[given["copy"]] = RLBench().read(root, key), given
    return found


def assert_shown(item: dict[str, Any], wanted: Episode) -> None:
    """The item is that episode: byte for byte, but for depth, which its file keeps in steps up to the far plane."""
    assert item["instruction"] == wanted.instruction
    assert item["cameras"].keys() == wanted.views.keys()
    for name, view in wanted.views.items():
        shown = item["cameras"][name]
        assert np.array_equal(shown["K"], view.camera.K)
        frames = item["frames"].tolist()
        assert np.array_equal(shown["cam_to_world"], view.camera.cam_to_world[frames])
        assert view.depth is not None
        assert view.ids is not None
        for row, t in enumerate(frames):
            assert np.array_equal(shown["rgb"][row], view.rgb(t)), (name, t)
            assert np.array_equal(shown["ids"][row], view.ids(t)), (name, t)
            depth = np.asarray(shown["depth"][row])
            depth = np.where(depth > 0, depth.clip(max=FAR), FAR)
            assert np.allclose(depth, view.depth(t), rtol=0, atol=STEP), (name, t)


def compare(dataset: Path, recipe: Recipe, out: Path, **how: Any) -> list[dict]:
    """Every copy that `rpaug augment` writes beside the item of its epoch; the reports, or a skip."""
    summary = augment(dataset, recipe, out)
    for why in summary.failures.values():
        if "VGG16 weights: found nothing" in why:
            pytest.skip(why)
    assert not summary.failures
    episodes = AugmentedEpisodes(dataset, recipe, **how)
    (recorded,) = (RLBench().read(dataset, key) for key in episodes.keys)
    made = written(out)
    assert sorted(made) == list(range(1, recipe.copies + 1))
    for copy, (wanted, given) in made.items():
        episodes.set_epoch(copy - 1)
        item = episodes[0]
        if given.get("gates", {"passed": True})["passed"]:
            assert item["edits"] == given["draws"]
            assert item["skipped"] == ""
            assert_shown(item, wanted)
        else:
            assert item["skipped"]
            assert item["edits"] == []
            assert_shown(item, recorded)
    return [given for _, given in made.values()]


@pytest.mark.parametrize("name", SHIPPED)
def test_an_epoch_is_the_copy_with_every_shipped_recipe(
    dataset: Path, tmp_path: Path, name: str
) -> None:
    compare(dataset, with_copies(name, 1), tmp_path / "out", frames=FRAMES)


def test_an_epoch_is_the_copy_of_the_sample(tmp_path: Path) -> None:
    compare(SAMPLE, with_copies("demo", 1), tmp_path / "out", frames="key")


@pytest.mark.parametrize(
    ("edits", "gates"),
    [
        ([PAINT, {"op": "light_color"}], {"color": 0.02, "tries": 10}),
        ([BUMP], {"holes": 0.1, "tries": 3}),
        ([PAINT], {"color": 0.0, "tries": 2}),  # nearly nothing passes
    ],
)
def test_gates_and_redraws_are_those_of_augment(
    template: Path, tmp_path: Path, edits: list, gates: dict
) -> None:
    recipe = Recipe.from_dict(
        {
            "version": 1,
            "seed": 3,
            "copies": 5,
            "select": {"limit": 1},
            "edits": edits,
            "gates": gates,
        }
    )
    reports = compare(template, recipe, tmp_path / "out", frames="all")
    attempts = {given["gates"]["attempt"] for given in reports}
    assert max(attempts) > 0  # else the gates had no say in it
    if gates.get("color") == 0.0:
        assert not all(given["gates"]["passed"] for given in reports)


def test_a_copy_is_judged_once_by_all_processes(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recipe = Recipe.from_dict(
        {"version": 1, "seed": 3, "edits": [BUMP], "gates": {"holes": 0.1, "tries": 3}}
    )
    judged: list[int] = []
    drawn = drawing.draw_copy

    def counted(prepared: Any, copy: int, **known: Any) -> copies.Made:
        if not known and copy != copies.ORIGINAL:
            judged.append(copy)
        return drawn(prepared, copy, **known)

    monkeypatch.setattr(drawing, "draw_copy", counted)
    items = []
    for _ in range(2):  # the second stands for another process: it shares the folder alone
        episodes = AugmentedEpisodes(dataset, recipe, scenes=tmp_path / "scenes", frames=[0])
        for epoch in (0, 1, 2, 0):
            episodes.set_epoch(epoch)
            items.append(episodes[0])
    assert judged == [1, 2, 3]
    for one, other in zip(items[:4], items[4:], strict=True):
        assert (one["edits"], one["skipped"]) == (other["edits"], other["skipped"])
        for name, images in one["cameras"].items():
            assert np.array_equal(images["rgb"], other["cameras"][name]["rgb"])
    (kept,) = (tmp_path / "scenes").glob("*.verdicts.json")
    kept.write_text("spoilt")
    episodes = AugmentedEpisodes(dataset, recipe, scenes=tmp_path / "scenes", frames=[0])
    assert episodes[0]["edits"] == items[0]["edits"]
    assert judged == [1, 2, 3, 1]
