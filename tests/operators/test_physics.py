"""A thing left to physics falls and bends in all cameras alike; where the robot touches it, actions do not hold."""

import json
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rpaug_adapters.rlbench import RLBench
from runs import augment
from small_clip import saved, taught
from tabletop import instance_id, scene, take

from rpaug import Unsupported
from rpaug.core.errors import BadRecipe
from rpaug.core.files import REJECTED
from rpaug.core.types import CameraView, Episode, Robot
from rpaug.operators.physics import Physics
from rpaug.physics import materials, simulate
from rpaug.pipeline import recipe, report, write
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.targets.targets import Target
from rpaug.training import AugmentedEpisodes

QUICK = {"particles": 400, "fps": 40.0}


def jelly(**more) -> Physics:
    target = Target(handle=instance_id("cylinder"))
    return Physics(target=target, **{"material": "jelly", "height": (0.03, 0.03), **QUICK, **more})


@lru_cache(4)
def fallen(material: str):
    operator = jelly(material=material)
    return operator.apply(scene(), operator.sample(scene(), np.random.default_rng(0)))


@pytest.mark.gl
class TestPhysics(OperatorContract):
    def operator(self) -> Physics:
        return jelly()

    def scene(self):
        return scene()


@pytest.mark.gl
@pytest.mark.parametrize(("material", "solver"), [("jelly", "material points"), ("wood", "rigid")])
def test_it_falls_and_everything_else_stays_bit_for_bit(material: str, solver: str) -> None:
    after = fallen(material)
    (given,) = after.simulated
    assert (given["solver"], given["actions_valid"]) == (solver, True)
    assert ("because" in given) == (solver == "rigid")
    made, mine = shown(after), instance_id("cylinder")
    seen = 0
    for name, view in made.views.items():
        for t in (0, 16):
            old = scene().episode.views[name]
            rest = (view.ids(t) != mine) & (old.ids(t) != mine)
            same = (view.rgb(t) == old.rgb(t)).all(-1) & (view.depth(t) == old.depth(t))
            assert same[rest].all(), (name, t)
            seen += int((view.ids(t) == mine).sum())
            assert (view.depth(t)[view.ids(t) == mine] > 0).all()
    assert seen > 50


@pytest.mark.gl
def test_cameras_agree_on_where_a_soft_thing_is() -> None:
    """Points that two cameras show of it lie on one surface, within its pixels' footprint."""
    from rpaug.core import geometry

    made, mine, clouds = shown(fallen("jelly")), instance_id("cylinder"), []
    for name in ("overhead", "left_shoulder", "right_shoulder"):
        view = made.views[name]
        points = geometry.world_points(view.depth(16).astype(float), view.camera, 16)
        if len(found := points[view.ids(16) == mine]) > 20:
            clouds.append(found)
    assert len(clouds) >= 2
    apart = np.linalg.norm(clouds[0][:, None] - clouds[1][None], axis=-1).min(1)
    assert np.median(apart) < 0.01


@pytest.mark.gl
def test_what_the_robot_moves_marks_the_actions() -> None:
    operator = Physics(
        target=Target(role="manipulated"), material="jelly", particles=400, fps=200.0
    )
    after = operator.apply(scene(), operator.sample(scene(), np.random.default_rng(0)))
    assert not after.actions_valid
    assert "moved by the robot" in after.simulated[0]["reasons"][0]


def brief(episode: Episode, names: tuple[str, ...]) -> Episode:
    """Every other frame in some cameras."""

    def view(name: str) -> CameraView:
        one = episode.views[name]
        seen = {
            part: (lambda t, part=part: getattr(one, part)(2 * t))
            for part in ("rgb", "depth", "ids")
        }
        track = one.camera.cam_to_world[::2]
        return CameraView(replace(one.camera, cam_to_world=track), **seen)

    robot = episode.robot
    thin = {
        field.name: getattr(robot, field.name)[::2]
        for field in fields(robot)
        if field.name != "extra"
    }
    extra = {name: values[::2] for name, values in robot.extra.items()}
    return replace(
        episode,
        views={name: view(name) for name in names},
        robot=Robot(**thin, extra=extra),
        length=len(thin["joint_positions"]),
    )


@pytest.mark.gl
@pytest.mark.usefixtures("tracked_once")
def test_invalid_actions_are_kept_out_unless_asked_for(tmp_path: Path) -> None:
    key = "pick_block/all_variations/episodes/episode0"
    RLBench().write(brief(take().episode, ("front", "left_shoulder")), tmp_path / "data", key, dict)
    edit = {"op": "physics", "target": {"role": "manipulated"}, "material": "wood", **QUICK}
    wanted = recipe.build({"version": 1, "copies": 1, "edits": [edit]})
    summary = augment(tmp_path / "data", wanted, tmp_path / "out")
    assert (summary.exit_code, summary.copies) == (1, 0)
    assert "actions_valid" in next(iter(summary.rejected.values()))
    described = json.loads((tmp_path / "out" / REJECTED / key / report.NAME).read_bytes())
    assert described["actions_valid"] is False
    assert described["physics"][0]["solver"] == "rigid"
    again = tmp_path / "again"
    write.replay(RLBench(), tmp_path / "data", described, again, key)
    replayed = json.loads((again / key / report.NAME).read_bytes())
    assert {k: v for k, v in replayed.items() if k != "seconds"} == {
        k: v for k, v in described.items() if k != "seconds"
    }
    kept = execute(Run(tmp_path / "data", wanted, tmp_path / "kept", keep_invalid=True))
    assert (kept.exit_code, kept.copies) == (0, 1)
    written = json.loads((tmp_path / "kept" / key / report.NAME).read_bytes())
    assert written["actions_valid"] is False

    path = tmp_path / "r.yaml"
    path.write_text(json.dumps(wanted.source))
    assert not AugmentedEpisodes(tmp_path / "data", path, frames=[0])[0]["edits"]  # as recorded
    assert AugmentedEpisodes(tmp_path / "data", path, keep_invalid=True, frames=[0])[0]["edits"]


@pytest.mark.parametrize(
    ("field", "value", "stated"),
    [
        ("young", 1.0, "allowed are 100 to 5e"),
        ("poisson", 0.5, "allowed are 0 to 0.49"),
        ("density", 0.5, "allowed are 10 to 20000"),
        ("inner_friction", 80, "allowed are 0 to 60"),
        ("material", "cheese", "there are: rubber"),
        ("height", [0.1, 2.0], "not within 0..0.5"),
        ("velocity", [0, 0, 99], "at most 10"),
    ],
)
def test_values_out_of_range_are_refused_with_the_range(field, value, stated) -> None:
    edit = {"op": "physics", "target": "cup", "material": "jelly", field: value}
    with pytest.raises(BadRecipe, match=stated):
        recipe.build({"version": 1, "edits": [edit]})


def test_without_a_material_it_says_what_it_needs() -> None:
    with pytest.raises(Unsupported, match=r"say its material, one of rubber, .*CLIPModel"):
        Physics(target=Target(role="receiver")).ready()


@pytest.mark.gl
def test_a_vision_model_tells_what_a_thing_is_made_of(tmp_path: Path) -> None:
    """A CLIPModel that was taught two of the scene's things tells them apart; the edit holds what it said."""
    names = list(materials.shipped())
    texts = [f"a photo of a thing made of {name}" for name in names]
    words = sorted({word for text in texts for word in text.split()})
    made_of = {"cylinder": "jelly", "block_textured": "ceramic"}
    order = [*made_of.values(), *(name for name in names if name not in made_of.values())]
    pictures = [simulate.portrait(scene(), frozenset({instance_id(thing)})) for thing in made_of]
    taught(saved(tmp_path, words), pictures, [texts[names.index(name)] for name in order])
    for thing, name in made_of.items():
        operator = Physics(target=Target(handle=instance_id(thing)), vision=str(tmp_path))
        edit = operator.sample(scene(), np.random.default_rng(0))
        assert edit["name"] == name
        assert edit["material"]["young"] == materials.named(name).young


@pytest.mark.gl
def test_the_table_cannot_be_let_go() -> None:
    recorded = scene()
    (table,) = recorded.roles["table"]
    with pytest.raises(Unsupported, match="it is the table"):
        Physics(target=Target(handle=table), material="jelly").sample(
            recorded, np.random.default_rng(0)
        )


@pytest.mark.parametrize("role", ["table", "robot", "background"])
def test_only_things_on_the_table_are_simulated(role: Any) -> None:
    with pytest.raises(BadRecipe, match=f"not the {role}"):
        Physics(target=Target(role=role), material="jelly")
