"""The commands as a person or a script calls them: output, JSON, exit codes, one line for what is wrong."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rolling import demonstration
from rpaug_adapters.rlbench import RLBench
from rpaug_adapters.rlbench.pickles import dump, load
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.pipeline import workers
from rpaug.pipeline.run import Budget

GROUP = "roll_ball/all_variations/episodes"
GOOD = "version: 1\nedits:\n  - {op: recolor, target: {handle: 300}, color: blue}\n"


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "recipe.yaml"
    path.write_text(GOOD)
    return path


def test_every_command_shows_an_example() -> None:
    for command in (
        ["augment"],
        ["inspect"],
        ["fit"],
        ["twin", "record"],
        ["bench", "tiers"],
        ["bench", "speed"],
        ["validate-recipe"],
        ["doctor"],
    ):
        code, out, _ = run(*command, "--help")
        assert code == 0
        assert "Example:" in out, command
        assert "--json" in out, command


def test_augment_says_where_everything_is(template: Path, tmp_path: Path, recipe: Path) -> None:
    code, out, _ = run("augment", template, "--recipe", recipe, "--out", tmp_path / "out")
    assert code == 0
    assert out.rstrip().endswith("rpaug.contact.html")
    page = (tmp_path / "out" / "rpaug.contact.html").read_text()
    assert page.count("data:image/jpeg") == 4  # two episodes, two cameras
    assert "recolor" in page


def test_augment_as_json(template: Path, tmp_path: Path, recipe: Path) -> None:
    code, out, err = run(
        "augment", template, "--recipe", recipe, "--out", tmp_path / "out", "--seed", 5, "--json"
    )
    described = json.loads(out)
    assert (code, described["copies"], described["failures"], err) == (0, 2, {}, "")
    assert described["changed_share"]["front"] > 0
    report = json.loads((tmp_path / "out" / GROUP / "episode0/rpaug.json").read_bytes())
    assert report["seed"] == 5


def test_all_is_made_within_a_budget(
    template: Path, tmp_path: Path, recipe: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, run_jobs = list[object](), workers.run

    def noted(jobs: Any, workers: int, budget: object) -> Any:
        given.append(budget)
        return run_jobs(jobs, workers, budget)

    monkeypatch.setattr(workers, "run", noted)
    run("augment", template, "--recipe", recipe, "--out", tmp_path / "all")
    one = ("--set", "select.limit=1")
    run("augment", template, "--recipe", recipe, "--out", tmp_path / "one", *one)
    stated = ("--most-memory", 2, "--most-minutes", 3)
    run("augment", template, "--recipe", recipe, "--out", tmp_path / "stated", *one, *stated)
    assert given == [Budget(), Budget(), Budget(2e9, 3)]


def test_a_dry_run_writes_nothing(template: Path, tmp_path: Path, recipe: Path) -> None:
    code, out, _ = run(
        "augment", template, "--recipe", recipe, "--out", tmp_path / "out", "--dry-run", "--json"
    )
    described = json.loads(out)
    assert code == 0
    assert described["estimate"]["seconds"] > 0
    assert described["plans"][0]["carriers"]["front"] == "tier 0, recorded pixels"
    code, out, _ = run(
        "augment", template, "--recipe", recipe, "--out", tmp_path / "out", "--dry-run"
    )
    assert "Nothing was written" in out
    assert not (tmp_path / "out").exists()


def test_a_shipped_recipe_goes_by_its_name() -> None:
    for name in ("demo", "light_color", "colosseum/all", "colosseum/tasks/open_drawer"):
        assert run("validate-recipe", name)[0] == 0
    code, _, err = run("validate-recipe", "no_such")
    assert code == 2
    assert "colosseum/light_color" in err


def test_the_schema_is_json() -> None:
    assert json.loads(run("validate-recipe", "--schema")[1])["title"] == "rpaug recipe"


def test_inspect_lists_instances(template: Path, tmp_path: Path) -> None:
    code, out, _ = run("inspect", template, "--html", tmp_path / "i.html")
    assert code == 0
    assert "300" in out
    assert "roll the ball" in out
    page = (tmp_path / "i.html").read_text()
    assert page.count("<img") == 3 + 2  # a thumbnail an instance, and the roles' outlines a camera
    assert "one of 2 episodes" in out
    described = json.loads(run("inspect", template, "--json")[1])
    assert described["episodes"] == 2
    assert {row["handle"] for row in described["instances"]} == {7, 300, 0xABCDEF}
    assert run("inspect", template, "--html", tmp_path / "i.html")[0] == 2  # nothing is overwritten
    code, _, err = run("inspect", template, "--episode", "none")
    assert code == 2
    assert "episode1" in err


def test_of_many_instances_those_are_listed_that_have_a_role_or_most_pixels(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = json.loads(run("inspect", template, "--json")[1])["instances"]
    plain = [row for row in every if not row["role"]]
    monkeypatch.setattr("rpaug.cli.inspect.LINES", 1)
    _, out, _ = run("inspect", template)
    listed = {int(line.split()[0]) for line in out.splitlines() if line.lstrip()[:1].isdigit()}
    most = max(every, key=lambda row: sum(row["pixels"].values()))
    assert listed == {row["handle"] for row in every if row["role"]} | {most["handle"]}
    left = len(every) - len(listed)
    assert left > 0
    assert len(plain) >= left
    assert f"and {left} of which less is seen: --html FILE" in out
    assert "of which less is seen" not in json.dumps(every)


def test_inspect_says_where_a_motion_is_open(tmp_path: Path) -> None:
    RLBench().write(demonstration(1), tmp_path, "roll/all_variations/episodes/episode0", dict)
    _, out, _ = run("inspect", tmp_path)
    assert "static (ambiguous)" in out


def test_a_terminal_obeys_nothing_of_a_dataset(template: Path, tmp_path: Path) -> None:
    dataset = Path(shutil.copytree(template, tmp_path / "ds"))
    for path in dataset.rglob("variation_descriptions.pkl"):
        path.write_bytes(dump(["push \x1b[31mit [bold]now"]))
    _, shown, _ = run("inspect", dataset)
    assert "\x1b" not in shown
    assert r"push \x1b[31mit [bold]now" in shown


def test_doctor_finds_what_is_installed() -> None:
    code, out, _ = run("doctor", "--json")
    findings = {one["topic"]: one for one in json.loads(out)}
    assert code == 0
    assert findings["operators"]["level"] == "ok"
    assert "recolor" in findings["operators"]["message"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("recolor", "recolour"), ["recipe.yaml:3", "recolour", "recolor"]),
        (GOOD.replace("blue", "{rgb: [0, 0, 2]}"), ["recipe.yaml:3", "edits[0].color", "0..1"]),
        (GOOD.replace("300", "4711"), ["4711", "there is", "300"]),
        (GOOD.replace("{handle: 300}", "{role: receiver}"), ["receiver"]),
        (GOOD.replace("{handle: 300}", "{text: the red cup}"), ["red"]),
        (GOOD + "gates: {holes: -1}\n", ["gates.holes"]),
    ],
)
def test_a_recipe_that_cannot_be_met_is_one_line_and_code_2(
    template: Path, tmp_path: Path, recipe: Path, text: str, words: list[str]
) -> None:
    recipe.write_text(text)
    code, out, err = run("augment", template, "--recipe", recipe, "--out", tmp_path / "out")
    assert code == 2
    assert all(word in err for word in words), err
    assert "Traceback" not in err + out
    assert not (tmp_path / "out").exists()


def foreign(folder: Path) -> None:
    (folder / "low_dim_obs.pkl").write_bytes(b"cos\nsystem\n(S'true'\ntR.")


def nan(folder: Path) -> None:
    demo = load(folder / "low_dim_obs.pkl")
    demo._observations[1].misc["front_camera_extrinsics"][0, 3] = float("nan")
    (folder / "low_dim_obs.pkl").write_bytes(dump(demo))


def missing(folder: Path) -> None:
    (folder / "front_rgb/4.png").unlink()


def cut(folder: Path) -> None:
    path = folder / "front_depth/4.png"
    path.write_bytes(path.read_bytes()[:200])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (foreign, ["low_dim_obs.pkl", "os.system"]),
        (nan, ["low_dim_obs.pkl", "observation 1", "front_camera_extrinsics", "NaN"]),
        (missing, ["front_rgb/4.png"]),
        (cut, ["front_depth/4.png", "cut off"]),
    ],
)
def test_bad_files_are_one_line_each_and_code_2(
    dataset: Path,
    tmp_path: Path,
    recipe: Path,
    spoil,
    words: list[str],  # type: ignore[no-untyped-def]
) -> None:
    for number in (0, 1):
        spoil(dataset / GROUP / f"episode{number}")
    code, out, err = run("augment", dataset, "--recipe", recipe, "--out", tmp_path / "out")
    assert code == 2
    assert all(word in err for word in words), err
    assert len(err.strip().splitlines()) == 2
    assert "Traceback" not in err + out
    assert not (tmp_path / "out").exists()
    as_json = json.loads(
        run("augment", dataset, "--recipe", recipe, "--out", tmp_path / "out", "--json")[1]
    )
    assert len(as_json["failures"]) == 2


def test_what_is_no_dataset_is_said_so(tmp_path: Path, recipe: Path) -> None:
    for folder in (tmp_path / "nowhere", tmp_path):
        code, _, err = run("augment", folder, "--recipe", recipe, "--out", tmp_path / "out")
        assert code == 2
        assert str(folder) in err
    code, out, _ = run("augment", tmp_path, "--recipe", recipe, "--out", tmp_path / "out", "--json")
    assert "rlbench" in json.loads(out)["error"]


def test_colons_are_no_pictures(template: Path, tmp_path: Path, recipe: Path) -> None:
    given = ("--recipe", recipe, "--out", tmp_path / "out", "--ratio", "a:b:")
    code, _, err = run("augment", template, *given)
    assert code == 2
    assert "--ratio a:b:" in err


def test_the_slurm_array_of_the_examples_runs_as_written(template: Path, tmp_path: Path) -> None:
    script = Path(__file__).parents[2] / "examples/slurm_array.sh"
    shutil.copytree(template, tmp_path / "data/train/open_drawer")
    light = {"version": 1, "copies": 2, "edits": [{"op": "light_color"}]}
    (tmp_path / "recipe.yaml").write_text(json.dumps(light))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    env = os.environ | {"SLURM_ARRAY_TASK_COUNT": "2", "SLURM_CPUS_PER_TASK": "1", "PATH": path}
    for number in ("1", "2", "2"):  # the last is put in the queue again
        given = env | {"SLURM_ARRAY_TASK_ID": number}
        subprocess.run(["bash", script], cwd=tmp_path, env=given, check=True)
    command = "rpaug merge augmented augmented.parts/* --json"
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, env=env, check=True, capture_output=True
    )
    assert json.loads(done.stdout)["copies"] == 4
    assert (tmp_path / "augmented/rpaug.contact.html").is_file()


@pytest.mark.parametrize("given", ["3/2", "0/2", "1", "a/b", "1/2/3"])
def test_a_part_that_is_none_is_refused(given: str, template: Path, tmp_path: Path) -> None:
    code, _, err = run(
        "augment", template, "--recipe", "demo", "--out", tmp_path / "out", "--shard", given
    )
    assert code == 2
    assert f"--shard {given}: expected" in err
