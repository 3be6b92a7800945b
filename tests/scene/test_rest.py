"""What cannot be told from rest is at rest."""

from pathlib import Path

from rpaug.core.registry import adapter
from rpaug.scene.build import build


def test_a_bare_table_does_not_slide_along_with_the_gripper(template: Path) -> None:
    """A plane that slides in itself looks the same; only the ball truly moves in this dataset."""
    episode = adapter("rlbench").read(template, "roll_ball/all_variations/episodes/episode0")
    motions = {
        instance_id: body.motion
        for body in build(episode, with_bodies=True).bodies
        for instance_id in body.instance_ids
    }
    assert motions[7] == "static"
    assert motions[0xABCDEF] == "static"
    assert motions[300] == "gripper"
