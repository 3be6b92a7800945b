"""HDF5 members are named by their place in the file, whatever a spoilt file calls them."""

from pathlib import Path

import h5py
import pytest
from rpaug_adapters.shared import hdf5
from rpaug_adapters.shared.hdf5 import dataset, member

from rpaug import BadInput


@pytest.mark.parametrize("name", ["", "absent", "link"])
def test_what_is_not_there_is_named_from_the_root(name: str, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        group = file.create_group("data/demo_0")
        group["link"] = h5py.SoftLink("/data")
        for reader in (member, dataset):
            with pytest.raises(BadInput, match=f"data/demo_0/{name}:"):
                reader(tmp_path / "a.hdf5", group, name)


ONCE = "input(); print('read', flush=True); input()"  # breaks on the second file
NEVER = "input()"


def test_what_an_earlier_file_broke_is_not_the_next_ones_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5, "CHILD", tmp_path / "child.py")
    (tmp_path / "child.py").write_text(ONCE)
    prover = hdf5._Prover()
    assert [prover.ask(tmp_path / name, None, 20.0) for name in "abc"] == ["read"] * 3
    prover.child.kill()
    assert prover.ask(tmp_path / "d", None, 20.0) == "read"
    (tmp_path / "child.py").write_text(NEVER)
    assert prover.ask(tmp_path / "e", None, 20.0) == "crashed"
    prover.close()
