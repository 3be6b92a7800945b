"""The notebooks run from top to bottom in a Jupyter kernel, show images, say what they show, and hold no output."""

import base64
import io
import json
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent.parent / "docs/notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
LONGEST = 600  # seconds of one cell
CLAIMS = {
    "augment_in_memory": """[
        checked.passed,
        0.1 < changed.mean() <= 1,
    ]""",
    "train_with_wrap": """[
        losses[-1] < losses[0],
        bool((sample["joints"] == plain[5]["joints"]).all()),
        bool((sample["image"] != plain[5]["image"]).any()),
    ]""",
    "diagnose_and_repair": """[
        [cause.factor for cause in diagnosis.causes] == ["lighting"],
        bool((after != before).any()),
    ]""",
}
"""What must hold of the names that each notebook leaves behind."""


def images(cell: Any) -> list[np.ndarray]:
    """The pictures that a cell shows."""
    shown = [
        output["data"]["image/png"]
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(one)))) for one in shown]


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_hold_no_output(name: str) -> None:
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_run_in_a_kernel(name: str, tmp_path: Path) -> None:
    """A cell that raises ends the run with its error."""
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    claim = f"import json\nprint(json.dumps([bool(one) for one in {CLAIMS[name]}]))"
    notebook.cells.append(nbformat.v4.new_code_cell(claim))
    where = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=LONGEST, kernel_name="python3", resources=where).execute()
    *cells, last = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(json.loads(last.outputs[0]["text"])), last.outputs
    outputs = [output for cell in cells for output in cell.outputs]
    assert "error" not in {output["output_type"] for output in outputs}
    pictures = [image for cell in cells for image in images(cell)]
    assert pictures
    for picture in pictures:  # two images side by side, which differ
        left, right = np.split(picture[..., :3].astype(int), 2, axis=1)
        assert left.std() > 5
        assert np.abs(left - right).mean() > 1
