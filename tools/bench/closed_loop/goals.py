"""What each task asks for, read off where things are: conditions that doing nothing does not meet."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.twin.staging import StagedTask
from rpaug.twin.tabletop import BLOCK, BOX, CUP_LARGE, PLATE, STOVE
from rpaug.twin.world import World

Pose = Float[np.ndarray, "4 4"]
Things = Mapping[str, Pose]

OPENED = 0.08  # metres the drawer has to be out; the demonstrations pull it by 0.15
PRESSED = 0.003  # metres: what RLBench's push_button asks of its joint


def _opened(job: StagedTask, now: Things, world: World) -> bool:
    start = world.body("drawer").pose
    return float((now["drawer"][:3, 3] - start[:3, 3]) @ start[:3, 0]) > OPENED


def _pressed(job: StagedTask, now: Things, world: World) -> bool:
    down = world.body("button").pose[2, 3] - now["button"][2, 3]
    return bool(down > PRESSED)


def _on_pad(job: StagedTask, now: Things, world: World) -> bool:
    """The block's middle over the pad, at the height at which it stands there."""
    there = _in(now["pad"], now[job.manipulated])
    return bool(np.all(np.abs(there[:2]) < 0.05) and 0.0 < there[2] < BLOCK[2] + 0.025)


def _in_cup(job: StagedTask, now: Things, world: World) -> bool:
    there = _in(now["cup_large"], now["cup_small"])
    return bool(np.hypot(*there[:2]) < CUP_LARGE[0] / 2 and 0.0 < there[2] < 0.02)


def _in_box(job: StagedTask, now: Things, world: World) -> bool:
    there = _in(now["box"], now["block_plain"])
    return bool(abs(there[0]) < BOX[0] and abs(there[1]) < BOX[1] and there[2] < BOX[2])


def _on_patch(job: StagedTask, now: Things, world: World) -> bool:
    there = _in(now["patch"], now["block_plain"])
    return bool(np.all(np.abs(there[:2]) < 0.04))


def _on_plate(job: StagedTask, now: Things, world: World) -> bool:
    there = _in(now["stove"], now["cup_small"])
    near = np.hypot(there[0] - PLATE[0], there[1]) < PLATE[1]
    return bool(near and abs(there[2] - STOVE[2] - PLATE[2]) < 0.01)


def _in(frame: Pose, thing: Pose) -> Float[np.ndarray, "3"]:
    return geometry.transform(geometry.inverse(frame), thing[:3, 3])


GOALS: Mapping[str, Callable[[StagedTask, Things, World], bool]] = {
    "open_drawer": _opened,
    "push_button": _pressed,
    "pick_block": _on_pad,
    "stack_cups": _in_cup,
    "put_in_box": _in_box,
    "slide_block": _on_patch,
    "put_on_stove": _on_plate,
}
