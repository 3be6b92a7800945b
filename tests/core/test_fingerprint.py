"""What tells whether a folder holds what it held."""

import shutil
from pathlib import Path

from rpaug.core.fingerprint import LARGE, contents


def test_places_sizes_and_blocks_of_large_files_count(tmp_path: Path) -> None:
    root = tmp_path / "a"
    (root / "deep").mkdir(parents=True)
    (root / "deep/one.png").write_bytes(b"abc")
    (root / "large.hdf5").write_bytes(bytes(4 * LARGE))
    first = contents(root)
    moved = Path(shutil.copytree(root, tmp_path / "b"))
    assert contents(moved) == first
    (moved / ".hidden").write_bytes(b"x")
    assert contents(moved) == first
    with (moved / "large.hdf5").open("r+b") as stream:
        stream.seek(-10, 2)
        stream.write(b"x")
    assert contents(moved) != first
    (root / "deep/one.png").rename(root / "deep/two.png")
    renamed = contents(root)
    assert renamed != first
    (root / "deep/two.png").write_bytes(b"abcd")
    assert contents(root) != renamed
