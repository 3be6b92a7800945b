"""What is done on the tabletop: where things stand for a task, and the gripper's key poses."""

from collections.abc import Callable, Mapping

import numpy as np

from rpaug.core import geometry
from rpaug.twin.motion import HingeTurn, Key
from rpaug.twin.panda import FINGER_END, FINGER_HALF
from rpaug.twin.staging import DOWN, LOOSE, REACH, StagedTask, carry, gripper_pose, moved, scattered
from rpaug.twin.tabletop import (
    BLOCK,
    BOX,
    BOX_FLOOR,
    BUTTON_TOP,
    BUTTON_TRAVEL,
    CUP_SMALL,
    FLOOR_OF_CUP,
    GRIP,
    GRIP_RADIUS,
    LID,
    LID_OPEN,
    PLATE,
    STOVE,
    resting_height,
    upright,
)

PULL = 0.15  # metres the drawer is opened by
_HALFWAY = np.deg2rad(40.0)  # of the fingers from the vertical when they begin to push the lid over
_LEAN = np.deg2rad(40.0)  # how far the approach to the grip leans from the vertical into the drawer


def open_drawer(rng: np.random.Generator) -> StagedTask:
    """Take the drawer's grip and pull it open by 15 cm."""
    x, y = np.array([0.22, 0.16]) + rng.uniform(-0.02, 0.02, 2)
    cabinet = upright(x, y, 0.0, np.deg2rad(-80.0) + rng.uniform(-0.12, 0.12))
    spots = [
        (0.05, -0.33),
        (0.22, -0.38),
        (0.40, -0.33),
        (0.08, 0.36),
        (-0.02, -0.14),
        (0.46, 0.08),
    ]
    out = cabinet[:3, 0]
    approach = -np.sin(_LEAN) * out - np.array([0, 0, np.cos(_LEAN)])
    grasp = gripper_pose(geometry.transform(cabinet, GRIP), approach, opens_along=out)
    script = (
        Key(share=0.36, tip=moved(grasp, -REACH * approach)),
        Key(share=0.16, tip=grasp, straight=True),
        Key(share=0.08, opening=GRIP_RADIUS),
        Key(
            share=0.34,
            tip=moved(grasp, PULL * out),
            opening=GRIP_RADIUS,
            straight=True,
            holds="drawer",
        ),
        Key(share=0.06, opening=GRIP_RADIUS, holds="drawer"),
    )
    return StagedTask(
        {"cabinet": cabinet, "drawer": cabinet, **scattered(LOOSE, spots, rng)},
        script,
        "drawer",
        ("open the drawer", "grip the handle and pull the drawer open", "slide the drawer open"),
        0,
    )


def pick_block(rng: np.random.Generator) -> StagedTask:
    """Take a block, lift it and set it down on the pad."""
    variation = int(rng.integers(2))
    name, color = (("block_plain", "red"), ("block_two_coloured", "red and yellow"))[variation]
    cabinet = upright(
        0.34 + rng.uniform(-0.02, 0.02), 0.26, 0.0, np.deg2rad(-75.0) + rng.uniform(-0.1, 0.1)
    )
    pad = upright(
        0.33 + rng.uniform(-0.03, 0.03), -0.10 + rng.uniform(-0.02, 0.02), resting_height("pad")
    )
    block = upright(
        0.10 + rng.uniform(-0.03, 0.03),
        -0.10 + rng.uniform(-0.04, 0.04),
        BLOCK[2],
        rng.uniform(-0.6, 0.6),
    )
    grasp = gripper_pose(block[:3, 3] + [0, 0, 0.015], DOWN, opens_along=block[:3, 0])
    pad_top = pad[2, 3] + resting_height("pad")
    place = gripper_pose(
        np.array([pad[0, 3], pad[1, 3], pad_top + BLOCK[2] + 0.015]),
        DOWN,
        opens_along=block[:3, 0],
    )
    script = carry(name, grasp, place, BLOCK[0])
    spots = [(0.06, -0.35), (0.23, -0.38), (0.41, -0.33), (0.08, 0.25)]
    others = tuple(thing for thing in LOOSE if thing not in (name, "pad"))
    return StagedTask(
        {
            "cabinet": cabinet,
            "drawer": cabinet,
            "pad": pad,
            name: block,
            **scattered(others, spots, rng),
        },
        script,
        name,
        (
            f"put the {color} block on the pad",
            f"pick up the {color} block and set it down on the pad",
        ),
        variation,
        "pad",
    )


def push_button(rng: np.random.Generator) -> StagedTask:
    """Press a button down with closed fingers."""
    x, y = np.array([0.20, 0.0]) + rng.uniform(-0.06, 0.06, 2)
    button = upright(x, y, 0.0, rng.uniform(-0.5, 0.5))
    touch = np.array([0, 0, FINGER_END])  # of the finger ends below the tip
    top = gripper_pose(button[:3, 3] + [0, 0, BUTTON_TOP] + touch, DOWN, opens_along=button[:3, 1])
    pressed = moved(top, np.array([0, 0, -BUTTON_TRAVEL]))
    above = moved(top, np.array([0, 0, REACH]))
    script = (
        Key(share=0.40, tip=above, opening=0.0),
        Key(share=0.20, tip=top, opening=0.0, straight=True),
        Key(share=0.10, tip=pressed, opening=0.0, straight=True, holds="button"),
        Key(share=0.05, opening=0.0),
        Key(share=0.20, tip=above, opening=0.0, straight=True),
    )
    spots = [(0.02, -0.28), (0.24, -0.34), (0.42, -0.22), (0.06, 0.27), (0.26, 0.33), (0.44, 0.20)]
    return StagedTask(
        {"button": button, "button_base": button, **scattered(LOOSE, spots, rng)},
        script,
        "button",
        ("push the red button", "press the button down", "push down the button with the red top"),
        0,
        "button_base",
    )


def slide_block(rng: np.random.Generator) -> StagedTask:
    """Push the red block over the table onto the green patch."""
    turn = rng.uniform(-0.25, 0.25)
    along = np.array([-np.sin(turn), np.cos(turn), 0.0])
    x, y = np.array([0.20, -0.14]) + rng.uniform(-0.04, 0.04, 2)
    block = upright(x, y, BLOCK[2], turn)
    way = rng.uniform(0.16, 0.20) * along
    patch = upright(x + way[0], y + way[1], resting_height("patch"), turn)
    # High enough that the hand, wider than the fingers, stays above the block.
    behind = block[:3, 3] - (BLOCK[1] + FINGER_HALF) * along + [0, 0, 0.02]
    touch = gripper_pose(behind, DOWN, opens_along=block[:3, 0])
    back, over = -0.05 * along, np.array([0, 0, REACH])
    script = (
        Key(share=0.34, tip=moved(touch, back + over), opening=0.0),
        Key(share=0.12, tip=moved(touch, back), opening=0.0, straight=True),
        Key(share=0.10, tip=touch, opening=0.0, straight=True),
        Key(share=0.30, tip=moved(touch, way), opening=0.0, straight=True, holds="block_plain"),
        Key(share=0.14, tip=moved(touch, way + back), opening=0.0, straight=True),
    )
    spots = [(0.00, -0.36), (0.40, -0.36), (0.44, -0.08), (0.46, 0.18), (-0.02, 0.32)]
    return StagedTask(
        {
            "block_plain": block,
            "patch": patch,
            **scattered(tuple(n for n in LOOSE if n != "block_plain"), spots, rng),
        },
        script,
        "block_plain",
        ("slide the red block to the green target", "push the block onto the green square"),
        0,
        "patch",
    )


def stack_cups(rng: np.random.Generator) -> StagedTask:
    """Take the small cup and set it into the large one."""
    small = upright(
        0.12 + rng.uniform(-0.04, 0.04),
        -0.14 + rng.uniform(-0.04, 0.04),
        0.0,
        rng.uniform(-0.5, 0.5),
    )
    large = upright(
        0.30 + rng.uniform(-0.04, 0.04),
        0.06 + rng.uniform(-0.04, 0.04),
        0.0,
        rng.uniform(-0.5, 0.5),
    )
    high = np.array([0, 0, CUP_SMALL[2] - 0.015])
    grasp = gripper_pose(small[:3, 3] + high, DOWN, opens_along=small[:3, 0])
    inside = large[:3, 3] + high + [0, 0, FLOOR_OF_CUP]
    script = carry("cup_small", grasp, gripper_pose(inside, DOWN, small[:3, 0]), CUP_SMALL[0])
    spots = [(0.00, -0.36), (0.22, -0.38), (0.44, -0.30), (0.02, 0.22), (0.20, 0.34), (0.46, 0.26)]
    return StagedTask(
        {"cup_small": small, "cup_large": large, **scattered(LOOSE, spots, rng)},
        script,
        "cup_small",
        ("stack the cups", "put the small blue cup into the large one"),
        0,
        "cup_large",
    )


def put_in_box(rng: np.random.Generator) -> StagedTask:
    """Take the red block and set it down in the open box."""
    block = upright(
        0.10 + rng.uniform(-0.03, 0.03),
        -0.14 + rng.uniform(-0.04, 0.04),
        BLOCK[2],
        rng.uniform(-0.3, 0.3),
    )
    yaw = rng.uniform(-0.15, 0.15)
    box = upright(0.33 + rng.uniform(-0.03, 0.03), 0.10 + rng.uniform(-0.03, 0.03), 0.0, yaw)
    grip = np.array([0, 0, 0.025])
    grasp = gripper_pose(block[:3, 3] + grip, DOWN, opens_along=block[:3, 0])
    inside = box[:3, 3] + grip + [0, 0, BOX_FLOOR + BLOCK[2]]
    place = gripper_pose(inside, DOWN, opens_along=block[:3, 0])
    spots = [(0.00, -0.36), (0.22, -0.38), (0.44, -0.28), (0.00, 0.26), (0.16, 0.36)]
    return StagedTask(
        {
            "block_plain": block,
            "box": box,
            **scattered(tuple(n for n in LOOSE if n != "block_plain"), spots, rng),
        },
        carry("block_plain", grasp, place, BLOCK[0]),
        "block_plain",
        ("put the red block in the box", "pick up the red block and place it in the wooden box"),
        0,
        "box",
    )


def put_on_stove(rng: np.random.Generator) -> StagedTask:
    """Take the small cup and set it down on the stove's hot plate."""
    cup = upright(
        0.08 + rng.uniform(-0.03, 0.03),
        -0.16 + rng.uniform(-0.03, 0.03),
        0.0,
        rng.uniform(-0.5, 0.5),
    )
    yaw = rng.uniform(-0.2, 0.2)
    stove = upright(0.34 + rng.uniform(-0.03, 0.03), 0.08 + rng.uniform(-0.03, 0.03), 0.0, yaw)
    high = np.array([0, 0, CUP_SMALL[2] - 0.015])
    plate = geometry.transform(stove, np.array([PLATE[0], 0, STOVE[2] + PLATE[2]]))
    grasp = gripper_pose(cup[:3, 3] + high, DOWN, opens_along=cup[:3, 0])
    place = gripper_pose(plate + high, DOWN, opens_along=cup[:3, 0])
    spots = [(0.00, -0.38), (0.22, -0.38), (0.44, -0.32), (-0.04, 0.28), (0.14, 0.38)]
    return StagedTask(
        {
            "cup_small": cup,
            "stove": stove,
            **scattered(tuple(n for n in LOOSE if n != "block_textured"), spots, rng),
        },
        carry("cup_small", grasp, place, CUP_SMALL[0]),
        "cup_small",
        ("put the blue cup on the stove", "pick up the cup and set it down on the hot plate"),
        0,
        "stove",
    )


def close_box(rng: np.random.Generator) -> StagedTask:
    """Push the box's open lid over with closed fingers until it lies on the box."""
    yaw = rng.uniform(-0.15, 0.15)
    box = upright(0.25 + rng.uniform(-0.02, 0.02), rng.uniform(-0.05, 0.05), 0.0, yaw)
    across = box[:3, 1]
    hinge = geometry.transform(box, np.array([BOX[0], 0, BOX[2] + 0.001]))
    closed = moved(box, hinge - box[:3, 3])
    lid = HingeTurn(hinge, LID_OPEN * across).turned(closed, 1.0)
    # Fingers touch the outside near its free edge, half of the turn before and half after they point down.
    approach = np.array(geometry.rotation(_HALFWAY * across) @ DOWN)
    back = lid[:3, 2]
    touch = geometry.transform(lid, np.array([0.03 - 2 * BOX[0], 0, LID])) + 0.016 * back
    start = gripper_pose(touch, approach, opens_along=across)
    ready = moved(start, 0.06 * back)
    script = (
        Key(share=0.44, tip=ready, opening=0.0),
        Key(share=0.10, tip=start, opening=0.0, straight=True),
        Key(share=0.32, about=HingeTurn(hinge, -LID_OPEN * across), opening=0.0, holds="lid"),
        Key(share=0.10, opening=0.0),
    )
    spots = [(0.00, -0.36), (0.22, -0.38), (0.44, -0.30), (0.00, 0.30), (0.20, 0.36), (0.46, 0.26)]
    return StagedTask(
        {"box": box, "lid": lid, **scattered(LOOSE, spots, rng)},
        script,
        "lid",
        ("close the box", "push the lid of the box shut", "shut the wooden box"),
        0,
        "box",
    )


TASKS: Mapping[str, Callable[[np.random.Generator], StagedTask]] = {
    "open_drawer": open_drawer,
    "pick_block": pick_block,
    "push_button": push_button,
    "slide_block": slide_block,
    "stack_cups": stack_cups,
    "put_in_box": put_in_box,
    "put_on_stove": put_on_stove,
    "close_box": close_box,
}
