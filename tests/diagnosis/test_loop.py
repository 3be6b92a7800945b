"""The loop around commands: a policy that fails in the dark until it is given what was made against that."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from endpoints import KEY, Handler, completion, served
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.registry import SAMPLE
from rpaug.diagnosis import loop

COPY = ("--copies", "1", "--json")
TRAIN = """
import json, sys
policy, *data = sys.argv[1:]
open(policy, "w").write(json.dumps(data))
"""
# Rollouts that look like the recordings succeed; dark ones only after training on more than the recordings.
EVAL = """
import json, pathlib, sys
import cv2
policy, out, frames = sys.argv[1:]
seasoned = len(json.loads(open(policy).read())) > 1
root = pathlib.Path(out)
root.mkdir()
lines = []
for number in range(24):
    dark = number % 2 == 1
    shots = []
    for t in (0, 8, 16):
        image = cv2.imread(f"{frames}/front_rgb/{t}.png")
        image = (image * (0.3 + 0.005 * number if dark else 1 - 0.005 * number)).astype("uint8")
        name = f"{number}_{t}.png"
        cv2.imwrite(str(root / name), image)
        shots.append({"t": t, "images": {"front": name}})
    success = seasoned or not dark
    lines.append({"version": 1, "episode": str(number), "success": success, "frames": shots})
(root / "evaluation.jsonl").write_text("".join(json.dumps(line) + "\\n" for line in lines))
"""


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    folder = tmp_path_factory.mktemp("commands")
    (folder / "train.py").write_text(TRAIN)
    (folder / "eval.py").write_text(EVAL)
    frames = next(SAMPLE.glob("**/episode0"))
    python = sys.executable
    return (
        f"{python} {folder}/train.py {{policy}} {{data}}",
        f"{python} {folder}/eval.py {{policy}} {{evaluation}} {frames}",
    )


@pytest.fixture(scope="module")
def looped(commands: tuple[str, str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    out = tmp_path_factory.mktemp("loop") / "looped"
    train, evaluate = commands
    given = CliRunner().invoke(
        app,
        ["loop", str(SAMPLE), "--train", train, "--eval", evaluate, "--out", str(out), *COPY],
    )
    assert given.exit_code == 0, given.output
    return out, json.loads(given.stdout)


def test_it_stops_when_nothing_is_left_to_mend(looped: tuple[Path, Any]) -> None:
    out, given = looped
    first, second = given["rounds"]
    assert first["success"] == 0.5
    assert first["verdict"] == "causes found"
    assert first["causes"][0] == "lighting"
    assert second["success"] == 1.0
    assert second["verdict"] == "nothing to fix"
    assert "light" in (out / "round0/recipe.yaml").read_text()
    trained_on = json.loads((out / "round1/policy").read_text())
    assert trained_on == [str(SAMPLE), str(out / "round0/data")]


def test_what_is_done_is_not_done_again(
    looped: tuple[Path, Any], commands: tuple[str, str]
) -> None:
    out, given = looped
    (out / "round1/policy").write_text('["changed by hand", "two"]')
    again = loop.run(loop.Loop(SAMPLE, *commands, out, copies=1), resume=True)
    assert [one.success for one in again] == [one["success"] for one in given["rounds"]]
    assert "by hand" in (out / "round1/policy").read_text()


def test_a_policy_that_is_there_is_judged_first(commands: tuple[str, str], tmp_path: Path) -> None:
    train, evaluate = commands
    begun, out = tmp_path / "policy", tmp_path / "looped"
    begun.write_text('["trained", "elsewhere"]')
    asked = loop.Loop(SAMPLE, train, evaluate, out, copies=1, policy=begun)
    (only,) = loop.run(asked)
    assert only.success == 1.0
    assert "train" not in only.seconds
    assert not (out / "round0/policy").exists()
    with pytest.raises(BadInput, match="policy"):
        loop.check(loop.Loop(SAMPLE, train, evaluate, out, copies=1), resume=True)
    with pytest.raises(BadInput, match="nothing there"):
        loop.check(loop.Loop(SAMPLE, train, evaluate, tmp_path / "new", policy=tmp_path / "none"))


def test_another_loop_is_not_resumed(looped: tuple[Path, Any], commands: tuple[str, str]) -> None:
    out, _ = looped
    with pytest.raises(BadInput, match="copies"):
        loop.check(loop.Loop(SAMPLE, *commands, out, copies=7), resume=True)
    with pytest.raises(BadInput, match="already"):
        loop.check(loop.Loop(SAMPLE, *commands, out, copies=1))


@pytest.mark.parametrize(
    ("train", "given"),
    [
        ("train {data}", "policy"),
        ("train --data={data} {policy}", "argument of its own"),
        ("train {policy} {evaluation}", "evaluation"),
        ("train '{policy}", "quotation"),
        ("", "nothing"),
    ],
)
def test_commands_that_cannot_work_are_told_before_anything_runs(
    tmp_path: Path, train: str, given: str
) -> None:
    asked = loop.Loop(SAMPLE, train, "eval {policy} {evaluation}", tmp_path / "out")
    with pytest.raises(BadInput, match=given):
        loop.run(asked)
    assert not asked.out.exists()


@pytest.mark.parametrize(
    ("program", "given"),
    [
        ("import sys; print('no GPU here'); sys.exit(3)", "exit code 3.*no GPU here"),
        ("pass", "left nothing"),
    ],
)
def test_a_command_that_fails_is_quoted(
    tmp_path: Path, commands: tuple[str, str], program: str, given: str
) -> None:
    train = f'{sys.executable} -c "{program}" {{policy}}'
    with pytest.raises(RpaugError, match=f"(?s){given}"):
        loop.run(loop.Loop(SAMPLE, train, commands[1], tmp_path / "out"))
    assert not (tmp_path / "out/round0/policy").exists()


def test_a_program_that_is_not_there(tmp_path: Path, commands: tuple[str, str]) -> None:
    with pytest.raises(RpaugError, match="expected a program"):
        loop.run(loop.Loop(SAMPLE, "/no/such {policy}", commands[1], tmp_path / "out"))


def test_an_analyst_judges_instead_of_the_rules(
    commands: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def judged(found: Any, dataset: Path, **how: Any) -> Any:
        asked.append(how["analyst"])
        raise RpaugError("judged")

    monkeypatch.setattr(loop, "diagnose", judged)
    one: Any = object()
    with pytest.raises(RpaugError, match="judged"):
        loop.run(loop.Loop(SAMPLE, *commands, tmp_path / "looped", copies=1), analyst=one)
    assert asked == [one]


STATED = {
    "causes": [{"factor": "lighting", "confidence": 0.95}],
    "detail": "The light is dim.",
    "remedy": "vary the color of the lights",
}


def say(handler: Handler, number: int) -> None:
    """What the model says to a cause's, a detail's or a remedy's prompt."""
    body = handler.server.seen[-1][1]  # type: ignore[attr-defined]
    asked = body["response_format"]["json_schema"]["schema"]["properties"]
    handler.answer(completion(json.dumps({key: STATED[key] for key in asked})))


def test_a_model_judges_from_the_command_line_and_its_key_is_in_no_file(
    commands: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RPAUG_LLM_KEY", KEY)
    train, evaluate = commands
    out = tmp_path / "looped"
    with served(say) as (endpoint, seen):
        given = CliRunner().invoke(
            app,
            ["loop", str(SAMPLE), "--train", train, "--eval", evaluate, "--out", str(out), *COPY,
             "--llm", endpoint.url, "--model", "small"],
        )  # fmt: skip
    assert given.exit_code == 0, given.output
    assert seen
    first, second = json.loads(given.stdout)["rounds"]
    assert (first["causes"], second["success"]) == (["lighting"], 1.0)
    assert "light_color" in (out / "round0/recipe.yaml").read_text()
    written = [path for path in out.rglob("*") if path.is_file()]
    assert all(KEY.encode() not in path.read_bytes() for path in written)
    assert KEY not in given.output


def test_a_model_without_a_url_is_refused(commands: tuple[str, str], tmp_path: Path) -> None:
    train, evaluate = commands
    given = CliRunner().invoke(
        app,
        ["loop", str(SAMPLE), "--train", train, "--eval", evaluate, "--out", str(tmp_path / "o"), "--model", "m"],
    )  # fmt: skip
    assert given.exit_code == 2
    assert "--llm" in given.output


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_loop_ends_its_commands_and_what_they_began(
    sent: signal.Signals, commands: tuple[str, str], tmp_path: Path
) -> None:
    begun = tmp_path / "begun"
    (tmp_path / "train.sh").write_text(
        f"sleep 600 & echo $$ $! > {begun}.part\nmv {begun}.part {begun}\nwait\n"
    )
    command = ["loop", str(SAMPLE), "--train", f"sh {tmp_path}/train.sh {{policy}} {{data}}"]
    command += ["--eval", commands[1], "--out", str(tmp_path / "out"), *COPY]
    run = subprocess.Popen([sys.executable, "-m", "rpaug", *command])
    while not begun.exists():
        assert run.poll() is None
        time.sleep(0.02)
    started = [int(one) for one in begun.read_text().split()]
    with pytest.raises(BadInput, match=f"process {run.pid} of .* expected one run at a time"):
        loop.run(loop.Loop(SAMPLE, *command[3:6:2], tmp_path / "out"), resume=True)
    run.send_signal(sent)
    run.wait()
    ends = time.monotonic() + 5
    while time.monotonic() < ends and any(map(alive, started)):
        time.sleep(0.05)
    assert not any(map(alive, started))


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
