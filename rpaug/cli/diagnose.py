"""`rpaug diagnose`: failures of an evaluation become causes, a report, and the next recipe."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rpaug.cli.console import (
    AsJson,
    KeyVariable,
    Llm,
    ModelName,
    Patience,
    Price,
    console,
    dataset_path,
    plain,
    print_json,
    say,
    write_new,
)
from rpaug.core.errors import BadInput, RpaugError


# Long: the options of a command are its signature.
def diagnose(
    evaluation: Annotated[
        Path,
        typer.Argument(
            help="JSONL file of rollouts, or the folder of RVT's or LeRobot's evaluation.",
            show_default=False,
        ),
    ],
    dataset: Annotated[
        Path | None,
        typer.Option(
            help="The training recordings: what the policy is used to.", parser=dataset_path
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the recipe here, and diagnosis.json beside it; must not exist."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write an HTML page with the key frames here.")
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(help="Which of the recordings' cameras the videos of a folder show."),
    ] = None,
    copies: Annotated[int, typer.Option(min=1, help="Copies of each episode in the recipe.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the recipe and of the analysis.")] = 0,
    llm: Llm = None,
    model: ModelName = None,
    second_llm: Annotated[
        str | None, typer.Option(help="URL of a second one: only causes that both name are kept.")
    ] = None,
    second_model: ModelName = None,
    key_env: KeyVariable = "RPAUG_LLM_KEY",
    second_key_env: KeyVariable = "RPAUG_LLM_KEY_2",
    timeout: Patience = 60.0,
    price: Price = None,
    as_json: AsJson = False,
) -> int:
    """Say why rollouts failed, and write the recipe against it.

    --llm names a model that sees pictures. Without one a rule-based analyst compares measured image statistics with
    the recordings'. Exit codes: 0 a recipe, or nothing to fix; 1 failures that nothing measured explains, or that no
    edit helps; 2 an error, nothing written.

    Example: [bold]rpaug diagnose eval.jsonl --dataset data/push_button --out next.yaml --report why.html[/]
    """
    from rpaug.diagnosis import diagnose as judge
    from rpaug.diagnosis import page, read, reference
    from rpaug.providers import llm_settings

    beside = None if out is None else out.parent / "diagnosis.json"
    for path, flag in ((out, "--out"), (beside, "--out"), (report, "--report")):
        if path is not None and path.exists():
            raise BadInput(path, flag, found="something there already", expected="a new path")
    analyst = vision(llm, model, key_env, timeout, price)
    if second_model is not None and second_llm is None:
        raise RpaugError("--second-model needs the endpoint's URL: --second-llm")
    second = vision(second_llm or llm_settings.OFF, second_model, second_key_env, timeout, price)
    if second is not None and analyst is None:
        raise RpaugError("--second-llm cross-checks --llm: give that too")
    rollouts = read(evaluation, camera)
    usual = reference.learn(dataset) if dataset is not None and rollouts.failures else None
    found = judge(
        rollouts, dataset, analyst=analyst, second=second, reference=usual, seed=seed, copies=copies
    )
    shown = page.page(found, rollouts, usual) if report is not None else b""
    if beside is not None and out is not None:
        write_new(beside, found.model_dump_json(indent=1).encode() + b"\n")
        if found.recipe is not None:
            write_new(out, page.recipe_file(found).encode())
    if report is not None:
        write_new(report, shown)
    if as_json:
        print_json(found.model_dump(mode="json"))
    else:
        _show(found, out)
    return 0 if found.recipe is not None or found.verdict == "nothing to fix" else 1


def vision(
    url: str | None,
    model: str | None,
    key_env: str,
    timeout: float,
    price: Price,
) -> Any:
    """The vision model that options, environment or file name; None where the rules judge."""
    from rpaug.providers import llm_settings

    found = llm_settings.endpoint(url, model, key_env=key_env, timeout=timeout, price=price)
    if found is None:
        return None
    from rpaug.diagnosis.vision import Vision

    return Vision(found)


def _show(found: Any, out: Path | None) -> None:
    from rpaug.diagnosis import page

    say(f"{found.verdict}: {found.failures} of {found.rollouts} rollouts failed ({found.analyst})")
    for cause in found.causes:
        say(f"- {cause.factor} (confidence {cause.confidence:.2f}): {cause.detail}")
        say(f"  remedy: {cause.remedy}" if cause.edits else f"  no edit: {cause.note}")
    for note in found.notes:
        console.print(f"note: {plain(note)}", highlight=False, soft_wrap=True)
    for who, used in found.usage.items():
        console.print(f"{plain(who)}: {plain(str(used))}", highlight=False, soft_wrap=True)
    if found.recipe is not None and out is None:
        say(page.recipe_file(found).rstrip())
