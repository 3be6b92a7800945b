"""Train, evaluate, diagnose, augment, train again: a loop around any training and evaluation command."""

import json
import os
import shlex
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.files import PART, apart, write_atomic
from rpaug.core.owner import owned
from rpaug.diagnosis import reading, tethered
from rpaug.diagnosis.analyst import Analyst
from rpaug.diagnosis.diagnose import diagnose
from rpaug.diagnosis.evaluation import Evaluation
from rpaug.diagnosis.messages import Diagnosis
from rpaug.pipeline import augment, recipe
from rpaug.pipeline.run import Budget

STATE = "loop.json"
KNOWN = ("data", "policy", "evaluation", "round")
LAST_WORDS = 2000  # characters of a command's output that an error repeats

Made = TypeVar("Made")
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Loop:
    """What is asked for.

    `train` is given the datasets to train on as {data} (one argument each, the recorded one first) and leaves its
    policy at {policy}; `evaluate` is given {policy} and leaves an evaluation at {evaluation}. Both may use {round}.
    `copies` of each recorded episode are added in every round. `policy` was trained before: round 0 judges it and
    trains none.
    """

    dataset: Path
    train: str
    evaluate: str
    out: Path
    rounds: int = 2
    copies: int = 4
    workers: int = 1
    seed: int = 0
    policy: Path | None = None


@dataclass(frozen=True)
class LoopRound:
    """What one round came to."""

    number: int
    success: float
    rollouts: int
    verdict: str | None = None
    causes: tuple[str, ...] = ()
    copies: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


def check(loop: Loop, resume: bool = False) -> None:
    """See that a loop may start. Raises BadInput and RpaugError before anything is run."""
    words(loop.train, "--train", data=["DATA"], policy=Path("POLICY"), round=0)
    words(loop.evaluate, "--eval", policy=Path("POLICY"), evaluation=Path("EVALUATION"), round=0)
    augment.Run(loop.dataset, recipe.build({"version": 1}), loop.out).adapter  # noqa: B018
    apart(loop.out, loop.dataset)
    if loop.policy is not None and not loop.policy.exists():
        raise BadInput(
            loop.policy, "--policy", found="nothing there", expected="what --train would leave"
        )
    if not loop.out.exists():
        return
    if not resume:
        raise BadInput(
            loop.out, "--out", found="something there already", expected="a new path, or --resume"
        )
    path = loop.out / STATE
    try:
        begun = json.loads(path.read_bytes())["loop"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(
            path, "--resume", found="no loop of rpaug here", expected="the --out of a stopped loop"
        ) from None
    now = _described(loop)
    for name in now:
        if name not in ("rounds", "workers") and begun.get(name) != now[name]:
            raise BadInput(
                path,
                name,
                found=f"{begun.get(name)!r}",
                expected=f"{now[name]!r}, as now asked for",
            )


def run(
    loop: Loop,
    *,
    resume: bool = False,
    tell: Tell = lambda words: None,
    analyst: Analyst | None = None,
) -> list[LoopRound]:
    """Go round until the rounds are done or nothing is left to mend; what is finished already is not done again.

    Failures are judged by `analyst`, by rules where there is none; each round's diagnosis names it. Every step's result
    appears by one rename, so a stopped loop can be resumed. Raises BadInput, LanguageError, and RpaugError with the
    last words of a command that failed. While it runs the folder is its own: another loop is refused.
    """
    with owned(loop.out):
        return _run(loop, resume, tell, analyst)


def _run(loop: Loop, resume: bool, tell: Tell, analyst: Analyst | None) -> list[LoopRound]:
    check(loop, resume)
    loop.out.mkdir(parents=True, exist_ok=True)
    done: list[LoopRound] = []
    data = [loop.dataset]
    for number in range(loop.rounds + 1):
        _write(loop, done)
        done.append(_round(loop, number, data, tell, analyst))
        if not done[-1].copies:
            break
        data.append(_home(loop, number) / "data")
    _write(loop, done)
    return done


def _round(
    loop: Loop, number: int, data: Sequence[Path], tell: Tell, analyst: Analyst | None
) -> LoopRound:
    home, clock = _home(loop, number), _Clock()
    home.mkdir(exist_ok=True)
    if number == 0 and loop.policy is not None:
        policy = loop.policy
    else:
        tell(f"round {number}: training on {len(data)} dataset{'s' * (len(data) > 1)}")
        policy = clock("train", lambda: _trained(loop, home, number, data))
    tell(f"round {number}: evaluating")
    found = clock("evaluate", lambda: _evaluated(loop, home, number, policy))
    rollouts = len(found.rollouts)
    this = LoopRound(number, 1 - len(found.failures) / rollouts, rollouts, seconds=clock.seconds)
    tell(f"round {number}: {this.success:.0%} of {rollouts} rollouts succeeded")
    if number == loop.rounds:
        return this
    given = clock("diagnose", lambda: _diagnosed(loop, home, found, analyst))
    causes = tuple(cause.factor for cause in given.causes)
    tell(f"round {number}: {given.verdict}{': ' * bool(causes)}{', '.join(causes)}")
    copies = 0
    if given.recipe is not None:
        tell(f"round {number}: augmenting")
        copies = clock("augment", lambda: _augmented(loop, home / "data", given, tell))
    return replace(this, verdict=given.verdict, causes=causes, copies=copies)


def _home(loop: Loop, number: int) -> Path:
    return loop.out / f"round{number}"


def words(command: str, flag: str, **given: Any) -> list[str]:
    """The command's arguments, its placeholders filled in; {data} becomes one argument a dataset. No shell is used.

    Raises BadInput.
    """
    try:
        parts = shlex.split(command)
    except ValueError as error:
        raise BadInput(command, flag, found=str(error), expected="a command line") from None
    if not parts:
        raise BadInput(command, flag, found="nothing", expected="a command line")
    out: list[str] = []
    for part in parts:
        if part == "{data}" and "data" in given:
            out += map(str, given["data"])
            continue
        for name in KNOWN:
            hole = "{" + name + "}"
            if hole not in part:
                continue
            if name == "data" or name not in given:
                expected = "{data} as an argument of its own, in --train alone"
                if name != "data":
                    expected = " ".join("{" + one + "}" for one in given)
                raise BadInput(command, flag, found=f"{hole} in {part!r}", expected=expected)
            part = part.replace(hole, str(given[name]))
        out.append(part)
    leaves = "policy" if "data" in given else "evaluation"
    if "{" + leaves + "}" not in command:
        raise BadInput(
            command,
            flag,
            found="a command without it",
            expected="{" + leaves + "}, where its result goes",
        )
    return out


def _trained(loop: Loop, home: Path, number: int, data: Sequence[Path]) -> Path:
    def command(into: Path) -> list[str]:
        return words(loop.train, "--train", data=data, policy=into, round=number)

    return _made(home / "policy", command, home / "train.log")


def _evaluated(loop: Loop, home: Path, number: int, policy: Path) -> Evaluation:
    def command(into: Path) -> list[str]:
        return words(loop.evaluate, "--eval", policy=policy, evaluation=into, round=number)

    return reading.read(_made(home / "evaluation", command, home / "evaluate.log"))


def _made(result: Path, command: Callable[[Path], list[str]], log: Path) -> Path:
    """Run a command unless its result is there: it writes beside it, and a rename makes it whole."""
    if result.exists():
        return result
    work = result.with_name(f".{result.name}{PART}")
    if work.is_dir():
        shutil.rmtree(work)
    work.unlink(missing_ok=True)
    parts = command(work)
    with log.open("wb") as stream:
        try:
            code = tethered.run(parts, stream)
        except OSError as error:
            raise RpaugError(f"{parts[0]}: {error.strerror}; expected a program") from None
    if code:
        stated = log.read_text(errors="replace")[-LAST_WORDS:].strip()
        raise RpaugError(f"{shlex.join(parts)} ended with exit code {code} ({log}): {stated}")
    if not work.exists():
        raise RpaugError(f"{shlex.join(parts)} ended well but left nothing at {work} ({log})")
    os.rename(work, result)
    return result


def _diagnosed(loop: Loop, home: Path, found: Evaluation, analyst: Analyst | None) -> Diagnosis:
    path = home / "diagnosis.json"
    if path.exists():
        return Diagnosis.model_validate_json(path.read_bytes())
    given = diagnose(found, loop.dataset, analyst=analyst, seed=loop.seed, copies=loop.copies)
    if given.recipe is not None:
        write_atomic(home / "recipe.yaml", yaml.safe_dump(given.recipe, sort_keys=False).encode())
    write_atomic(path, given.model_dump_json(indent=1).encode())
    return given


def _augmented(loop: Loop, made: Path, given: Diagnosis, tell: Tell) -> int:
    written = recipe.build(given.recipe, name="the diagnosed recipe")
    asked = augment.Run(loop.dataset, written, made)
    summary = augment.execute(asked, workers=loop.workers, budget=Budget(), resume=made.exists())
    if not summary.copies:
        raise RpaugError(
            f"{made}: no copy could be made: {next(iter(summary.failures.values()), '')}"
        )
    for words in summary.lacked:
        tell(f"left out: {words}")
    for words in summary.shortfalls:
        tell(f"not as asked: {words}")
    return summary.copies


class _Clock:
    """Seconds of each step of a round."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, name: str, step: Callable[[], Made]) -> Made:
        start = time.perf_counter()
        made = step()
        self.seconds[name] = round(time.perf_counter() - start, 2)
        return made


def _described(loop: Loop) -> dict[str, Any]:
    paths = {"dataset": loop.dataset, "out": loop.out, "policy": loop.policy}
    return asdict(loop) | {name: path and str(path.resolve()) for name, path in paths.items()}


def _write(loop: Loop, done: Sequence[LoopRound]) -> None:
    given = {"version": 1, "loop": _described(loop), "rounds": [asdict(one) for one in done]}
    write_atomic(loop.out / STATE, (json.dumps(given, indent=1) + "\n").encode())
