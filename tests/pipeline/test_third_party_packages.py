"""examples/frames, an adapter, and examples/pull_push, a model, as packages of their own: installed by pip and used."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from third_party import ROOT, commands, install, own_tests

RECOLOR = {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"}


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install("frames", tmp_path_factory.mktemp("frames"))


@pytest.fixture(scope="module")
def pull_push(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install("pull_push", tmp_path_factory.mktemp("pull_push"))


def all_well(done: list[tuple[int, str]]) -> None:
    assert all(code == 0 for code, _ in done), done


def test_the_adapter_meets_its_contract(frames: Path, tmp_path: Path) -> None:
    assert "7 passed" in own_tests(frames, "frames", tmp_path)


def test_the_adapter_takes_part_in_all_commands(frames: Path, tmp_path: Path) -> None:
    """The sample in its layout, edited and verified there; what no edit reached kept its bytes."""
    data, out, recipe = (str(tmp_path / name) for name in ("data", "out", "recipe.yaml"))
    Path(recipe).write_text(json.dumps({"version": 1, "edits": [RECOLOR]}))
    all_well(commands(frames, [
        ["convert", "sample", "--to", "frames", "--out", data, "--json"],
        ["inspect", data, "--json"],
        ["augment", data, "--recipe", recipe, "--out", out, "--json"],
        ["verify", out, "--against", data, "--json"],
    ]))  # fmt: skip
    (facts,) = Path(data).rglob("episode.json")
    reports = {path.parent: json.loads(path.read_text()) for path in Path(out).rglob("rpaug.json")}
    (made,) = (folder for folder, report in reports.items() if report["synthetic"])
    pairs = [(path, made / path.relative_to(facts.parent)) for path in facts.parent.rglob("*.png")]
    same = [old.read_bytes() == new.read_bytes() for old, new in pairs]
    assert all(one for one, (old, _) in zip(same, pairs, strict=True) if "rgb" not in old.name)
    assert not all(same)


def test_the_model_meets_its_own_test(pull_push: Path, tmp_path: Path) -> None:
    assert "1 passed" in own_tests(pull_push, "pull_push", tmp_path)


def test_the_model_paints_what_nobody_saw(pull_push: Path, tmp_path: Path) -> None:
    """Its paint differs from that of the usual way, in some pixels; a name that nobody brings is refused."""
    images = {}
    for way in ("fsr", "pull_push"):
        recipe, out = tmp_path / f"{way}.yaml", tmp_path / way
        edit = {"op": "remove"}
        told = {"version": 1, "seed": 1, "models": {"inpaint": way}, "edits": [edit]}
        recipe.write_text(json.dumps(told))
        given = ["augment", "sample", "--recipe", str(recipe), "--out", str(out), "--json"]
        all_well(commands(pull_push, [given]))
        images[way] = {
            path.relative_to(out): cv2.imread(str(path)) for path in out.rglob("*_rgb/*.png")
        }
    differs = [
        (one != images["pull_push"][name]).any(axis=-1).mean()
        for name, one in images["fsr"].items()
    ]
    assert 0 < np.max(differs) < 0.1
    edit = {"version": 1, "edits": [{"op": "remove", "inpaint": "pullpush"}]}
    recipe.write_text(json.dumps(edit))
    ((code, said),) = commands(pull_push, [["validate-recipe", str(recipe)]])
    assert code == 2
    assert "no inpainting is called 'pullpush'" in " ".join(said.split())


def test_the_page_points_at_all_three() -> None:
    page = (ROOT / "docs/extending.md").read_text()
    assert all(f"(../examples/{name}/)" in page for name in ("glow", "frames", "pull_push"))
