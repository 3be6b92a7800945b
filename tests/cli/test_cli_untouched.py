"""`rpaug augment --untouched link`: what no edit reaches takes no room, and nothing recorded is ever written to."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import registry

EXPOSURE = "{op: sensor_exposure, stops: [1, 1], cameras: [front]}"
CAMERA = "{op: camera_pose, camera: front, by: [0, 0.02, 0]}"
PAINT = "{op: recolor, target: {role: manipulated}, color: blue}"


def augmented(source: Path, out: Path, edits: str, how: str) -> Path:
    recipe = out.with_suffix(".yaml")
    recipe.write_text(f"version: 1\nedits: [{edits}]\ngates: {{self_check: false}}\n")
    command = ["augment", str(source), "--recipe", str(recipe), "--out", str(out)]
    done = CliRunner().invoke(app, [*command, "--untouched", how])
    assert done.exit_code == 0, done.output
    return out


def recorded(root: Path) -> dict[str, Path]:
    """Files of the episode, without reports."""
    paths = sorted(path for path in root.rglob("episode0/**/*") if path.is_file())
    return {p.relative_to(root).as_posix(): p for p in paths if not p.name.startswith("rpaug")}


@pytest.mark.parametrize("edits", [EXPOSURE, PAINT, f"{CAMERA}, {PAINT}"])
def test_links_hold_the_bytes_of_copies_and_no_recorded_file_is_written_to(
    tmp_path: Path, edits: str
) -> None:
    source = Path(shutil.copytree(registry.dataset("sample"), tmp_path / "source"))
    files = recorded(source)
    before = {name: path.read_bytes() for name, path in files.items()}
    copied = recorded(augmented(source, tmp_path / "copied", edits, "copy"))
    linked = recorded(augmented(source, tmp_path / "linked", edits, "link"))
    assert {name: path.read_bytes() for name, path in files.items()} == before
    assert {n: p.read_bytes() for n, p in linked.items()} == {
        n: p.read_bytes() for n, p in copied.items()
    }
    assert not any(path.samefile(files[name]) for name, path in copied.items() if name in files)
    shared = {n for n, path in linked.items() if n in files and path.samefile(files[n])}
    assert shared
    assert all(before[name] == linked[name].read_bytes() for name in shared)
    if edits == EXPOSURE:
        assert shared >= {name for name in linked if "png" in name and "/front_rgb/" not in name}
