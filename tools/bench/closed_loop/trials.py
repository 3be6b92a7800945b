"""How often a policy succeeds: episodes that no training saw, under each condition."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from rpaug.twin import factors
from rpaug.twin.panda import OPEN
from rpaug.twin.record import stage
from tools.bench.closed_loop import looks
from tools.bench.closed_loop.bench import Bench, View
from tools.bench.closed_loop.policy import Policy, decide
from tools.bench.closed_loop.views import cloud, project

Seen = list[dict[str, View]]

PARTS = {  # what is what in every task
    "table": ("table",),
    "background": factors.BACKGROUND,
    "robot": ("hand", "finger_left", "finger_right", *(f"link{k}" for k in range(8))),
}


@dataclass(frozen=True)
class Trial:
    """One episode: what it is, whether it succeeded, the instruction, what was seen before each key pose, and the
    handles of what acts and is acted on there."""

    task: str
    condition: str
    seed: int
    episode: int
    success: bool
    instruction: str
    seen: Seen
    roles: Mapping[str, Sequence[int]]


def trials(
    policy: Policy | None,
    layouts: Mapping[str, Sequence[int]],
    conditions: Sequence[str],
    *,
    seed: int,
    use: str = "testing",
) -> Iterator[Trial]:
    """Every task under every condition in each of its layouts, which are numbers of the seed's.

    None is the policy that never moves.
    """
    for number, (task, episodes) in enumerate(layouts.items()):
        for condition in conditions:
            for episode in episodes:
                yield trial(policy, task, number, condition, seed, episode, use)


def trial(
    policy: Policy | None,
    task: str,
    number: int,
    condition: str,
    seed: int,
    episode: int,
    use: str = "testing",
) -> Trial:
    """One episode from its start until it succeeds, the arm cannot reach, or the key poses run out."""
    rng = np.random.default_rng([seed, episode, number, looks.CONDITIONS.index(condition), 7])
    job, world, _ = stage(task, seed, episode, looks.ROOM, looks.ROAM)
    look = looks.draw(condition, world, job, use, rng, looks.ROOM)
    seen: Seen = []
    with closing(Bench(task, job, world, look)) as bench:
        done = bench.solved()
        for key in range(0 if policy is None else policy.most):
            if done:
                break
            assert policy is not None
            views = bench.observe()
            seen.append(views)
            image = project(*cloud(views.values()))
            action = decide(policy, image, number * policy.most + key)
            reached = bench.act(action.pose, OPEN if action.open else 0.0)
            done = bench.solved()
            if not reached:
                break
    parts = {**PARTS, "manipulated": (job.manipulated,)}
    roles = {role: [world.handles[name] for name in names] for role, names in parts.items()}
    return Trial(task, condition, seed, episode, done, job.descriptions[0], seen, roles)
