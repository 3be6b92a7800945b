"""`rpaug loop`: train, evaluate, diagnose, augment, and train again."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import (
    AsJson,
    Dataset,
    KeyVariable,
    Llm,
    ModelName,
    Patience,
    Price,
    console,
    plain,
    print_json,
)
from rpaug.cli.diagnose import vision


def loop(
    dataset: Dataset,
    train: Annotated[
        str,
        typer.Option(
            help="Training command: {data} are the datasets, {policy} is where its policy goes."
        ),
    ],
    evaluate: Annotated[
        str,
        typer.Option(
            "--eval", help="Evaluation command: {policy} is judged, {evaluation} is where it goes."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write; must not exist unless --resume.")],
    rounds: Annotated[int, typer.Option(min=1, help="Times to augment and train again.")] = 2,
    copies: Annotated[int, typer.Option(min=1, help="Copies of each episode, every round.")] = 4,
    workers: Annotated[int, typer.Option(min=1, help="Processes that augment.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of the diagnosed recipes.")] = 0,
    policy: Annotated[
        Path | None, typer.Option(help="Trained before: round 0 judges it and trains none.")
    ] = None,
    resume: Annotated[bool, typer.Option(help="Go on with a loop that was stopped.")] = False,
    llm: Llm = None,
    model: ModelName = None,
    key_env: KeyVariable = "RPAUG_LLM_KEY",
    timeout: Patience = 60.0,
    price: Price = None,
    as_json: AsJson = False,
) -> int:
    """Train a policy, evaluate it, find out why it failed, augment against that, and train again.

    Commands run without a shell; what they print goes into log files. {round} counts from 0. An evaluation is what
    `rpaug diagnose` reads. --llm names a model that judges pictures, as there.

    Example: [bold]rpaug loop data/train --train "python train.py --data {data} --out {policy}"
    --eval "python eval.py {policy} {evaluation}" --out looped[/]
    """
    from rpaug.diagnosis import loop as looping

    asked = looping.Loop(dataset, train, evaluate, out, rounds, copies, workers, seed, policy)
    looping.check(asked, resume)
    analyst = vision(llm, model, key_env, timeout, price)
    done = looping.run(
        asked, resume=resume, tell=lambda words: _tell(words, as_json), analyst=analyst
    )
    if as_json:
        print_json({"out": str(out), "rounds": [asdict(one) for one in done]})
        return 0
    for one in done:
        console.print(plain(f"round {one.number}: {one.success:.1%} of {one.rollouts} rollouts"))
    return 0


def _tell(words: str, as_json: bool) -> None:
    if not as_json:
        console.print(plain(words), style="dim")
