"""The arms: what each policy is trained on, and how it then does."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8

from rpaug.core.files import encode_png, write_atomic
from rpaug.diagnosis import jsonl
from tools.bench.closed_loop import data, layouts, looks, result, samples, training, trials
from tools.bench.closed_loop.bench import View

TASKS = ("open_drawer", "push_button", "slide_block", "stack_cups", "put_in_box")
MOST = 6  # key poses of the longest task
ARMS = (
    "plain",
    "jitter",
    "oracle_valid",
    "oracle",
    "diagnosed",
    "rpaug",
)  # each held to those before it
TESTS, VALIDATION = 2000, 3000  # seeds of layouts
ENDS = (".png", "-mask.png")  # of images and masks


@dataclass(frozen=True)
class Size:
    """How much is done."""

    tasks: tuple[str, ...] = TASKS
    demos: int = 25
    copies: int = 4
    steps: int = 2000
    episodes: int = 10
    conditions: tuple[str, ...] = looks.CONDITIONS
    rounds: int = 2


AS_TESTED = (
    "edits.5.range=[[0.1, 0.1, 0.1], [0.5, 0.5, 0.5]]",
    "edits.6.camera=[front, left_shoulder, right_shoulder]",
    "edits.6.shift=0.1",
    "edits.6.turn=0.05",
)
"""Lamps as dim, and cameras moved as far, as in the tests, which draw COLOSSEUM's; `robust` itself stays within what
lamps in a room do, and where copies stay true without the arm's file."""

SMOKE = Size(TASKS[:2], 2, 2, 20, 1, ("none", "object_color", "all"), 1)


def run(
    work: Path, size: Size, arms: Sequence[str], seeds: range, workers: int, as_json: bool
) -> None:
    """Do what is missing, print what came of it."""
    work.mkdir(parents=True, exist_ok=True)
    demos = data.recorded(work / "demos", size.tasks, size.demos)
    if "rpaug" in arms:
        data.augmented(work / "rpaug", demos, "robust", size.copies, workers, *AS_TESTED)
    for arm, left in (("oracle", ()), ("oracle_valid", looks.INVALIDATING)):
        if arm in arms:
            data.rendered(work / arm, size.tasks, size.demos, size.copies, left)
    tested(work, size)
    jobs = [(work, size, arm, seed) for arm in arms for seed in seeds]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        done = list(pool.map(measured, *zip(*jobs, strict=True)))
    kept: result.Kept = {}
    for (_, _, arm, seed), found in zip(jobs, done, strict=True):
        kept.setdefault(arm, {})[str(seed)] = result.packed(found)
    write_atomic(work / "outcomes.json", (json.dumps(kept, indent=1) + "\n").encode())
    if as_json:
        print(json.dumps(kept))
    elif not set(looks.CONDITIONS) - set(size.conditions):
        for table in result.tables(
            kept, arms, seeds, f"python -m tools.bench.closed_loop run {work}"
        ):
            print(table.markdown())
    else:
        for arm in arms:
            one = result.outcomes(kept[arm], seeds)
            print(f"{arm}: {one.rate(size.conditions):.0f} % of {one.success.size} episodes")


def measured(work: Path, size: Size, arm: str, seed: int) -> list[list[Any]]:
    """The outcomes of one policy, (task, condition, episode, success) each."""
    torch.set_num_threads(1)
    kept = work / "policies" / f"{arm}{seed}" / "outcomes.json"
    if not kept.exists():
        make = looped if arm == "diagnosed" else learnt
        trained = training.load(make(work, size, arm, seed))
        rows = [
            [one.task, one.condition, one.episode, one.success]
            for one in trials.trials(trained, tested(work, size), size.conditions, seed=TESTS)
        ]
        write_atomic(kept, json.dumps(rows).encode())
    return list(json.loads(kept.read_bytes()))


def learnt(work: Path, size: Size, arm: str, seed: int) -> Path:
    """The policy of an arm that trains once, trained if it is not there."""
    policy = work / "policies" / f"{arm}{seed}" / "policy.pt"
    if not policy.exists():
        policy.parent.mkdir(parents=True, exist_ok=True)
        sets = [work / "demos"]
        sets += [work / arm] if arm not in ("plain", "jitter") else []
        learn(policy, sets, seed, size.steps, arm == "jitter", size.tasks)
    return policy


def tested(work: Path, size: Size) -> dict[str, list[int]]:
    """The layouts of the test by task, looked for once."""
    kept = work / "layouts.json"
    if not kept.exists():
        found = {task: layouts.solvable(task, TESTS, size.episodes) for task in size.tasks}
        write_atomic(kept, json.dumps(found).encode())
    return dict(json.loads(kept.read_bytes()))


def learn(
    policy: Path, datasets: list[Path], seed: int, steps: int, jitter: bool, tasks: Sequence[str]
) -> None:
    """Train on the first dataset and, for most of each batch, on what was made of it."""
    real = samples.read(datasets[0], tasks)
    made = [sample for other in datasets[1:] for sample in samples.read(other, tasks)]
    trained = training.train(
        real, made, tasks=len(tasks), most=MOST, steps=steps, seed=seed, jitter=jitter
    )
    training.save(trained, policy)


def judge(policy: Path, out: Path, tasks: Sequence[str], episodes: int) -> None:
    """Rollouts under one factor each, as an evaluation that `rpaug diagnose` reads."""
    trained = training.load(policy)
    out.mkdir()
    lines = []
    drawn = dict.fromkeys(tasks, range(episodes))
    for one in trials.trials(trained, drawn, ("none", *looks.SINGLE), seed=VALIDATION):
        name = f"{one.task}-{one.condition}-{one.episode}"
        lines.append(_line(one, name, out))
    jsonl.write(out / "evaluation.jsonl", lines)


def _line(one: trials.Trial, name: str, out: Path) -> jsonl.Line:
    moments = []
    for t, views in enumerate(one.seen):
        images, masks, poses = {}, {}, {}
        for camera, view in views.items():
            images[camera], masks[camera] = (f"{name}-{t}-{camera}{end}" for end in ENDS)
            (out / images[camera]).write_bytes(encode_png(view.rgb))
            (out / masks[camera]).write_bytes(encode_png(_code(view)))
            poses[camera] = view.cam_to_world.tolist()
        moments.append(jsonl.FrameImages(t=t, images=images, masks=masks, poses=poses))
    return jsonl.Line(
        episode=name,
        success=one.success,
        instruction=one.instruction,
        frames=tuple(moments),
        factor=one.condition,
        roles={role: list(instance_ids) for role, instance_ids in one.roles.items()},
    )


def _code(view: View) -> UInt8[np.ndarray, "h w 3"]:
    """Handles as colors: R + 256 G + 65536 B."""
    assert view.ids is not None
    return np.stack([view.ids >> shift & 255 for shift in (0, 8, 16)], -1).astype(np.uint8)


def looped(work: Path, size: Size, arm: str, seed: int) -> Path:
    """The policy of the last round of `rpaug loop`, whose copies together are as many as the other arms'.

    It begins with the policy of `plain`, which is what round 0 would train.
    """
    me = f"{sys.executable} -m tools.bench.closed_loop"
    first, out = learnt(work, size, "plain", seed), work / "policies" / f"{arm}{seed}" / "loop"
    command = [sys.executable, "-m", "rpaug", "loop", str(work / "demos"), "--out", str(out)]
    command += ["--train", f"{me} train {{policy}} {{data}} --seed {seed} --steps {size.steps}"]
    tests = f"--episodes {max(1, size.episodes // 2)} --tasks {' '.join(size.tasks)}"
    command += ["--eval", f"{me} eval {{policy}} {{evaluation}} {tests}"]
    command += ["--rounds", str(size.rounds), "--copies", str(size.copies // size.rounds)]
    command += ["--seed", str(seed), "--policy", str(first)]
    command += ["--resume"] if out.exists() else []
    subprocess.run(command, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    trained = sorted(out.glob("round*/policy"), key=lambda path: int(path.parent.name[5:]))
    return trained[-1] if trained else first
