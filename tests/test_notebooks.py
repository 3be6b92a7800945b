"""The notebooks run from top to bottom, say what they show, and hold no output."""

import json
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parent.parent / "docs/notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def cells(name: str) -> list[dict[str, Any]]:
    notebook = json.loads((FOLDER / f"{name}.ipynb").read_text())
    assert notebook["nbformat"] == 4
    return notebook["cells"]


def ran(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names that the cells leave behind, run in order in an empty folder."""
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}
    for number, cell in enumerate(cells(name)):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{name}, cell {number}", "exec"), names)
    return names


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_hold_no_output(name: str) -> None:
    for cell in cells(name):
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


def test_augmenting_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = ran("augment_in_memory", tmp_path, monkeypatch)
    assert left["checked"].passed
    assert 0.1 < left["changed"].mean() <= 1
    assert left["image"].size == (768, 384)


def test_training_with_wrap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = ran("train_with_wrap", tmp_path, monkeypatch)
    assert left["losses"][-1] < left["losses"][0]
    assert (left["sample"]["joints"] == left["plain"][5]["joints"]).all()
    assert (left["sample"]["image"] != left["plain"][5]["image"]).any()


def test_diagnosing_and_repairing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = ran("diagnose_and_repair", tmp_path, monkeypatch)
    assert [cause.factor for cause in left["diagnosis"].causes] == ["lighting"]
    assert (left["after"] != left["before"]).any()
