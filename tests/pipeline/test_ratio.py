"""How many copies a ratio gives, where they land, and what the dataset card says of them."""

import json
import shutil
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from rpaug import BadInput
from rpaug.cli import app
from rpaug.core import splits
from rpaug.core.registry import adapter
from rpaug.pipeline import card, recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.convert import convert
from rpaug.pipeline.made import MadeEpisodes
from rpaug.pipeline.missing_copies import MissingCopies
from rpaug.pipeline.verify import verify

TOLD = {"version": 1, "seed": 5, "edits": [{"op": "light_color"}]}
GROUP = "roll_ball/all_variations/episodes"


def header(target: Path) -> dict:
    return yaml.safe_load((target / card.NAME).read_text().split("---\n")[1])


@pytest.fixture
def split_dataset(template: Path, tmp_path: Path) -> Path:
    root = tmp_path / "data"
    for split in ("train", "val"):
        shutil.copytree(template / "roll_ball", root / split / "roll_ball")
    (root / "LICENSE").write_text("\nMIT License\n\nwords\n")
    return root


@pytest.mark.parametrize(
    ("ratio", "synthetic"), [((1, 1), 2), ((1, 3), 6), ((2, 3), 3), ((2, 1), 1), ((1, 2), 4)]
)
def test_a_ratio_is_met_in_each_group(
    split_dataset: Path, tmp_path: Path, ratio: tuple[int, int], synthetic: int
) -> None:
    run = Run(split_dataset, recipe.build(TOLD), tmp_path / "out", ratio=ratio)
    made = [pair for job in MissingCopies(run, MadeEpisodes()) for pair in job.copies]
    for split in ("train", "val"):
        copies = [copy for copy, key in made if key.startswith(split)]
        assert copies.count(0) == 2  # the originals
        assert len(copies) - 2 == synthetic
        keys = {key for _, key in made if key.startswith(split)}
        assert keys == {f"{split}/{GROUP}/episode{i}" for i in range(2 + synthetic)}


def test_copies_stay_in_the_split_of_their_source(split_dataset: Path, tmp_path: Path) -> None:
    summary = execute(
        Run(split_dataset, recipe.build(TOLD), tmp_path / "out", ratio=(2, 1)), workers=1
    )
    assert summary.copies == 6
    for path in (tmp_path / "out").rglob("rpaug.json"):
        key = path.parent.relative_to(tmp_path / "out").as_posix()
        assert splits.of(json.loads(path.read_bytes())["source"]) == splits.of(key)
    given = header(tmp_path / "out")
    assert given["synthetic"] is True
    assert given["episodes"] == {"recorded": 4, "synthetic": 2}
    assert given["license"] == "MIT License (LICENSE of the source)"
    assert given["source_datasets"] == ["data"]
    assert given["ratio"] == "2:1"
    words = (tmp_path / "out" / card.NAME).read_text()
    assert "| train | 2 | 1 |" in words
    assert "op: light_color" in words
    assert any("evaluate on recorded" in one for many in summary.warnings.values() for one in many)
    assert verify(tmp_path / "out", split_dataset).passed


def test_an_adapter_that_crosses_splits_is_stopped(
    split_dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(split_dataset, recipe.build(TOLD), tmp_path / "out")
    monkeypatch.setattr(type(run.adapter), "key_at", lambda _, like, i: f"train/{GROUP}/episode{i}")
    with pytest.raises(BadInput, match="of another split"):
        execute(run)


def test_copies_of_copies_are_told(template: Path, tmp_path: Path) -> None:
    execute(Run(template, recipe.build(TOLD), tmp_path / "once"))
    again = Run(tmp_path / "once", recipe.build(TOLD), tmp_path / "twice")
    warned = execute(again).warnings
    assert all("a copy of a copy" in " ".join(words) for words in warned.values())
    assert len(warned) == 2
    ratio = Run(tmp_path / "once", recipe.build(TOLD), tmp_path / "ratio", ratio=(1, 1))
    with pytest.raises(BadInput, match="recorded ones"):
        execute(ratio)
    convert(tmp_path / "once", tmp_path / "rlds", "rlds")
    given = [json.loads(path.read_bytes()) for path in (tmp_path / "rlds").rglob("rpaug.json")]
    assert [one["synthetic"] for one in given] == [True, True]


def test_layouts_keep_splits_apart() -> None:
    for name in ("rlbench", "rlds", "lerobot"):
        for split, kind in splits.KINDS.items():
            assert splits.kind(adapter(name).key_for(f"{split}/task/0", 0)) == kind


def test_a_split_alone_does_not_name_a_dataset(tmp_path: Path) -> None:
    assert card.called(tmp_path / "drawers") == "drawers"
    assert card.called(tmp_path / "drawers" / "train") == "drawers/train"


def test_a_licence_is_taken_where_it_is_stated(tmp_path: Path) -> None:
    assert card.licence_of(tmp_path, []) == card.UNSTATED
    (tmp_path / "licensed.txt").write_text("no licence")
    assert card.licence_of(tmp_path, []) == card.UNSTATED
    (tmp_path / "license.txt").write_text("\nCC BY-NC-ND 4.0\n")
    (tmp_path / "LICENSE.code").write_text("MIT\n")
    both = "MIT (LICENSE.code of the source); CC BY-NC-ND 4.0 (license.txt of the source)"
    assert card.licence_of(tmp_path, []) == both
    (tmp_path / "license.txt").unlink()
    (tmp_path / "LICENSE.code").unlink()
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "a/README.md").write_text("---\ntags: [x]\nlicense: cc-by-4.0\n---\n# A\n")
    assert card.licence_of(tmp_path, ["a/b"]) == "cc-by-4.0"


def test_the_command_takes_a_ratio(template: Path, tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(TOLD))
    given = ["augment", template, "--recipe", tmp_path / "r.yaml", "--out", tmp_path / "out"]

    def run(*more: str) -> tuple[int, str]:
        result = CliRunner().invoke(app, [*map(str, given), *more])
        return result.exit_code, result.stdout + result.stderr

    assert run("--ratio", "3")[0] == 2
    assert "1:3" in run("--ratio", "0:3")[1]
    assert run("--ratio", "1:2", "--licence", "CC0-1.0", "--json")[0] == 0
    assert header(tmp_path / "out")["license"] == "CC0-1.0"
    assert header(tmp_path / "out")["episodes"] == {"recorded": 2, "synthetic": 4}
