"""HDF5 members are named by their place in the file, whatever a spoilt file calls them."""

from pathlib import Path

import h5py
import pytest
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
