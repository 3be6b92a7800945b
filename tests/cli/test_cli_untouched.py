"""`rpaug augment --untouched link`: what no edit reaches takes no room, and the bytes are those of copies."""

from pathlib import Path

from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import registry


def augmented(out: Path, how: str) -> Path:
    recipe = out.with_suffix(".yaml")
    recipe.write_text(
        "version: 1\nedits: [{op: sensor_exposure, stops: [1, 1], cameras: [front]}]\n"
    )
    command = ["augment", "sample", "--recipe", str(recipe), "--out", str(out), "--untouched", how]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    return out


def images(root: Path) -> dict[str, Path]:
    return {path.relative_to(root).as_posix(): path for path in sorted(root.rglob("*.png"))}


def test_untouched_images_are_the_recorded_files(tmp_path: Path) -> None:
    source = images(registry.dataset("sample"))
    before = {name: path.read_bytes() for name, path in source.items()}
    linked = images(augmented(tmp_path / "linked", "link"))
    copied = images(augmented(tmp_path / "copied", "copy"))
    assert {n: p.read_bytes() for n, p in linked.items()} == {
        n: p.read_bytes() for n, p in copied.items()
    }
    shared = {name for name, path in linked.items() if path.samefile(source[name])}
    assert shared == {name for name in linked if "/front_rgb/" not in name}
    assert not any(path.samefile(source[name]) for name, path in copied.items())
    assert {name: path.read_bytes() for name, path in source.items()} == before
