"""The public door: what a notebook calls gives what the command line writes, and says what is wrong in words."""

import ast
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rpaug_adapters.rlbench import RLBench
from runs import GROUP, contents
from runs import augment as run

import rpaug
from rpaug.core import devices
from rpaug.core.registry import SAMPLE
from rpaug.operators.light_color import LightColor
from rpaug.operators.recolor import Recolor
from rpaug.pipeline import inputs, report, write
from rpaug.training import AugmentedEpisodes, Schedule

PAINT = {"op": "recolor", "target": {"handle": 300}, "color": {"sample": "colosseum"}}
BUMP = {"op": "camera_pose", "camera": "front", "shift": 0.1, "turn": 0.05}
RECIPE: dict[str, Any] = {"version": 1, "seed": 11, "copies": 2, "edits": [PAINT, BUMP]}
KEY = f"{GROUP}/episode0"


def test_a_copy_is_what_augment_writes_and_is_written_the_same(
    template: Path, tmp_path: Path
) -> None:
    run(template, rpaug.Recipe.from_dict(RECIPE), tmp_path / "out")
    episode = rpaug.read(template, KEY)
    copy = rpaug.augment(episode, RECIPE, 2)
    theirs = RLBench().read(tmp_path / "out", f"{GROUP}/episode2")
    for name, view in theirs.views.items():
        mine = copy.views[name]
        assert np.array_equal(mine.camera.cam_to_world, view.camera.cam_to_world)
        assert all(np.array_equal(mine.rgb(t), view.rgb(t)) for t in range(theirs.length))
    assert rpaug.write(copy, tmp_path / "mine") == KEY
    written = contents(tmp_path / "mine")
    wanted = contents(tmp_path / "out" / GROUP / "episode2")
    assert {name.removeprefix(f"{KEY}/"): data for name, data in written.items()} == wanted
    assert rpaug.verify(tmp_path / "mine", template).passed


def test_a_report_is_replayed(template: Path, tmp_path: Path) -> None:
    copy = rpaug.augment(rpaug.read(template), RECIPE)
    rpaug.write(copy, tmp_path / "made")
    rpaug.replay(tmp_path / "made" / KEY / report.NAME, template, tmp_path / "again")
    assert contents(tmp_path / "made") == contents(tmp_path / "again")
    with pytest.raises(rpaug.BadInput, match="no recipe, source"):
        rpaug.replay({}, template, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_recipe_is_a_dict_a_name_a_path_or_a_recipe(tmp_path: Path) -> None:
    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(RECIPE))
    given = [RECIPE, path, str(path), rpaug.Recipe.from_yaml(path)]
    assert all(inputs.recipe(one).source == RECIPE for one in given)
    assert inputs.recipe("colosseum/light_color").steps
    before = json.dumps(RECIPE)
    assert inputs.recipe(RECIPE, ["seed=5"]).seed == 5
    assert inputs.recipe(rpaug.Recipe.from_dict(RECIPE), ["edits.0.color=red"]).seed == 11
    assert json.dumps(RECIPE) == before


def test_an_episode_is_inspected_and_converted(template: Path, tmp_path: Path) -> None:
    episode = rpaug.read(template)
    described = rpaug.inspect(episode)
    assert {row["handle"] for row in described["instances"]} == {7, 300, 0xABCDEF}
    key = rpaug.write(episode, tmp_path / "rdt", layout="rdt")
    again = rpaug.read(tmp_path / "rdt", key)
    assert again.length == episode.length
    assert again.instruction == "roll the ball"
    assert rpaug.read("sample").provenance == rpaug.Provenance(SAMPLE, "rlbench")


def test_copies_that_augment_rejects_raise(template: Path) -> None:
    gated = {**RECIPE, "gates": {"tries": 2, "holes": 0.0}}
    with pytest.raises(rpaug.Rejected, match="copy 1 is rejected: holes"):
        rpaug.augment(rpaug.read(template), gated)


def arrays(length: int = 3, **more: Any) -> dict[str, Any]:
    """A red square on grey that moves one column a frame, in one camera."""
    rgb = np.full((length, 24, 32, 3), 90, np.uint8)
    masks = np.ones((length, 24, 32), np.int64)
    depth = np.full((length, 24, 32), 1.0)
    for t in range(length):
        rgb[t, 8:16, 10 + t : 18 + t] = (200, 30, 30)
        masks[t, 8:16, 10 + t : 18 + t] = 2
        depth[t, 8:16, 10 + t : 18 + t] = 0.9
    K = np.array([[30.0, 0, 15.5], [0, 30.0, 11.5], [0, 0, 1]])
    return {"rgb": rgb, "masks": masks, "depth": depth, "cameras": (K, np.eye(4))} | more


PAINT_SQUARE = {
    "version": 1,
    "edits": [{"op": "recolor", "target": {"handle": 2}, "color": "blue"}],
}
LIGHT = {"version": 1, "edits": [{"op": "light_color", "range": [[0.2] * 3, [0.3] * 3]}]}


def test_arrays_make_an_episode_that_is_augmented_inspected_and_written(tmp_path: Path) -> None:
    given = arrays()
    gripper = np.tile(np.eye(4), (3, 1, 1))
    episode = rpaug.Episode.from_arrays(
        **given,
        instruction="push the red square",
        joint_positions=np.zeros((3, 7)),
        joint_velocities=np.zeros((3, 7)),
        gripper_to_world=gripper,
        gripper_open=np.ones(3),
    )
    assert episode.views.keys() == {"front"}
    copy = rpaug.augment(episode, PAINT_SQUARE)
    square, image = given["masks"] == 2, np.stack([copy.views["front"].rgb(t) for t in range(3)])
    assert np.array_equal(image[~square], given["rgb"][~square])
    assert (image[square][:, 2] > image[square][:, 0]).all()
    assert copy.instruction == "push the blue square"
    assert {row["handle"] for row in rpaug.inspect(episode)["instances"]} == {1, 2}
    again = rpaug.read(tmp_path / "out", rpaug.write(copy, tmp_path / "out"))
    assert again.instruction == "push the blue square"
    assert np.array_equal(again.views["front"].rgb(2), image[2])
    assert again.views["front"].depth is not None
    assert np.allclose(again.views["front"].depth(0), given["depth"][0], atol=1e-6)


def test_colors_alone_make_an_episode() -> None:
    rgb = arrays()["rgb"]
    episode = rpaug.Episode.from_arrays({"left": rgb, "right": rgb})
    assert episode.views["right"].depth is None
    assert episode.views["right"].camera.assumed
    copy = rpaug.augment(episode, LIGHT)
    assert not np.array_equal(copy.views["left"].rgb(0), rgb[0])
    assert rpaug.inspect(episode)["frames"] == 3


def test_what_a_layout_needs_and_arrays_lack_is_said(tmp_path: Path) -> None:
    episode = rpaug.Episode.from_arrays(arrays()["rgb"])
    with pytest.raises(rpaug.Unsupported, match="gripper's pose"):
        rpaug.write(episode, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rgb": np.zeros((3, 24, 32))}, r"rgb\['front'\]: found float64.*expected uint8"),
        ({"rgb": np.zeros((3, 24, 32, 4), np.uint8)}, r"shape \(t, h, w, 3\)"),
        ({"rgb": {}}, "rgb: found no camera"),
        ({"depth": np.ones((3, 24, 31))}, r"depth\['front'\].*shape \(3, 24, 32\)"),
        ({"depth": np.ones((3, 24, 32), int)}, "metres"),
        ({"depth": np.full((3, 24, 32), np.nan)}, "not finite"),
        ({"masks": np.ones((3, 24, 32))}, "integers"),
        ({"masks": np.full((3, 24, 32), -1)}, "out of range"),
        ({"masks": {"side": np.ones((3, 24, 32), int)}}, "'side'; expected one of: front"),
        ({"cameras": None}, "cameras: found none for 'front'"),
        ({"cameras": (np.eye(4), np.eye(4))}, r"K: found float64 of shape \(4, 4\)"),
        ({"cameras": (np.zeros((3, 3)), np.eye(4))}, "focal lengths above 0"),
        ({"cameras": (np.eye(3), 2 * np.eye(4))}, "rigid 4x4"),
        ({"cameras": (np.eye(3), np.tile(np.eye(4), (2, 1, 1)))}, r"\(3, 4, 4\)"),
        ({"cameras": "front"}, "a Camera, or K and cam_to_world"),
        ({"joint_positions": np.zeros((2, 7))}, r"joint_positions.*\(3, any\)"),
        ({"gripper_open": [1, 0, np.inf]}, "not finite"),
        ({"gripper_to_world": np.zeros((3, 4, 4))}, "gripper_to_world.*rigid"),
    ],
)
def test_wrong_arrays_are_refused_by_name(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(rpaug.BadInput, match=words):
        rpaug.Episode.from_arrays(**arrays(**changed))


def test_cameras_of_different_lengths_are_refused() -> None:
    rgb = arrays()["rgb"]
    with pytest.raises(rpaug.BadInput, match=r"\[2, 3\] frames"):
        rpaug.Episode.from_arrays({"left": rgb, "right": rgb[:2]})


def painted(**fields: Any) -> dict[str, Any]:
    return {"version": 1, "edits": [{**PAINT, **fields}]}


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda e: rpaug.augment(e, RECIPE, 0), "copy 0: expected a whole number from 1"),
        (lambda e: rpaug.augment(e, RECIPE, -1), "copy -1"),
        (lambda e: rpaug.augment(e, RECIPE, 1.5), "copy 1.5"),
        (lambda e: rpaug.augment(e, RECIPE, seed=-1), "seed: found -1"),
        (lambda e: rpaug.augment(e, RECIPE, tier=2), "tier 2: expected 0, 1, 3 or 4"),
        (lambda e: rpaug.augment(e, "no_such"), "expected a recipe file or one of: .*demo"),
        (lambda e: rpaug.augment(e, 5), "expected a Recipe, a dict, a file or a name"),
        (lambda e: rpaug.augment(e, {}), "version: missing"),
        (lambda e: rpaug.augment(e, {"version": 1, "path": Path()}), "values as YAML has"),
        (lambda e: rpaug.augment(e, painted(color="bleu")), r"edits\[0\].color: found 'bleu'"),
        (lambda e: rpaug.augment(e, painted(target="the cup")), "the cup"),
        (lambda e: rpaug.augment(e, painted(target={"handle": 4711})), "no such instance 4711"),
        (lambda e: rpaug.augment(e, {"version": 1, "edits": [{**BUMP, "camera": "nope"}]}),
         "no camera is called 'nope'; there are: front, overhead"),
        (lambda e: rpaug.read(e.provenance.dataset, "none"), "episode: found none; expected one of"),
        (lambda e: rpaug.read("/no/such"), "no such folder"),
        (lambda e: rpaug.episodes("/no/such"), "no such folder"),
        (lambda e: rpaug.write(e, e.provenance.dataset), "something there already"),
        (lambda e: rpaug.write(e, e.provenance.dataset / "in"), "a path outside it"),
        (lambda e: rpaug.write(e, "/tmp/never", layout="nope"), "no adapter is called 'nope'"),
        (lambda e: Recolor(target="x", color="bleu"), "Recolor: color: found 'bleu'; no such"),
        (lambda e: Recolor(color="red"), "Recolor: target: missing"),
        (lambda e: Recolor(target="x", color="red", colour="red"), "colour: unknown key"),
        (lambda e: LightColor(range=[[0.5] * 3, [0.1] * 3]), "LightColor: .*exceed"),
        (lambda e: AugmentedEpisodes(e.provenance.dataset, RECIPE, cameras=["nope"]),
         "no camera is called 'nope'; there are: front, overhead"),
        (lambda e: AugmentedEpisodes(e.provenance.dataset, RECIPE, tier=2), "tier 2"),
        (lambda e: AugmentedEpisodes(e.provenance.dataset, "no_such"), "one of: .*demo"),
        (lambda e: AugmentedEpisodes("/no/such", RECIPE), "no such folder"),
        (lambda e: AugmentedEpisodes(e.provenance.dataset, RECIPE).set_epoch(-1),
         "epoch -1: expected a whole number from 0"),
        (lambda e: AugmentedEpisodes(e.provenance.dataset, RECIPE).set_epoch(0.5), "epoch 0.5"),
        (lambda e: Schedule(probability=2), "values from 0 to 1"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_told_in_words(
    template: Path, ask: Callable[[rpaug.Episode], Any], words: str
) -> None:
    with pytest.raises(rpaug.RpaugError, match=words):
        ask(rpaug.read(template))


def test_a_plain_string_is_a_target_in_python_as_in_a_recipe() -> None:
    made = Recolor(target="the red cup", color="blue")
    assert made.target.text == "the red cup"
    assert made.color.colors == ((0.0, 0.0, 1.0),)


def test_every_public_name_is_there_typed_and_imported_on_first_use() -> None:
    for name in rpaug.__all__:
        assert getattr(rpaug, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nope'"):
        rpaug.nope  # noqa: B018
    tree = ast.parse(Path(rpaug.__file__).read_text())
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in typed.body if isinstance(node, ast.ImportFrom)]
    typed_names = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in imports
        for alias in node.names
    }
    for name, place in rpaug._EXPORTS.items():
        module, _, own = place.partition(":")
        assert typed_names.pop(name) in ((module, own or name), (module.rpartition(".")[0], name))
    assert not typed_names
    assert list(rpaug._EXPORTS) == sorted(rpaug._EXPORTS)
    heavy = "import rpaug, sys; print({'numpy', 'torch', 'numba', 'cv2'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_copy_that_a_gpu_fitted_is_replayed_on_one_alone(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lacking = devices.DevicePart("GPU driver", "", "no NVIDIA driver", "one for this GPU")
    monkeypatch.setattr(devices, "_driver", lambda: lacking)
    plan = {"tier": 3, "device": {"fits": "cuda", "frames": "cpu"}}
    described = {"recipe": RECIPE, "source": KEY, "plan": plan}
    with pytest.raises(rpaug.Unsupported, match="no NVIDIA driver"):
        write.replay(RLBench(), template, described, tmp_path / "again", KEY)
