"""Which layouts are tested: those whose task the key poses of its recording do, so that a policy can do it too."""

from collections.abc import Sequence
from contextlib import closing
from itertools import count, islice

from rpaug import twin
from rpaug.twin.panda import OPEN
from rpaug.twin.record import stage
from tools.bench.closed_loop import looks
from tools.bench.closed_loop.bench import Bench
from tools.bench.closed_loop.samples import FRAMES, keys

UNSEEN = 8  # pixels a side: only the motion of these recordings is used


def solvable(task: str, seed: int, wanted: int) -> Sequence[int]:
    """The numbers of the first `wanted` layouts of that seed which can be solved."""
    return list(islice((n for n in count() if solved(task, seed, n)), wanted))


def solved(task: str, seed: int, episode: int) -> bool:
    """Whether a recording's key poses, as a policy learns them, do the task there: another thing may lie in the way."""
    take = twin.perform(
        task, seed, episode=episode, look=looks.ROOM, size=UNSEEN, frames=FRAMES, roam=looks.ROAM
    )
    robot = take.episode.robot
    assert robot.gripper_to_world is not None
    assert robot.gripper_open is not None
    job, world, _ = stage(task, seed, episode, looks.ROOM, looks.ROAM)
    with closing(Bench(task, job, world, looks.ROOM)) as bench:
        for t in keys(take.episode):
            opening = OPEN if robot.gripper_open[t] else 0.0
            if not bench.act(robot.gripper_to_world[t], opening) or bench.solved():
                break
        return bench.solved()
