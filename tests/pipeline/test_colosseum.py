"""The recipes that ship have COLOSSEUM's own ranges and its tasks' own factors (robot-colosseum @098a910)."""

from pathlib import Path
from typing import Any

import pytest
import rpaug_recipes
import yaml

from rpaug import BadRecipe
from rpaug.core import color_space
from rpaug.pipeline import recipe

ROOT = Path(rpaug_recipes.__file__).parent / "colosseum"

# Factors on things that a task defines and enables: color and texture of what moves (mc, mt) and receives (rc, rt).
TASKS = {
    "basketball_in_hoop": "mc mt rc",
    "close_box": "mc",
    "close_laptop_lid": "mc",
    "empty_dishwasher": "mc rc rt",
    "get_ice_from_fridge": "mc mt rc",
    "hockey": "mc rc rt",
    "insert_onto_square_peg": "mc rc rt",
    "meat_on_grill": "mc rc",
    "move_hanger": "mc rc",
    "open_drawer": "mc",
    "place_wine_at_rack_location": "mc rc rt",
    "put_money_in_safe": "mc mt rc rt",
    "reach_and_drag": "mc mt rc rt",
    "scoop_with_spatula": "mc mt rc rt",
    "setup_chess": "mc mt rc",
    "slide_block_to_target": "mc mt",
    "stack_cups": "mc mt",
    "straighten_rope": "mc mt",
    "turn_oven_on": "mc",
    "wipe_desk": "mc mt",
}
EVERY = {"light_color", "table_color", "table_texture", "background_texture", "camera_pose"}
RANGES: dict[str, dict[str, Any]] = {
    "light_color": {"range": [[0, 0, 0], [0.5, 0.5, 0.5]]},
    "table_color": {"range": [[0.25, 0.25, 0.25], [1, 1, 1]]},
    "camera_pose": {
        "camera": ["front", "left_shoulder", "right_shoulder"],
        "shift": 0.1,
        "turn": 0.05,
    },
    "recolor": {"color": {"sample": "colosseum"}},
}


def edits(path: Path) -> list[dict[str, Any]]:
    """All edits that a recipe may come to, alternatives among them."""
    entries = yaml.safe_load(path.read_text())["edits"]
    return [one for entry in entries for one in entry.get("one_of", [entry])]


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.yaml")), ids=lambda path: path.stem)
def test_ranges_are_colosseums(path: Path) -> None:
    for edit in edits(path):
        for field, value in RANGES.get(edit["op"], {}).items():
            assert edit[field] == value


def test_there_is_a_preset_for_every_task() -> None:
    assert {path.stem for path in (ROOT / "tasks").glob("*.yaml")} == set(TASKS)


@pytest.mark.parametrize("task", TASKS)
def test_a_task_has_its_own_factors(task: str) -> None:
    found, things = set(), set()
    for edit in edits(ROOT / f"tasks/{task}.yaml"):
        if edit["op"] in ("recolor", "retexture"):
            things.add(edit["target"]["role"][0] + ("c" if edit["op"] == "recolor" else "t"))
        else:
            found.add(edit["op"])
    assert things == set(TASKS[task].split())
    assert found >= EVERY


def test_the_twenty_colors_are_rlbenchs() -> None:
    assert len(color_space.RLBENCH) == 20
    assert color_space.RLBENCH["azure"] == (0.0, 0.5, 1.0)


@pytest.mark.parametrize("factor", ["object_mass", "object_friction"])
def test_factors_that_no_pixel_shows_are_refused_by_name(factor: str) -> None:
    with pytest.raises(BadRecipe, match=f"{factor} .* no recorded pixel"):
        recipe.build({"version": 1, "edits": [{"op": factor}]})
