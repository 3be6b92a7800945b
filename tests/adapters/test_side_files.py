"""`cameras.yaml` counts in the root of a dataset as it does beside the dataset's files, and copies bring it along."""

from pathlib import Path

import pytest
from test_links_out import made

from rpaug.core import registry

KINDS = ("rlds", "lerobot", "rdt", "robomimic", "maniskill", "droid")


@pytest.mark.parametrize("kind", KINDS)
def test_cameras_of_the_root_hold_for_what_lies_below_and_for_copies(
    kind: str, tmp_path: Path
) -> None:
    adapter = registry.adapter_for(root := made(kind, tmp_path / "in"))
    for path in root.rglob("cameras.yaml"):
        path.unlink()
    key = adapter.episodes(root)[0]
    name = min(adapter.read(root, key).views)
    (root / "cameras.yaml").write_text(f"version: 1\nviews: [{name}]\n")
    episode = adapter.read(root, key)
    assert list(episode.views) == [name]
    copy = adapter.key_at(key, 7)
    adapter.write(episode, tmp_path / "out", copy, dict)
    assert list(adapter.read(tmp_path / "out", copy).views) == [name]


def test_the_nearest_file_counts(tmp_path: Path) -> None:
    root = made("rlds", tmp_path / "in")
    adapter = registry.adapter_for(root)
    key = adapter.episodes(root)[0]
    (root / "cameras.yaml").write_text("version: 1\nviews: [nowhere]\n")
    (root / "toy/cameras.yaml").write_text("version: 1\nviews: [wrist]\n")
    assert list(adapter.read(root, key).views) == ["wrist"]


@pytest.mark.parametrize("kind", ["robomimic", "droid"])
def test_a_file_in_the_current_folder_is_no_one_elses(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that `rpaug calibrate --out cameras.yaml` wrote, not laid anywhere yet."""
    adapter = registry.adapter_for(root := made(kind, tmp_path / "in"))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    Path("cameras.yaml").write_text("version: 1\nviews: [nowhere]\n")
    key = adapter.episodes(root)[0]
    adapter.write(adapter.read(root, key), tmp_path / "out", adapter.key_at(key, 7), dict)
    assert not list((tmp_path / "out").rglob("cameras.yaml"))
