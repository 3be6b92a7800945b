"""How far shipped recipes move cameras: on real recordings, without the arm's file, copies stay within the gates."""

from pathlib import Path

import rpaug_recipes

from rpaug.core.types import Scene
from rpaug.pipeline import plan, prepare, recipe
from rpaug.pipeline.copies import PreparedEpisode, draw_copy
from rpaug.pipeline.gates import Gates

RECIPES = Path(rpaug_recipes.__file__).parent
DRAWS, EVERY = 6, 40  # a copy of these recipes has four draws


def moves(name: str) -> dict:
    (step,) = (
        step
        for step in recipe.load(RECIPES / f"{name}.yaml").steps
        if step.options[0].name == "camera_pose"
    )
    return {"op": "camera_pose", **step.options[0].fields}


def invented(prepared: PreparedEpisode, copy: int, cameras: list[str]) -> float:
    """The share of invented pixels among those that show what moves, in the worst camera."""
    made = draw_copy(prepared, copy)
    for camera in cameras:
        for t in range(0, made.episode.length, EVERY):
            made.episode.views[camera].rgb(t)
    worst = []
    for camera in cameras:
        counts = [pair for (name, _), pair in made.tally.moving.items() if name == camera]
        worst.append(sum(unseen for unseen, _ in counts) / sum(all for _, all in counts))
    return max(worst)


def test_half_of_the_draws_or_more_show_the_arm_as_it_was_recorded(real: Scene) -> None:
    edit = moves("robust")
    assert edit == moves("demo")
    made = recipe.build({"version": 1, "seed": 1, "gates": False, "edits": [edit]})
    prepared = PreparedEpisode(real, plan.make(prepare.operators(made), real.episode), made)
    shares = [invented(prepared, copy, edit["camera"]) for copy in range(1, DRAWS + 1)]
    limit = Gates().moving
    assert limit is not None
    assert sum(share <= limit for share in shares) >= DRAWS / 2, shares
