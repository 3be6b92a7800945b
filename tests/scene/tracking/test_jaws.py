"""Fingers follow the recorded opening where it explains them, and only there."""

from dataclasses import replace
from functools import cache

import boxes
import numpy as np
import pytest
from boxes import HAND, Box, World

from rpaug.core import geometry
from rpaug.core.types import Episode
from rpaug.scene.tracking import bodies, jaws

LEFT, RIGHT = 20, 21
OPEN, SHUT = 0.06, 0.03


@cache
def closing() -> tuple[World, np.ndarray]:
    """A hand goes down, closes by 3 cm a side while still, and goes aside; and each finger's distance."""
    hand = boxes.path((0.1, 0.0, 0.3), (0.1, 0.0, 0.2), (0.1, 0.0, 0.2), (0.0, 0.1, 0.25), steps=5)
    opening = np.interp(np.arange(len(hand)), [6, 9], [OPEN, SHUT])
    aside = np.stack([np.zeros_like(opening), opening, np.full_like(opening, -0.06)], -1)
    other = aside * [1, -1, 1]
    made = boxes.furniture() | {
        HAND: Box((0.06, 0.2, 0.05), boxes.poses(hand), (230, 230, 230)),
        LEFT: Box((0.05, 0.03, 0.08), boxes.poses(hand + aside), (90, 90, 90)),
        RIGHT: Box((0.05, 0.03, 0.08), boxes.poses(hand + other), (90, 90, 90)),
    }
    world = World(made, boxes.poses(hand), (np.arange(len(hand)) < 8).astype(float), size=96)
    return world, np.stack([opening, opening], 1)


@cache
def seen() -> Episode:
    return closing()[0].episode()


def recorded(openings: np.ndarray | None) -> Episode:
    episode = seen()
    extra = {} if openings is None else {"gripper_joint_positions": openings}
    return replace(episode, robot=replace(episode.robot, extra=extra))


def off(episode: Episode) -> list[float]:
    """The most, in metres, that the tracks of both fingers and of the hand are off."""
    world, found = closing()[0], bodies.track(episode)
    out = []
    for instance_id in (LEFT, RIGHT, HAND):
        body = next(b for b in found if instance_id in b.instance_ids)
        start = geometry.inverse(world.pose(instance_id, 0))
        true = np.array([world.pose(instance_id, t) @ start for t in range(episode.length)])
        out.append(float(np.linalg.norm((body.to_world - true)[:, :3, 3], axis=-1).max()))
    return out


def test_fingers_slide_by_the_recorded_opening_and_the_hand_does_not() -> None:
    assert max(off(recorded(closing()[1]))) < 1e-9


def test_an_opening_that_does_not_explain_the_fingers_is_not_followed() -> None:
    assert off(recorded(2 * closing()[1] - OPEN)) == pytest.approx(off(recorded(None)))


@pytest.mark.parametrize(
    "openings",
    [
        None,
        np.full((16, 2), OPEN),
        np.full((16, 2), np.nan),
        np.linspace(0, 1, 16),
    ],
)
def test_what_is_not_recorded_or_never_changes_tells_of_no_fingers(
    openings: np.ndarray | None,
) -> None:
    assert len(jaws.fingers(recorded(openings).robot)) == 0
