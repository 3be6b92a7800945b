"""HDF5 members are named by their place in the file, whatever a spoilt file calls them."""

from pathlib import Path

import h5py
import numpy as np
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


def test_data_that_lies_elsewhere_is_refused(tmp_path: Path) -> None:
    """Virtual data, raw files, references and links out of the file would follow wherever it points."""
    with h5py.File(tmp_path / "other.hdf5", "w") as other:
        other["secret"] = np.arange(4)
    layout = h5py.VirtualLayout((4,), int)
    layout[:] = h5py.VirtualSource(tmp_path / "other.hdf5", "secret", (4,))
    (tmp_path / "raw").write_bytes(bytes(32))
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["own"] = np.arange(4)
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("raw", (4,), int, external=[(str(tmp_path / "raw"), 0, 32)])
        file["linked"] = h5py.ExternalLink(str(tmp_path / "other.hdf5"), "secret")
        file.create_dataset("references", data=np.array([file["own"].ref], h5py.ref_dtype))
        assert dataset(tmp_path / "a.hdf5", file, "own")[()].tolist() == [0, 1, 2, 3]
        for name in ("virtual", "raw", "linked", "references"):
            with pytest.raises(BadInput, match=f"a.hdf5: {name}:"):
                dataset(tmp_path / "a.hdf5", file, name)


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
