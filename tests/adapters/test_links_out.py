"""Links that leave a dataset are refused by name, in every layout; those of Hugging Face's cache stay in it."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import lerobot_samples
import pytest
import rlds_samples
from droid_samples import droid
from rolling import demonstration
from runs import augment, contents
from sim_samples import maniskill, robomimic
from typer.testing import CliRunner
from videos import write

from rpaug import BadInput
from rpaug.cli import app
from rpaug.core import files, registry
from rpaug.pipeline import recipe
from rpaug.pipeline.card import licence_of
from rpaug.pipeline.convert import convert
from rpaug.scene.targets import settled

GROUP = "roll_ball/all_variations/episodes"
DROID = "*/success/*/*"


def rlbench(folder: Path) -> None:
    """Descriptions beside the episodes, as upstream has them."""
    for number in range(2):
        key = f"{GROUP}/episode{number}"
        registry.adapter("rlbench").write(demonstration(6), folder, key, dict)
        beside = folder / key / "variation_descriptions.pkl"
        shutil.copy(beside, folder / GROUP / "../variation_descriptions.pkl")
        beside.unlink()


def rdt(folder: Path) -> None:
    for number in range(2):
        registry.adapter("rdt").write(demonstration(6), folder, f"pour/episode_{number}", dict)


def film(folder: Path) -> None:
    for name in ("one", "two"):
        write(folder / f"{name}.mp4", 6)
    (folder / "clips.yaml").write_text("clips:\n  - {video: one, start: 0.0, end: 0.1}\n")
    (folder / "ego4d.json").write_text("{}")


MADE: dict[str, tuple[str, Callable[[Path], object]]] = {
    "rlbench": ("rlbench", rlbench),
    "rlds": ("rlds", rlds_samples.dataset),
    "lerobot": ("lerobot", lerobot_samples.dataset),
    "robomimic": ("hdf5_sim", lambda folder: robomimic(folder / "demo.hdf5")),
    "maniskill": ("hdf5_sim", lambda folder: maniskill(folder / "traj.h5")),
    "droid": ("droid", droid),
    "rdt": ("rdt", rdt),
    "video": ("video", film),
}
CASES = [
    ("rlbench", f"{GROUP}/episode0"),
    ("rlbench", GROUP),
    ("rlbench", "roll_ball/all_variations/variation_descriptions.pkl"),
    ("rlbench", f"{GROUP}/episode0/front_rgb/0.png"),
    ("rlds", "**/*-train.tfrecord-*"),
    ("rlds", "**/features.json"),
    ("rlds", "**/dataset_info.json"),
    ("lerobot", "toy/meta"),
    ("lerobot", "toy/meta/info.json"),
    ("lerobot", "toy/meta/tasks.parquet"),
    ("lerobot", "toy/meta/episodes"),
    ("lerobot", "toy/data"),
    ("lerobot", "toy/data/**/*.parquet"),
    ("lerobot", "toy/videos/**/*.mp4"),
    ("robomimic", "demo.hdf5"),
    ("maniskill", "traj.h5"),
    ("maniskill", "traj.json"),
    ("droid", f"{DROID}/trajectory.h5"),
    ("droid", f"{DROID}/recordings/MP4/*.mp4"),
    ("droid", f"{DROID}/metadata_*.json"),
    ("droid", "**/aggregated-annotations*.json"),
    ("rdt", "pour/episode_0/episode_0.hdf5"),
    ("rdt", "pour/episode_0/expanded_instruction_gpt-4-turbo.json"),
    ("video", "one.mp4"),
    ("video", "clips.yaml"),
    ("video", "ego4d.json"),
]


def made(kind: str, folder: Path) -> Path:
    folder.mkdir()
    MADE[kind][1](folder)
    return folder


def lead_out(path: Path, outside: Path) -> None:
    """Put a link in place of a file or folder, which goes elsewhere."""
    outside.mkdir(exist_ok=True)
    path.rename(outside / path.name)
    path.symlink_to(outside / path.name)


def read_all(root: Path) -> list[int]:
    adapter = registry.adapter_for(root)
    return [adapter.read(root, key).length for key in adapter.episodes(root)]


def cached(source: Path, cache: Path) -> Path:
    """A dataset as Hugging Face's cache holds it; returns the snapshot."""
    repository = cache / "datasets--somebody--toy"
    snapshot, blobs = repository / "snapshots/0f1e2d", repository / "blobs"
    blobs.mkdir(parents=True)
    for number, path in enumerate(sorted(one for one in source.rglob("*") if one.is_file())):
        shutil.copy(path, blobs / f"{number:040x}")
        link = snapshot / path.relative_to(source)
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(os.path.relpath(blobs / f"{number:040x}", link.parent))
    return snapshot


@pytest.mark.parametrize(("kind", "pattern"), CASES)
def test_a_link_out_is_refused_unless_links_are_followed(
    kind: str, pattern: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = made(kind, tmp_path / "in")
    before = read_all(root)
    path = min(root.glob(pattern))
    lead_out(path, tmp_path / "outside")
    with pytest.raises(BadInput, match=r"link: found a link to .*outside.*RPAUG_FOLLOW_LINKS=1"):
        read_all(root)
    monkeypatch.setenv(files.FOLLOW, "1")
    assert read_all(root) == before


@pytest.mark.parametrize("pattern", ["data/**/*1.parquet", "videos/**/*1.mp4"])
def test_an_older_lerobot_dataset_lacks_the_one_episode_alone(pattern: str, tmp_path: Path) -> None:
    convert(made("lerobot", tmp_path / "in"), tmp_path / "old", "lerobot@v2.1")
    lead_out(min((tmp_path / "old/toy").glob(pattern)), tmp_path / "outside")
    adapter = registry.adapter("lerobot")
    first, second, *_ = adapter.episodes(tmp_path / "old")
    assert adapter.read(tmp_path / "old", first).length > 0
    with pytest.raises(BadInput, match="link: found a link to"):
        adapter.read(tmp_path / "old", second)


def test_a_single_video_may_be_a_link_and_what_lies_beside_it_may_not(tmp_path: Path) -> None:
    root = made("video", tmp_path / "in")
    lead_out(root / "one.mp4", tmp_path / "outside")
    assert read_all(root / "one.mp4") == [6]
    (root / "cameras.yaml").write_text("version: 1\n")
    lead_out(root / "cameras.yaml", tmp_path / "outside")
    with pytest.raises(BadInput, match=r"cameras\.yaml: link: found a link to"):
        read_all(root / "one.mp4")


@pytest.mark.parametrize("kind", MADE)
def test_links_that_stay_inside_and_a_root_that_is_a_link_are_fine(
    kind: str, tmp_path: Path
) -> None:
    root = made(kind, tmp_path / "in")
    before = read_all(root)
    link = tmp_path / "link"
    link.symlink_to(root)
    assert read_all(link) == before


def test_an_episode_may_be_a_link_to_another_of_its_dataset(tmp_path: Path) -> None:
    root = made("rlbench", tmp_path / "in")
    (root / "kept").mkdir()
    path = root / GROUP / "episode1"
    path.rename(root / "kept/episode9")
    path.symlink_to(root / "kept/episode9")
    assert read_all(root) == [6, 6]


def test_side_files_that_are_links_out_are_refused(tmp_path: Path) -> None:
    root = made("rlds", tmp_path / "in")
    path = min(root.rglob("features.json")).with_name("cameras.yaml")
    path.write_text("version: 1\n")
    assert read_all(root)
    lead_out(path, tmp_path / "outside")
    with pytest.raises(BadInput, match=r"cameras\.yaml: link: found a link to"):
        read_all(root)
    (root / "roles.yaml").write_text("version: 1\nroles: {}\n")
    assert settled.read(root) == {}
    lead_out(root / "roles.yaml", tmp_path / "outside")
    with pytest.raises(BadInput, match=r"roles\.yaml: link: found a link to"):
        settled.read(root)


def test_a_licence_that_is_a_link_out_is_not_read(tmp_path: Path) -> None:
    root = made("rlbench", tmp_path / "in")
    for name in ("LICENSE", "README.md"):
        (root / name).write_text("---\nlicense: secret\n---\n")
        lead_out(root / name, tmp_path / "outside")
    found = licence_of(root, [])
    assert "secret" not in found
    assert "LICENSE of the source is a link out of it" in found
    assert "README.md of the source is a link out of it" in found


@pytest.mark.parametrize("kind", ["lerobot", "rlds", "rlbench", "video"])
def test_hugging_faces_cache_is_read_and_written_as_it_is(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = made(kind, tmp_path / "in")
    snapshot = cached(plain, tmp_path / "cache")
    assert read_all(snapshot) == read_all(plain)
    for source, name in ((plain, "plain"), (snapshot, "of_cache")):
        augment(source, recipe.build({"version": 1}), tmp_path / name)
    said = ("rpaug", "README.md")  # a dataset's card and journal name their source

    def held(folder: Path) -> dict[str, bytes]:
        found = contents(folder)
        return {name: data for name, data in found.items() if not Path(name).name.startswith(said)}

    assert held(tmp_path / "of_cache") == held(tmp_path / "plain")
    assert not [one for one in (tmp_path / "of_cache").rglob("*") if one.is_symlink()]


def test_blobs_of_another_repository_are_outside(tmp_path: Path) -> None:
    snapshot = cached(made("rlds", tmp_path / "in"), tmp_path / "cache")
    other = tmp_path / "cache/datasets--somebody--else/blobs"
    other.mkdir(parents=True)
    path = min(snapshot.rglob("*-train.tfrecord-*"))
    shutil.copy(path, other / "secret")
    path.unlink()
    path.symlink_to(other / "secret")
    with pytest.raises(BadInput, match=r"link: found a link to .*secret"):
        read_all(snapshot)


def run(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_a_run_leaves_such_an_episode_out_with_a_line(tmp_path: Path) -> None:
    root = made("rlbench", tmp_path / "in")
    lead_out(root / GROUP / "episode0", tmp_path / "outside")
    (tmp_path / "recipe.yaml").write_text("version: 1\nedits: []\n")
    code, said = run(
        "augment", root, "--recipe", tmp_path / "recipe.yaml", "--out", tmp_path / "out"
    )
    assert code == 1
    assert "found a link to" in said
    assert "RPAUG_FOLLOW_LINKS=1" in said
    assert (tmp_path / "out" / GROUP / "episode0/low_dim_obs.pkl").is_file()
    assert not (tmp_path / "out" / GROUP / "episode1").exists()


def test_convert_and_inspect_refuse_it_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = made("rlbench", tmp_path / "in")
    lead_out(root / GROUP / "episode0", tmp_path / "outside")
    code, said = run("inspect", root, "--episode", f"{GROUP}/episode0")
    assert (code, "found a link to" in said) == (2, True)
    code, said = run("convert", root, "--to", "rlds", "--out", tmp_path / "rlds")
    assert (code, "found a link to" in said) == (1, True)
    assert read_all(tmp_path / "rlds") == [6]
    monkeypatch.setenv(files.FOLLOW, "1")
    code, said = run("inspect", root, "--episode", f"{GROUP}/episode0")
    assert (code, "found a link to" in said) == (0, False)
