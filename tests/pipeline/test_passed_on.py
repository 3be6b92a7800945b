"""What no edit reaches goes into copies as it is: an episode of which some of that is damaged is left out, in words."""

import json
import struct
import zlib
from pathlib import Path

import h5py
import pytest
import rlds_samples
import sim_samples
from rpaug_adapters.rlds import tfrecord
from runs import GROUP, augment

from rpaug.core.errors import BadInput
from rpaug.pipeline import recipe


def wanted(camera: str) -> recipe.Recipe:
    """One camera changes, the others do not."""
    return recipe.build({"version": 1, "edits": [{"op": "sensor_noise", "cameras": [camera]}]})


def spoilt(data: bytes, number: int = 0) -> bytes:
    """One of the PNGs in some bytes with pixels that cannot be unpacked, and right checksums."""
    at = -1
    for _ in range(number + 1):
        at = data.index(b"IDAT", at + 1)
    end = at + 4 + struct.unpack(">I", data[at - 4 : at])[0]
    chunk = data[at : at + 4] + b"\0" * (end - at - 4)
    return data[:at] + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[end + 4 :]


def test_a_spoilt_depth_image_of_a_camera_that_stays(dataset: Path, tmp_path: Path) -> None:
    path = dataset / GROUP / "episode1/overhead_depth/2.png"
    path.write_bytes(spoilt(path.read_bytes()))
    summary = augment(dataset, wanted("front"), tmp_path / "out")
    assert (summary.exit_code, summary.copies) == (1, 1)
    assert "overhead_depth/2.png: image data" in summary.failures[f"{GROUP}/episode1"]


@pytest.mark.parametrize("name", ["obs/agentview_depth", "states"])
def test_a_chunk_whose_filter_fails(name: str, tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    with h5py.File(path, "r+") as file:
        place = f"data/demo_1/{name}"
        values, attributes = file[place][()], dict(file[place].attrs)
        del file[place]
        made = file.create_dataset(place, data=values, chunks=values.shape, compression="gzip")
        made.attrs.update(attributes)
        made.id.write_direct_chunk((0,) * values.ndim, b"no deflated data")
    summary = augment(path.parent, wanted("robot0_eye_in_hand"), tmp_path / "out")
    assert (summary.exit_code, summary.copies) == (1, 1)
    ((key, words),) = summary.failures.items()
    assert key == "lift/demo_1"
    assert str(path) in words or "lift/demo_1: data" in words


def test_a_spoilt_image_in_a_record(tmp_path: Path) -> None:
    root = rlds_samples.dataset(tmp_path / "in", train=(1,), val=(1,))
    (path,) = root.rglob("toy-train.tfrecord*")
    path.write_bytes(tfrecord.frame(spoilt(tfrecord.read(path, 0), number=7)))
    summary = augment(root, wanted("image"), tmp_path / "out")
    assert (summary.exit_code, summary.copies) == (1, 1)
    assert "steps/observation/wrist, step 1" in summary.failures["toy/1.0.0/train/0"]


def test_two_splits_of_one_name_are_refused(tmp_path: Path) -> None:
    root = rlds_samples.dataset(tmp_path / "in")
    path = root / "toy/1.0.0/dataset_info.json"
    given = json.loads(path.read_bytes())
    given["splits"] *= 2
    path.write_text(json.dumps(given))
    with pytest.raises(BadInput, match="'train' twice"):
        augment(root, wanted("image"), tmp_path / "out")
