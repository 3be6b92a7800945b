"""Which split an episode belongs to, by its key."""

import pytest

from rpaug.core import splits


@pytest.mark.parametrize(
    ("folder", "kind"),
    [
        ("train", "train"),
        ("training", "train"),
        ("val", "val"),
        ("valid", "val"),
        ("validation", "val"),
        ("dev", "val"),
        ("eval", "val"),
        ("test", "test"),
        ("testing", "test"),
        ("holdout", "test"),
    ],
)
def test_folders_name_splits_in_any_case(folder: str, kind: str) -> None:
    for name in (folder, folder.upper()):
        assert splits.of(f"a/{name}/b/episode0") == name
        assert splits.kind(f"{name}/episode0") == kind


@pytest.mark.parametrize("key", ["episode0", "a/b/test", "trained/episode0", "val"])
def test_an_episode_s_own_name_is_no_split(key: str) -> None:
    assert splits.of(key) is None
    assert splits.kind(key) is None
